"""Runs examples/zi_tracking and holds the recorded file against the scheme's equations and the header's numbers."""
# ranks: 2

import json
import unittest
from pathlib import Path

import gallery
import h5py
import numpy as np
import program

SCENE = "examples/zi_tracking/scene.toml"
KAPPA, MU1, MU2, F, F_REF = 0.5, 30.0, 17.0, -9.81, -19.81


class ZiTracking(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.direct, cls.resampled = [example for example in gallery.examples() if example.scene == SCENE]
        folder = program.temporary_folder()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)

    def record(self, example, name, ranks=1):
        file, summary = self.folder / f"{name}.h5", self.folder / f"{name}.json"
        outcome = program.run("run", *example.words, "-o", file, "--summary", summary, cwd=program.SOURCE, ranks=ranks)
        self.assertEqual(outcome.code, 0, outcome)
        data = h5py.File(file)
        self.addCleanup(data.close)
        return data, json.loads(summary.read_text())

    def promised(self, example, *texts):
        for text in texts:
            self.assertIn(text, example.expect)

    def test_the_run_of_the_header(self):
        data, summary = self.record(self.direct, "direct")
        t, h = data["t"][:], float(data.attrs["step"])
        s, s_ref, v, v_ref = data["z"][:].T
        u, signs = data["u"][:, 0], data["lambda"][:]
        for name, names in (
            ("x", "x x_ref x' x_ref'"),
            ("z", "s s_ref v v_ref"),
            ("lambda", "lambda_s lambda_v lambda_sref lambda_vref lambda_es lambda_ev"),
            ("u", "u"),
        ):
            self.assertEqual(list(data[name].attrs["names"]), names.split())

        # The implicit scheme, HO (16)-(20) corrected, from the recorded signs. Rounding of v over h in u.
        ls, lv, lsr, lvr, les, lev = signs[1:].T
        R, R_ref = 1 - KAPPA * ls * lv, 1 - KAPPA * lsr * lvr
        g = lsr * F_REF / R_ref
        pull = g - MU1 * les - MU2 * lev
        for new, old, rate in (
            (s, s, R * v[1:]),
            (v, v, ls**2 * pull + ls * (1 - ls**2) * F / R),
            (s_ref, s_ref, R_ref * v_ref[1:]),
            (v_ref, v_ref, g),
        ):
            np.testing.assert_allclose(new[1:], old[:-1] + h * rate, rtol=0, atol=1e-13)
        np.testing.assert_allclose(u[1:], R * ls * pull - ls**2 * F, rtol=0, atol=1e-12)
        outputs = np.column_stack([s, v, s_ref, v_ref, s - s_ref, v - v_ref])[1:]
        self.assertTrue((abs(signs) <= 1).all())
        np.testing.assert_array_equal(signs[1:][outputs != 0], np.sign(outputs[outputs != 0]))

        # (x, x') from (s, v); after the impact where s = 0
        for x, velocity, a, b in ((0, 2, s, v), (1, 3, s_ref, v_ref)):
            side = np.where(a != 0, np.sign(a), np.sign(b))
            np.testing.assert_array_equal(data["x"][:, x], abs(a))
            np.testing.assert_allclose(data["x"][:, velocity], (1 - KAPPA * side * np.sign(b)) * b * side, rtol=1e-15)

        # What the header says.
        self.promised(self.direct, "from 1.225 s on", "0.689", "1.080", "139.74", "80.5", "-10", "1.226", "1.279", "1.281")
        late = t > 1.2245
        np.testing.assert_array_equal(s[late], s_ref[late])
        np.testing.assert_array_equal(v[late], v_ref[late])
        self.assertNotEqual(v[t < 1.2245][-1], v_ref[t < 1.2245][-1])
        self.assertAlmostEqual(abs(u).max(), 80.5, delta=1e-9)
        np.testing.assert_allclose(u[(t > 1.2255) & (t < 1.2795)], -10, atol=1e-6)
        rest = t > 1.2805
        for values in (s[rest], v[rest], u[rest]):
            np.testing.assert_array_equal(values, 0)
        check = program.run("check", program.SOURCE / SCENE).out
        self.assertRegex(check, r"(?m)^control +\|u\| at most 139.74 m/s\^2")
        self.assertRegex(check, r"(?m)^gains .*0 < mu2 < mu1")
        self.assertEqual(summary["unknowns"], 10)
        self.assertEqual(summary["steps"], 4000)
        self.assertLessEqual(summary["snes_iterations"], 1)

        events = data["events"][:]
        hits = [events["t"][(events["constraint"] == wall) & (events["kind"] == 0)] for wall in (0, 1)]
        np.testing.assert_allclose(hits[0][:2], [0.689, 1.080], atol=1e-9)
        speed = np.sqrt(9 + 6 * -F_REF)
        first = (3 + speed) / -F_REF
        flights = 2 * speed / -F_REF / 3.0 ** np.arange(1, 4)
        exact = first + np.array([0, *np.cumsum(flights)])
        header = (program.SOURCE / SCENE).read_text()
        for time in (*exact, first + 1.5 * flights[0]):
            self.assertIn(f"{time:.4f}", header)
        np.testing.assert_allclose(hits[1][:4], exact, atol=8e-3)  # early by a few steps, and by more after each impact
        for time in hits[1][:4]:
            self.assertIn(f"{time:.3f}", header)

    def test_resampled_on_two_ranks(self):
        self.promised(self.resampled, "1e-9", "1e-6")
        direct, _ = self.record(self.direct, "one")
        resampled, _ = self.record(self.resampled, "two", ranks=2)
        np.testing.assert_allclose(resampled["x"][:], direct["x"][:], rtol=0, atol=1e-9)
        np.testing.assert_allclose(resampled["u"][:], direct["u"][:], rtol=0, atol=1e-6)

    def test_a_regulator_is_needed(self):
        scene = self.folder / "broken.toml"
        text = (program.SOURCE / SCENE).read_text()
        scene.write_text("\n".join(line for line in text.splitlines() if not line.startswith("regulator")))
        outcome = program.run("check", scene)
        self.assertEqual(outcome.code, 2)
        self.assertIn("regulator", outcome.err)


if __name__ == "__main__":
    unittest.main()
