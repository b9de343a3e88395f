"""Sweeping scenes from end to end: sets that become empty on the way, components without bounds, many copies."""
# ranks: 1

import unittest
from pathlib import Path

import h5py
import numpy as np
import program

HEAD = '[time]\nend = 1.0\nstep = 0.0625\n[model]\nkind = "sweeping"\n'


class Sweeping(unittest.TestCase):
    def setUp(self):
        folder = program.temporary_folder()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def play(self, model, *more, ranks=1, verb="run"):
        (self.folder / "scene.toml").write_text(HEAD + model)
        words = ["-o", "out.h5", "--force", "--summary", "s.json"] if verb == "run" else []
        return program.run(verb, "scene.toml", *words, *more, ranks=ranks, cwd=self.folder)

    def read(self):
        with h5py.File(self.folder / "out.h5") as data:
            arrays = {name: data[name][:] for name in ("t", "x", "w", "mu", "level")}
            return arrays, dict(data.attrs)

    def test_a_set_that_becomes_empty_ends_the_run_there(self):
        """x + y >= 0.3 sin(2 pi t + pi), x <= 0, y <= 0: only the origin at 0.5 s, nothing from then on."""
        model = """u0 = [0, 0]
G = [[1, 1], [-1, 0], [0, -1]]
g = [{amplitude = 0.3, frequency = 1, phase = 3.141592653589793}, 0, 0]
"""
        for ranks in (1, 2):
            outcome = self.play(model, ranks=ranks)
            self.assertEqual(outcome.code, 3, outcome)
            gap = 0.3 * np.sin(np.pi / 8) / (2 + np.sqrt(2))
            message = f"step 9, t = 0.5625 s: K(t) is empty at t = 0.5625 s: faces 0, 1, 2 exclude every point, by {gap:.6g}"
            self.assertEqual(outcome.err.count(message), 1, outcome)
            arrays, attributes = self.read()
            self.assertEqual(attributes["status"], "failed")
            np.testing.assert_array_equal(arrays["t"], np.arange(9) / 16)
            summary = program.read_json(self.folder / "s.json")
            self.assertEqual((summary["exit"], summary["status"], summary["steps"]), (3, "failed", 8))
            self.assertLessEqual(summary["max_residual"], 1e-14)

    def test_components_without_bounds(self):
        """-u' in N(u) - A u - f: decay towards 1, one component free, one under a lid, one on a rising floor."""
        model = """u0 = [0, 0, 0]
A = [[-1, 0, 0], [0, -1, 0], [0, 0, -1]]
f = [1, 1, 1]
lower = [-inf, -inf, {amplitude = 2, frequency = 0.25}]
upper = [inf, 0.25, inf]
"""
        for ranks in (1, 2):
            outcome = self.play(model, ranks=ranks)
            self.assertEqual(outcome.code, 0, outcome)
            self.assertIn("2 constraints", outcome.out)
            arrays, _ = self.read()
            t, x, w, mu = arrays["t"], arrays["x"], arrays["w"], arrays["mu"][:, :, 0]
            h = 0.0625
            free = 1 - (1 + h) ** -np.arange(17)  # backward Euler
            np.testing.assert_allclose(x[:, 0], free, atol=1e-14)
            np.testing.assert_allclose(x[:, 1], np.minimum(free, 0.25), atol=1e-14)
            self.assertTrue(np.isinf(w[:, 0]).all() and (mu[:, 0] == 0).all())
            lid = free > 0.25
            self.assertTrue((x[lid, 1] == 0.25).all() and (w[lid, 1] == 0).all())
            np.testing.assert_allclose(mu[lid, 1][1:], -0.75 * h, atol=1e-15)  # it holds down what pushes up
            np.testing.assert_allclose(x[1:, 2], 2 * np.sin(np.pi / 2 * t[1:]), atol=1e-15)
            np.testing.assert_allclose(mu[1:, 2], np.diff(x[:, 2]) + h * (x[1:, 2] - 1), atol=1e-15)

    def test_many_copies(self):
        """Triangles that drag a point each, to and fro along a line, one side said twice: as one scene on two ranks and
        as single ones, to rounding."""
        count = 12
        G = -np.array([(0.0, 1.0), (-0.8, -0.5), (0.9, -0.4), (0.0, 2.0)])
        rows, g = [], []
        for i in range(count):
            way = 0.8 * np.array([np.cos(i), np.sin(i)])
            for a in G:
                row = np.zeros(2 * count)
                row[2 * i : 2 * i + 2] = a
                rows.append(str(row.tolist()))
                wave = f"amplitude = {a @ way}, frequency = 1, phase = {0.5 * i}"
                g.append(f"{{offset = {-0.3 * np.hypot(*a)}, {wave}}}")
        model = f"u0 = {[0.1] * (2 * count)}\nG = [{', '.join(rows)}]\ng = [{', '.join(g)}]\n"
        outcome = self.play(model, ranks=2)
        self.assertEqual(outcome.code, 0, outcome)
        whole, _ = self.read()
        self.assertEqual(program.read_json(self.folder / "s.json")["edge_cut"], 0)
        for i in range(count):
            single = f"u0 = [0.1, 0.1]\nG = {G.tolist()}\ng = [{', '.join(g[4 * i : 4 * i + 4])}]\n"
            self.assertEqual(self.play(single).code, 0)
            arrays, _ = self.read()
            np.testing.assert_allclose(whole["x"][:, 2 * i : 2 * i + 2], arrays["x"], atol=1e-13)
            mu = arrays["mu"][:, :, 0]
            np.testing.assert_allclose(whole["mu"][:, 4 * i : 4 * i + 4, 0], mu, atol=1e-6)  # rounding over 1e-8
            np.testing.assert_allclose(2 * mu[:, 3], mu[:, 0], atol=1e-6)  # both push alike: mu_i |G_i| is the same
            self.assertGreater(mu[:, 0].max(), 0)

    def test_check_says_what_is_solved(self):
        model = "u0 = [0, 0]\nA = [[-1, 30], [0, -1]]\nlower = [0, 0]\n"
        outcome = self.play(model, verb="check")
        self.assertEqual(outcome.code, 0, outcome)
        self.assertIn("box in 2 dimensions, 2 with bounds, standing still", outcome.out)
        self.assertIn("at most 0.875: each step has exactly one solution", outcome.out)
        self.assertIn("1 or more", self.play(model.replace("30", "40"), verb="check").out)
        outcome = self.play("u0 = [0, 0]\nG = [[1, 1]]\ng = [{amplitude = 1, frequency = 1}]\n", verb="check", ranks=2)
        self.assertIn("polyhedron of 1 face in 2 dimensions, moving", outcome.out)
        self.assertIn("3 (2 components + 1 measures)", outcome.out)


if __name__ == "__main__":
    unittest.main()
