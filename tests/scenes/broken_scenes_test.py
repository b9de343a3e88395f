# ranks: 2
# timeout: 240
"""Broken scenes and command lines: the right exit code, one message that says what is wrong, and nothing written.

Each broken/NAME.toml is a case; its head says what to do and what must come of it:
    # command: solve        the verb, `run` if absent
    # scene: other.toml     named instead of this file; relative to broken/
    # args: -o a.h5         further words of the command line
    # env: NAME=VALUE       set in the environment
    # exists: a.h5          in the working directory beforehand
    # exit: 2
    # expect: fragment of the message, on standard error exactly once
"""

import re
import shlex
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

FOLDER = Path(__file__).resolve().parent / "broken"
HEADER = re.compile(r"^# (\w+): (.*)$")


def read_case(path):
    case = {"name": path.stem, "command": "run", "scene": path.name, "args": "", "env": "", "exists": ""}
    for line in path.read_text(errors="replace").splitlines():
        header = HEADER.match(line)
        if not header:
            break
        case[header[1]] = header[2]
    return case


def play(case, ranks):
    """What the program did, and which files appeared, changed or vanished."""
    with program.temporary_folder() as folder:
        if case["exists"]:
            (Path(folder) / case["exists"]).write_text("keep me\n")
        before = program.content(folder)
        words = [case["command"], FOLDER / case["scene"], *shlex.split(case["args"])]
        env = {**program.SLOW_UNWINDER, **(dict([case["env"].split("=", 1)]) if case["env"] else {})}
        try:
            outcome = program.run(*words, ranks=ranks, cwd=folder, env=env)
        except AssertionError as hang:
            outcome = program.Outcome(" ".join(map(str, words)), None, "", str(hang))
        after = program.content(folder)
    touched = sorted(name for name in before.keys() | after.keys() if before.get(name) != after.get(name))
    return outcome, touched


class BrokenScenes(unittest.TestCase):
    def judge(self, case, outcome, touched):
        self.assertEqual(outcome.code, int(case["exit"]), outcome)
        times = outcome.err.count(case["expect"])
        self.assertEqual(times, 1, f"the message {case['expect']!r} appears {times} times\n{outcome}")
        complaints = [line for line in outcome.err.splitlines() if line.startswith("sweepvi: ")]
        self.assertEqual(len(complaints), 1, f"expected one complaint\n{outcome}")
        for noise in ("PETSC ERROR", "MPI_ABORT", "terminate called", "HDF5-DIAG"):
            self.assertNotIn(noise, outcome.err, outcome)
        self.assertEqual(outcome.out.replace("\n", ""), "", f"standard output is for results\n{outcome}")
        self.assertEqual(touched, [], f"files appeared or changed: {touched}\n{outcome}")

    def at(self, ranks, each=1):
        """Every `each`-th case."""
        cases = [read_case(path) for path in sorted(FOLDER.glob("*.toml"))][::each]
        self.assertGreater(len(cases), 10)
        before = program.content(FOLDER)
        for case, played in zip(cases, program.run_all(lambda case: play(case, ranks), cases)):
            with self.subTest(case["name"], ranks=ranks):
                self.judge(case, *played)
        self.assertEqual(program.content(FOLDER), before, "a file beside the scenes changed")

    def test_on_one_rank(self):
        self.at(1)

    def test_on_two_ranks(self):
        self.at(2, each=10)  # mpiexec is slow to start; broken_scenes_full_test.py has them all


if __name__ == "__main__":
    unittest.main()
