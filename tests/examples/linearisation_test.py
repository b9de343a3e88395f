"""Runs examples/linearisation on fewer random systems and holds its table against what its header says."""
# ranks: 2
# timeout: 240

import os
import subprocess
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

EXAMPLE = Path(os.environ["SWEEPVI_BUILD"]) / "examples" / "example_linearisation"
METHODS = ("reduced space", "semismooth", "outer", "ladder")


def table(systems, step, ranks=1):
    """{(problem, method): (steps, solved, same %, mean, most)}"""
    command = [str(EXAMPLE), "-systems", str(systems), "-step", str(step)]
    if ranks > 1:
        command = ["mpiexec", "--oversubscribe", "-n", str(ranks), *command]
    result = subprocess.run(command, env={**os.environ, **program.ENVIRONMENT}, capture_output=True, text=True, timeout=200)
    if result.returncode != 0:
        raise AssertionError(f"exit {result.returncode}\n{result.stdout}\n{result.stderr}")
    rows = {}
    for line in result.stdout.splitlines()[2:]:
        words = line[33:].split()
        percent, same, mean = map(float, words[2:5])
        steps, solved, most = int(words[0]), int(words[1]), int(words[5])
        assert abs(percent - 100 * solved / steps) < 1e-3, line
        rows[line[:17].strip(), line[17:33].strip()] = (steps, solved, same, mean, most)
    return rows


class Linearisation(unittest.TestCase):
    def solved(self, rows, problem):
        return [rows[problem, method][1] for method in METHODS]

    def test_a_small_study(self):
        random = 100  # five steps of each system
        rows = table(systems=random // 5, step=1e-2)
        self.assertEqual(len(rows), 6 * len(METHODS))
        for problem in ("ball", "regulator", "tracking"):
            for name, steps in ((problem, 300), (f"random {problem}", random)):
                reduced, semismooth, outer, ladder = self.solved(rows, name)
                self.assertTrue(all(rows[name, method][0] == steps for method in METHODS))
                # The ladder's first rung is reduced space; its fifth, outer linearisation.
                self.assertGreaterEqual(ladder, max(reduced, outer), name)
                self.assertGreaterEqual(ladder, 0.97 * steps, name)
                self.assertGreater(outer, reduced, f"{name}: SNESVI alone solves more")
                for method in METHODS:
                    _, solved, same, mean, most = rows[name, method]
                    self.assertLessEqual(same, 100 * solved / steps + 1e-3)
                    self.assertLessEqual(mean, most)
                if problem != "tracking":  # 5000 of 5000 in the header's study
                    self.assertEqual(outer, steps, name)
                    self.assertLessEqual(rows[name, "outer"][3], 4, name)
                    self.assertEqual(rows[name, "outer"][2], 100, "balls that fall have one solution")
        # 98.7 % and 76.4 % of 5000 steps; four standard deviations of 100 steps.
        self.assertAlmostEqual(self.solved(rows, "random tracking")[2] / random, 0.987, delta=0.046)
        self.assertAlmostEqual(self.solved(rows, "random tracking")[0] / random, 0.764, delta=0.17)

    def test_two_ranks(self):
        rows = table(systems=3, step=1e-1, ranks=2)
        self.assertEqual(rows["random ball", "outer"][:2], (15, 15))
        self.assertEqual(rows["tracking", "outer"][:2], (30, 28))


if __name__ == "__main__":
    unittest.main()
