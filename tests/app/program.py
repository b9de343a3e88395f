"""Runs the program as a user would, for the Python tests."""

import json
import os
import signal
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

PROGRAM = os.environ["SWEEPVI"]
SOURCE = Path(os.environ.get("SWEEPVI_SOURCE", Path(__file__).resolve().parents[2]))
PROCESSORS = 2

SUMMARY_KEYS = set(
    "exit status steps seconds_total seconds_setup seconds_stepping seconds_per_step matmult_seconds"
    " matmults_per_step ranks unknowns constraints jacobian_nonzeros edge_cut snes_type snes_iterations"
    " predictor_hits factorizations linear_solves active_changes rungs max_residual max_penetration peak_rss_bytes"
    " unused_options".split()
)

ENVIRONMENT = {
    "OMPI_MCA_ess_singleton_isolated": "1",  # without mpiexec: no daemon, half the start-up time
    "OMPI_MCA_mpi_yield_when_idle": "1",  # more ranks than processors: waiting must not keep others from working
    # One rank's exit code ends the job; mpiexec need not wait 1 s for the others, which have left MPI_Finalize as well.
    "OMPI_MCA_odls_base_sigkill_timeout": "0",
}


@dataclass
class Outcome:
    """What a run left: exit code, standard output and standard error."""

    command: str
    code: int
    out: str
    err: str

    def __str__(self):
        return f"{self.command}\nexit {self.code}\n--- standard output\n{self.out}\n--- standard error\n{self.err}"


# An error out of PETSc leaves its objects to the end of the process, and with them what MPI keeps for their communicator. In
# sanitized runs only the slow unwinder can tell whose that is (scripts/leaks.supp).
SLOW_UNWINDER = (
    {"ASAN_OPTIONS": os.environ["ASAN_OPTIONS"] + ":fast_unwind_on_malloc=0"} if "ASAN_OPTIONS" in os.environ else {}
)


def run(*words, ranks=1, cwd=None, env=None, timeout=60, out=subprocess.PIPE):
    """`sweepvi WORDS...`; on one rank without mpiexec. A run that hangs is an AssertionError."""
    command = [PROGRAM, *map(str, words)]
    if ranks > 1:
        command = ["mpiexec", "--oversubscribe", "-n", str(ranks), *command]
    with temporary_folder() as session:  # where MPI keeps its own files; shared, runs side by side remove each other's
        process = subprocess.Popen(
            command,
            cwd=cwd,
            env={**os.environ, **ENVIRONMENT, "OMPI_MCA_orte_tmpdir_base": session, **(env or {})},
            stdin=subprocess.DEVNULL,
            stdout=out,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
        )
        try:
            printed, err = process.communicate(timeout=timeout)
        except subprocess.TimeoutExpired:
            end(process)
            raise AssertionError(f"did not end within {timeout} s: {' '.join(command)}") from None
    return Outcome(" ".join(command), process.returncode, printed or "", err)


def end(process):
    """mpiexec puts its ranks into groups of their own; asked politely, it ends them."""
    process.terminate()
    try:
        process.communicate(timeout=10)
    except subprocess.TimeoutExpired:
        os.killpg(process.pid, signal.SIGKILL)


def run_all(work, items, ranks=1):
    """[work(item) for item in items], as many at a time as there are processors for."""
    with ThreadPoolExecutor(max(1, PROCESSORS // ranks)) as pool:
        return list(pool.map(work, items))


def temporary_folder():
    # A run that is being ended may still write into it.
    return tempfile.TemporaryDirectory(prefix="sweepvi_", ignore_cleanup_errors=True)


def content(folder):
    """Every file below the folder, by name."""
    folder = Path(folder)
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def read_json(path):
    return json.loads(Path(path).read_text())


class Verdict:
    """Collects what was expected and not found, so that one run of a test shows all of it."""

    def __init__(self):
        self.failed = False

    def expect(self, holds, text):
        print(("ok      " if holds else "FAILED  ") + text, flush=True)
        self.failed = self.failed or not holds

    def exit(self):
        sys.exit(1 if self.failed else 0)
