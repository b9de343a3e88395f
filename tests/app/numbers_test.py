"""Numbers are looked at before they are used: step matrices, signals, tolerances, coordinates; and gaps are positions."""
# ranks: 1

import json
import math
import unittest
from pathlib import Path

import h5py
import numpy as np

from program import read_json, run, temporary_folder

BODY = """
[time]
scheme = "moreau-jean"
end = {end}
step = {step}
theta = {theta}
[model]
kind = "lagrangian"
M = {M}
K = {K}
H = {H}
q0 = {q0}
v0 = {v0}
e = {e}
"""

FALL = """
[time]
scheme = "homsp"
end = 1.0
step = 0.01
[model]
kind = "linear"
A = [[0, 1], [0, 0]]
B = [[0], [1]]
C = [[1, 0]]
f = [0, -1]
x0 = [0.3, 0]
"""


class Numbers(unittest.TestCase):
    def setUp(self):
        folder = temporary_folder()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def scene(self, text, **values):
        path = self.folder / "scene.toml"
        path.write_text(text.format(**values) if values else text)
        return path

    def run_scene(self, *words, ranks=1):
        return run("run", "scene.toml", "-o", "out.h5", "--force", "--summary", "s.json", *words, cwd=self.folder, ranks=ranks)

    def test_a_step_matrix_has_to_be_definite(self):
        # q'' = 1e5 q, theta = 1/2: definite for h < 2 / sqrt(1e5) = 6.3246e-3.
        values = dict(theta=0.5, M="[[1.0]]", K="[[-1e5]]", H="[[1.0]]", q0="[1.0]", v0="[-20.0]", e=0.5)
        for ranks in (1, 2):
            self.scene(BODY, end=0.06, step=1e-2, **values)
            refused = self.run_scene(ranks=ranks)
            self.assertEqual(refused.code, 2, refused.err)
            self.assertRegex(refused.err, r"not positive definite for the step h = 0.01 s.*works is 0.006324 s")
            self.assertFalse((self.folder / "out.h5").exists())
        self.scene(BODY, end=0.063, step=6.3e-3, **values)
        self.assertEqual(self.run_scene().code, 0)
        self.scene(BODY, end=0.064, step=6.4e-3, **values)
        self.assertEqual(self.run_scene().code, 2)

    def test_masses_have_to_be_definite(self):
        values = dict(end=2.0, step=1e-2, theta=0.5, K="[[1,0],[0,1]]", H="[[1,0]]", q0="[1,1]", v0="[-1,-1]", e=0.5)
        for M in ("[[1,1],[1,1]]", "[[1,2],[2,1]]"):
            self.scene(BODY, M=M, **values)
            for ranks in (1, 2):
                refused = self.run_scene(ranks=ranks)
                self.assertEqual(refused.code, 2, refused.err)
                self.assertIn("M is not positive definite", refused.err)
                self.assertIn("coordinates 0, 1", refused.err)

    def test_a_linear_step_may_not_pass_a_singular_one(self):
        # x' = 30 x: 1 - 30 h changes its sign at h = 1/30.
        text = FALL.replace("A = [[0, 1], [0, 0]]", "A = [[30, 1], [0, 0]]")
        self.scene(text.replace("step = 0.01", "step = 0.05"))
        refused = self.run_scene()
        self.assertEqual(refused.code, 2, refused.err)
        self.assertIn("real eigenvalue 30 1/s", refused.err)
        self.assertIn("works is 0.03333 s", refused.err)

    def test_signals_that_steps_do_not_resolve_are_told(self):
        text = """
[time]
scheme = "catching-up"
end = 1.0
step = {step}
[model]
kind = "sweeping"
u0 = [0]
f = [{{offset=0, amplitude=1, frequency=10, phase=0.5}}]
lower = [-100]
"""
        for step, told in ((0.1, True), (0.0125, True), (0.01, False)):
            self.scene(text, step=step)
            done = self.run_scene(ranks=2)
            self.assertEqual(done.code, 0, done.err)
            notes = [note for note in read_json(self.folder / "s.json")["notes"] if note["kind"] == "unresolved_signal"]
            self.assertEqual(len(notes), int(told))
            self.assertEqual("1 signal of up to 10 Hz is not resolved" in done.err, told)
            checked = run("check", "scene.toml", cwd=self.folder)
            self.assertEqual("10 Hz is not resolved" in checked.out, told)

    def test_a_loose_tolerance_certifies_nothing(self):
        self.scene(FALL)
        for tolerance, code, status in ((1e-6, 0, "done"), (1e-5, 6, "done, not certified")):
            words = ["-sweepvi_certificate_rtol", tolerance]
            done = self.run_scene(*words, ranks=2)
            self.assertEqual(done.code, code, done.err)
            summary = read_json(self.folder / "s.json")
            self.assertEqual((summary["exit"], summary["status"]), (code, status))
            with h5py.File(self.folder / "out.h5") as file:
                self.assertEqual(file.attrs["status"], status)
                self.assertEqual(len(file["t"]), 101)
            self.assertFalse((self.folder / "out.h5.checkpoint").exists())
            self.assertEqual(run("bench", "scene.toml", "--count", 3, "--warmup", 1, *words, cwd=self.folder).code, code)
            self.assertEqual(run("study", "scene.toml", "--steps", "1e-1,5e-2", "--repeats", 1, *words, cwd=self.folder).code, code)
        (self.folder / "p.toml").write_text("[problem]\nM = [[2, 1], [1, 2]]\nq = [-1, 1]\n")
        for tolerance, code in ((1e-6, 0), (1e-3, 6)):
            solved = run("solve", "p.toml", "-o", "p.h5", "--force", "-sweepvi_certificate_rtol", tolerance, cwd=self.folder)
            self.assertEqual(solved.code, code, solved.err)

    def test_ill_conditioned_coordinates_are_not_taken(self):
        # x1' = x2 + b lambda, x2' = lambda, in free flight: x = (1 - t, -1) whatever b > 0 is.
        text = """
[time]
scheme = "homsp"
end = 0.5
step = 1e-2
[model]
kind = "linear"
A = [[0,1],[0,0]]
B = [[{b}],[1]]
C = [[1,0]]
x0 = [1,-1]
"""
        for b, form in ((1.0, "box on z"), (1e-3, "box on z"), (1e-8, "primal-dual"), (1e-12, "primal-dual"), (1e-16, "primal-dual")):
            self.scene(text, b=b)
            done = self.run_scene()
            self.assertEqual(done.code, 0, done.err)
            self.assertIn(form, done.out)
            with h5py.File(self.folder / "out.h5") as file:
                # 50 steps, each with the rounding that the bound of 1e6 on the condition lets through.
                np.testing.assert_allclose(file["x"][-1], [0.5, -1.0], rtol=50 * 1e6 * 2.3e-16)
        refused = self.run_scene("-sweepvi_form", "box-on-z")
        self.assertEqual(refused.code, 2, refused.err)
        self.assertIn("amplifies rounding", refused.err)

    def test_gaps_are_positions_after_any_time(self):
        # A mass on a spring between two elastic walls, and two masses with a wall each: primal-dual and box on v.
        between = dict(M="[[1.0]]", K="[[2.0]]", H="[[1.0],[-1.0]]", q0="[0.1]", v0="[1.0]")
        apart = dict(M="[[1.0,0],[0,3.0]]", K="[[2.0,-0.3],[-0.3,1.0]]", H="[[0,1.0],[0.7,0]]", q0="[0.1,0.2]", v0="[1.0,-0.4]")
        for values, g0 in ((between, [0.3, 0.4]), (apart, [0.25, 0.3])):
            self.scene(BODY + f"g0 = {g0}\n[output]\nevery = 100\n", end=200.0, step=1e-2, theta=0.5, e=1.0, **values)
            done = self.run_scene()
            self.assertEqual(done.code, 0, done.err)
            H = np.array(json.loads(values["H"]))
            with h5py.File(self.folder / "out.h5") as file:
                q = file["x"][:, : H.shape[1]]
                gaps = q @ H.T + np.array(g0)
                # A gap may be carried for 16 steps, each with the rounding of a sum of terms up to 1.
                self.assertLess(np.abs(file["w"][:] - gaps).max(), 17 * 3 * 2.3e-16)
                self.assertGreater(len(file["events"]["t"]), 100)
                energy = file["energy"][:, :3].sum(axis=1)
                # Conserved but for rounding, which over 20000 steps walks at random: 5 sqrt(20000) half ulps of 1.
                self.assertLess(np.abs(energy - energy[0]).max(), 5 * math.sqrt(20000) * 1.2e-16 * 10)


if __name__ == "__main__":
    unittest.main()
