"""Kills writers of rows at random moments and reads back what they had marked."""

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

PROGRAM = str(Path(os.environ["SWEEPVI_BUILD"]) / "tests" / "row_program")


def start(*words, ranks, session):
    launcher = ["mpiexec", "--oversubscribe", "-n", str(ranks)] if ranks > 1 else []
    return subprocess.Popen(
        [*launcher, PROGRAM, *map(str, words)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, **program.ENVIRONMENT, "OMPI_MCA_orte_tmpdir_base": session},
    )


def kill_once(seed):
    """"" if the rows of the last mark were all there, else what happened."""
    choice = random.Random(seed)
    ranks, readers = choice.choice([1, 1, 2]), choice.choice([1, 1, 2])
    victims = choice.choice(["one", "all"])
    with program.temporary_folder() as folder, program.temporary_folder() as session:
        writer = start("write", folder, seed, ranks=ranks, session=session)
        lines = [writer.stdout.readline() for _ in range(ranks + 1)]
        if not all(lines):
            out, err = writer.communicate(timeout=30)
            return f"seed {seed}: the writer on {ranks} ranks did not start: exit {writer.returncode}\n{lines}{out}{err}"
        pids = [int(line.split()[1]) for line in lines[:-1]]
        announced = int(lines[-1])
        time.sleep(choice.uniform(0, 0.3))
        for pid in pids if victims == "all" else [choice.choice(pids)]:
            os.kill(pid, signal.SIGKILL)
        out, err = writer.communicate(timeout=30)
        # A line may be torn; later marks than the last one told may be there, too.
        marks = [announced] + [int(line) for line in out.split("\n")[:-1] if line.isdigit()]
        reader = start("read", folder, ranks=readers, session=session)
        out, err = reader.communicate(timeout=30)
        told = f"seed {seed}: {ranks} ranks, {victims} killed after {len(marks)} marks, read by {readers}"
        print(told, "rows", out.strip(), flush=True)
        good = reader.returncode == 0 and out.strip().isdigit()
    return "" if good else f"{told}: exit {reader.returncode}\n{out}{err}"


def kill(count):
    seed = random.randrange(10**6)  # printed, so that what failed can be looked at again
    failures = [text for text in program.run_all(kill_once, range(seed, seed + count)) if text]
    verdict = program.Verdict()
    verdict.expect(not failures, f"{count - len(failures)} of {count} kills left every marked row" + "".join(failures))
    verdict.exit()
