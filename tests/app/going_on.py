"""Stops runs, goes on with them, and compares what comes out with a run that nobody disturbed."""

import signal
import subprocess
import tempfile
import time

import h5py
import numpy as np

import program

MEASURED = {"solver/seconds"}  # wall time: the one dataset that two runs of the same scene do not share


def datasets(path):
    found = {}

    def take(name, item):
        if isinstance(item, h5py.Dataset) and name not in MEASURED:
            found[name] = item[()]

    with h5py.File(path) as file:
        file.visititems(take)
    return found


def same_bits(a, b):
    """Names of datasets that differ in a bit, or that only one file has."""
    first, second = datasets(a), datasets(b)
    names = set(first) ^ set(second)
    return sorted(names | {n for n in set(first) & set(second) if first[n].tobytes() != second[n].tobytes()})


def largest_difference(a, b, name="x"):
    return float(np.max(np.abs(datasets(a)[name] - datasets(b)[name])))


def interrupted(folder, words, ranks=1, after=None, send=signal.SIGUSR1, timeout=60):
    """Starts `sweepvi WORDS` and sends a signal once `after(folder)` is true, by default once rows are being written.
    Returns (exit code, standard error)."""
    command = [program.PROGRAM, *map(str, words)]
    if ranks > 1:
        command = ["mpiexec", "--oversubscribe", "-n", str(ranks), *command]
    with program.temporary_folder() as session, tempfile.TemporaryFile("w+") as errors:
        process = subprocess.Popen(
            command,
            cwd=folder,
            env={**program.os.environ, **program.ENVIRONMENT, "OMPI_MCA_orte_tmpdir_base": session},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=errors,
            start_new_session=True,
        )
        started = after or (lambda where: any(where.glob("*.partial")))
        deadline = time.monotonic() + timeout
        while process.poll() is None and not started(folder) and time.monotonic() < deadline:
            time.sleep(0.005)
        if process.poll() is None:
            process.send_signal(send)
        try:
            process.wait(timeout=timeout)
        except subprocess.TimeoutExpired:
            program.end(process)
            raise AssertionError(f"did not stop within {timeout} s: {' '.join(command)}") from None
        errors.seek(0)
        return process.returncode, errors.read()
