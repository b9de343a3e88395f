# ranks: 1
"""A step that cannot be solved is left as a problem, with which `sweepvi solve` fails, or succeeds, in the same way."""

import re
import sys
import tomllib
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program

# x1' = 2 x1, so that I - h A is singular for h = 0.5; x2'' = -2 + lambda, x2 >= 0. Halved steps are solvable.
UNSTABLE = """
title = "a \\"title\\""
[time]
scheme = "homsp"
end = 2
step = 0.5
[model]
kind = "linear"
A = [[2, 0, 0], [0, 0, 1], [0, 0, 0]]
B = [[0], [0], [1]]
C = [[0, 1, 0]]
x0 = [1, 1, 0]
f = [0, 0, -2]
"""
# Nothing singular, but numbers whose rounding shows.
ORDINARY = UNSTABLE.replace("end = 2\n", "end = 20\n").replace("A = [[2, 0, 0], [0, 0, 1], [0, 0, 0]]", "A = [[-0.3, 0.7, 0.1], [0, 0, 1], [0.2, -0.9, -0.4]]")
FORMS = ("box-on-z", "primal-dual")


class ProblemFile(unittest.TestCase):
    def setUp(self):
        self.temporary = program.temporary_folder()
        self.folder = Path(self.temporary.__enter__())
        self.addCleanup(self.temporary.__exit__, None, None, None)

    def run_scene(self, scene, *words, ranks=1):
        (self.folder / "s.toml").write_text(scene)
        return program.run("run", "s.toml", "-o", "out.h5", "--force", *words, cwd=self.folder, ranks=ranks)

    def solve(self, *words, ranks=1):
        words = ("out.problem.toml", "-o", "solution.h5", "--force", "--summary", "solve.json", *words)
        outcome = program.run("solve", *words, cwd=self.folder, ranks=ranks)
        return outcome, program.read_json(self.folder / "solve.json")

    def problem(self):
        text = (self.folder / "out.problem.toml").read_text()
        keys = tomllib.loads(text)["problem"]
        self.assertEqual(set(keys), {"M", "q", "terms", "lower", "upper", "u0"})
        with h5py.File(self.folder / "out.problem.h5") as file:
            vectors = {name: file[name][:] for name in set(keys) - {"M"}}
            M = np.zeros(file["M"].attrs["shape"])
            starts, columns, values = (file["M"][part][:] for part in ("indptr", "indices", "data"))
            for row in range(len(M)):
                M[row, columns[starts[row] : starts[row + 1]]] = values[starts[row] : starts[row + 1]]
        return text, M, vectors

    def test_a_singular_step(self):
        for form in FORMS:
            for ranks in (1, 2):
                with self.subTest(form=form, ranks=ranks):
                    outcome = self.run_scene(UNSTABLE, "-sweepvi_halvings", "0", "-sweepvi_form", form, ranks=ranks)
                    self.assertEqual(outcome.code, 3, outcome)
                    for words in ("singular", "try sweepvi solve out.problem.toml", "Everything before it is in the output"):
                        self.assertIn(words, outcome.err)
                    text, M, vectors = self.problem()
                    self.assertIn("step 1, t = 0.5 s", text)
                    self.assertEqual(np.linalg.matrix_rank(M), len(M) - 1)
                    self.assertTrue((vectors["terms"] >= abs(vectors["q"])).all())
                    for other in (1, 3 - ranks):
                        solved, summary = self.solve(ranks=other)
                        self.assertEqual(solved.code, 3, solved)
                        self.assertIn("singular", solved.err)
                        self.assertEqual(sum(summary["rungs"].values()), 0)
                    self.assertEqual([path.name for path in self.folder.glob("*.partial")], [])

    def test_the_same_certificate(self):
        """Asked for the impossible, both fail; asked for the usual, the problem is solved, as the step would be."""
        for form in FORMS:
            with self.subTest(form=form):
                options = ("-sweepvi_form", form, "-sweepvi_certificate_rtol", "1e-30", "-sweepvi_halvings", "0")
                self.assertEqual(self.run_scene(ORDINARY, *options).code, 3)
                solved, summary = self.solve("-sweepvi_certificate_rtol", "1e-30")
                self.assertEqual(solved.code, 3, solved)
                solved, summary = self.solve()
                self.assertEqual(solved.code, 0, solved)
                self.assertEqual(sum(summary["rungs"].values()), 1)
                self.assertEqual(self.run_scene(ORDINARY, "-sweepvi_form", form).code, 0)
                text, _, _ = self.problem()
                step = int(re.search(r"step (\d+), t =", text)[1])
                with h5py.File(self.folder / "out.h5") as run, h5py.File(self.folder / "solution.h5") as solution:
                    x = run["x"][step]
                    u = np.ravel(solution["solution"])
                    # Every state is an unknown of both forms, or an output equal to it; in the solver's order.
                    for value in x:
                        self.assertLess(abs(u - value).min(), 1e-13, (x, u))
                    np.testing.assert_array_equal(np.ravel(solution["solver/rungs"]).sum(), 1)
                    self.assertEqual(len(solution["solver/rungs"].attrs["names"]), solution["solver/rungs"].shape[1])

    def test_smaller_steps(self):
        outcome = self.run_scene(UNSTABLE, "--summary", "s.json", ranks=2)
        self.assertEqual(outcome.code, 0, outcome)
        summary = program.read_json(self.folder / "s.json")
        self.assertEqual(summary["rungs"]["smaller_step"], 4)
        with h5py.File(self.folder / "out.h5") as file:
            np.testing.assert_array_equal(file["x"][:, 0], 4.0 ** np.arange(5))
            names = [str(name) for name in file["solver/rungs"].attrs["names"]]
            counts = file["solver/rungs"][:]
            np.testing.assert_array_equal(counts[:, names.index("smaller_step")], [0, 1, 1, 1, 1])
            self.assertEqual(counts.sum(), 4)
            # It falls in parts of 1/4 s, v = -j/2, x2 = 1 - j (j + 1) / 16 after j of them: it lands in the fourth.
            np.testing.assert_array_equal(file["x"][:4, 1], [1, 0.625, 0, 0])
            # z1 in the part that ends at 1 s, z2 in the next one, half a step later.
            np.testing.assert_array_equal(file["events"]["t"], [1, 1.25])
        self.assertFalse((self.folder / "out.problem.toml").exists())

    def test_files_that_cannot_be_written(self):
        """A warning, and the same exit code."""
        (self.folder / "out.problem.h5").mkdir()
        for ranks in (1, 2):
            outcome = self.run_scene(UNSTABLE, "-sweepvi_halvings", "0", ranks=ranks)
            self.assertEqual(outcome.code, 3, outcome)
            self.assertIn("could not be written", outcome.err)
            self.assertFalse((self.folder / "out.problem.toml").exists())

    def test_it_does_not_overwrite_the_scene(self):
        (self.folder / "out.problem.toml").write_text(UNSTABLE)
        outcome = program.run("run", "out.problem.toml", "-o", "out.h5", cwd=self.folder)
        self.assertEqual(outcome.code, 2, outcome)

    def test_terms(self):
        """What q was summed from excuses its rounding, and nothing else does."""
        problem = "[problem]\nM = [[0]]\nq = [2.8e-17]\nlower = -inf\n"  # q = 0.3 - 0.1 - 0.2, say
        for terms, code in (("", 3), ("terms = [0.6]\n", 0)):
            with self.subTest(terms=terms):
                (self.folder / "out.problem.toml").write_text(problem + terms)
                self.assertEqual(self.solve()[0].code, code)
        (self.folder / "out.problem.toml").write_text(problem + "terms = [-1]\n")
        outcome = program.run("solve", "out.problem.toml", "-o", "other.h5", cwd=self.folder)
        self.assertEqual(outcome.code, 2, outcome)
        self.assertIn("problem.terms", outcome.err)


if __name__ == "__main__":
    unittest.main()
