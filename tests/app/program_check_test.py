# ranks: 1
# timeout: 240
"""The program from outside, as contract.md (and the README) promise it: check, and runs that end in an unsolved step."""

import re
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program
from in_folder import DATASETS, ONE_STATE, InFolder

# The wall y' = 1 pushes x towards the wall at 1.05; from step 11, t = 1.1 s, nothing fits between them.
SQUEEZE = """title = "closing gap"
[time]
end = 2.0
step = 0.1
[model]
kind = "linear"            # w = (x - y, 1.05 - x)
A = [[0, 0], [0, 0]]
B = [[1, -1], [0, 0]]
C = [[1, -1], [-1, 0]]
w0 = [0, 1.05]
f = [0, 1]
x0 = [0.5, 0]
"""
SQUEEZED = 10  # steps that have a solution


class Check(InFolder):
    def test_examples(self):
        scenes = sorted(Path(program.SOURCE).glob("examples/*/scene.toml"))
        self.assertGreater(len(scenes), 1)
        on_two_ranks = {"homsp", "moreau-jean", "catching-up", "zhuravlev-ivanov"}  # the first scene of each
        for scene in scenes:
            scheme = re.search(r'(?m)^scheme *= *"(\S+)"', scene.read_text())[1]
            for ranks in (1, 2) if scheme in on_two_ranks else (1,):
                with self.subTest(scene.parent.name, ranks=ranks):
                    outcome = self.sweepvi("check", scene, ranks=ranks)
                    self.assertIn(f"scheme {scheme}", outcome.out)
                    more = {
                        "homsp": ("sizes", "relative degree", "Markov matrix", "zero dynamics"),
                        "moreau-jean": ("sizes", "mass matrix", "restitution", "time stepping"),
                    }
                    for row in ("steps", "form", "unknowns", *more.get(scheme, ())):
                        self.assertRegex(outcome.out, rf"(?m)^{row}  +\S", outcome)
                    self.assertEqual(outcome.err, "", outcome)
                    self.assertEqual(self.files(), [])
            on_two_ranks.discard(scheme)
        self.assertEqual(on_two_ranks, set(), "a scheme without a scene")

    def test_paper65(self):
        text = self.sweepvi("check", program.SOURCE / "examples/paper65/scene.toml").out
        self.assertRegex(text, r"relative degree +r = 3 for 1 constraint\b")
        self.assertRegex(text, r"zero dynamics +2 states")
        self.assertRegex(text, r"sizes +5 states, 1 constraints, 3 outputs")

    def test_degrees_of_a_mixture(self):
        """r = 1 and r = 2 in one system, and an unstable zero dynamics: x3' = x3 + x1."""
        text = self.sweepvi("check", self.write(
            "[time]\nend = 1\nstep = 0.1\n[model]\nkind = \"linear\"\n"
            "A = [[0, 1, 0, 0], [0, 0, 0, 0], [1, 0, 1, 0], [0, 0, 0, 0]]\n"
            "B = [[0, 0], [1, 0], [0, 0], [0, 1]]\nC = [[1, 0, 0, 0], [0, 0, 0, 1]]\nx0 = [1, 0, 0, 1]\n"
        )).out  # fmt: skip
        self.assertRegex(text, r"relative degree +r = 1 for 1 constraint, r = 2 for 1 constraint")
        self.assertRegex(text, r"zero dynamics +1 states, largest real part of the spectrum 1 1/s \(unstable")

    def test_solvability_is_not_promised_without_reason(self):
        """w = x - lambda: with x < 0 there is no lambda >= 0, so the Markov matrix D = -1 is not positive definite."""
        outcome = program.run("check", self.write(ONE_STATE + "D = [[-1]]\n"), cwd=self.folder)
        self.assertIn(outcome.code, (0, 2), outcome)
        self.assertNotIn("exactly one solution", outcome.out)
        self.assertNotIn("counted inf", outcome.out)


class Unsolved(InFolder):
    def judge(self, text, steps, ranks):
        """Exit 3; the file holds the run up to the last good step, with nothing of the failed one."""
        for every in (1, 3):
            recorded = f"[output]\nevery = {every}\n"
            part, attributes, summary = self.simulate(text + recorded, code=3, ranks=ranks)
            self.assertEqual((attributes["status"], summary["status"], summary["exit"]), ("failed", "failed", 3))
            self.assertEqual(summary["steps"], steps)
            rows = sorted({*range(0, steps + 1, every), steps})
            np.testing.assert_allclose(part["t"], 0.1 * np.array(rows), rtol=1e-14)
            self.assertEqual({len(part[name]) for name in DATASETS - {"events"}}, {len(rows)})
            self.assertEqual(self.files(), ["run.h5", "run.h5.checkpoint", "run.json", "run.problem.h5", "run.problem.toml", "scene.toml"])
        return part

    def test_no_step_at_all(self):
        for ranks in (1, 2):
            with self.subTest(ranks=ranks):
                part = self.judge(SQUEEZE.replace("w0 = [0, 1.05]", "w0 = [0, 0.05]"), 0, ranks)
                np.testing.assert_array_equal(part["t"], [0])

    def test_step_without_a_solution(self):
        for ranks in (1, 2):
            with self.subTest(ranks=ranks):
                part = self.judge(SQUEEZE, SQUEEZED, ranks)
                exact = np.column_stack([np.maximum(0.5, part["t"]), part["t"]])
                np.testing.assert_allclose(part["x"], exact, atol=1e-12)

    def test_step_without_a_solvable_jacobian(self):
        """I - h A = 0; and numbers that overflow."""
        singular = ONE_STATE.replace("A = [[0]]", "A = [[10.0]]").replace("f = [-2]\n", "")
        overflow = ONE_STATE.replace("f = [-2]", "f = [1.7e308]").replace("x0 = [1]", "x0 = [1.7e308]")
        for name, text in {"singular": singular, "overflow": overflow}.items():
            for ranks in (1, 2):
                with self.subTest(name, ranks=ranks):
                    words = ("--force", "-sweepvi_halvings", "0")  # half the step is solvable
                    outcome = self.sweepvi("run", self.write(text), *words, code=3, ranks=ranks)
                    self.assertIn("sweepvi: step 1, t = 0.1 s: ", outcome.err, outcome)

    def test_options_that_make_petsc_give_up(self):
        """They turn an unsolved step into an error inside PETSc; for us it is still an unsolved step."""
        for option in ("-snes_error_if_not_converged", "-ksp_error_if_not_converged", "-ts_error_if_step_fails"):
            with self.subTest(option):
                self.sweepvi("run", self.write(SQUEEZE), "--force", option, code=3)

    def test_summary_holds_the_failed_residual(self):
        """As after `solve`; without it the summary of a failed run looks perfect."""
        _, _, summary = self.simulate(SQUEEZE, code=3)
        self.assertGreater(summary["max_residual"], 1e-10)

    def test_message(self):
        scene = self.write(SQUEEZE)
        for ranks in (1, 2):
            with self.subTest(ranks=ranks):
                outcome = self.sweepvi("run", scene, "--force", code=3, ranks=ranks)
                self.assertEqual(len(re.findall(r"(?m)^sweepvi: step 11, t = 1.1 s: ", outcome.err)), 1, outcome)
                self.assertIn("asked for 1e-10", outcome.err)


if __name__ == "__main__":
    unittest.main()
