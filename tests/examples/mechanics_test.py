"""The examples of moreau-jean: runs their headers name, held against exact solutions and balances."""
# ranks: 1
# timeout: 300

import json
import os
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

import gallery
import numpy as np
import program
from examples_test import words


class Runs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.examples = {words(example): example for example in gallery.examples()}
        folder = program.temporary_folder()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = folder.name

    def run_example(self, name, *more, **options):
        return gallery.run(self.folder, self.examples[name], *more, **options)

    def promised(self, name, *texts):
        """The numbers checked are those the header states."""
        for text in texts:
            self.assertIn(text, self.examples[name].expect)

    def bar(self, *more, folder=None):
        """Times of contact, impulse of the first, and the worst error of the foot."""
        if folder is None:
            result = self.run_example("elastic_bar/scene.toml", *more)
        else:
            scene = str(Path(folder) / "scene.toml")
            example = gallery.Example(scene, [scene, *more], 1, "")
            result = gallery.run(self.folder, example)
        exact = np.interp(result.t, [0, 1, 2, 3, 4, 5, 6], [0.5, 0, 0, 0.5, 0, 0, 0.5])
        first = result.events[result.events["t"] < 3]
        impulse = result.mu[result.t < 3, 0, 1].sum()
        begin, end = first["t"][first["kind"] == 0][0], first["t"][first["kind"] == 1][-1]
        energy = result.energy.sum(axis=1)
        self.assertLess(abs(energy - energy[0]).max(), 1e-12)
        return result, (begin, end, impulse, abs(result.w[:, 0] - exact).max())

    def made(self, masses, files=()):
        """The folder with what make.py writes; some of it held against the files of the example."""
        bar = gallery.EXAMPLES / "elastic_bar"
        folder = Path(self.folder) / f"bar{masses}"
        folder.mkdir()
        done = subprocess.run([sys.executable, bar / "make.py", str(masses), folder])
        self.assertEqual(done.returncode, 0)
        for file in files:
            self.assertEqual((folder / f"{file}.mtx").read_text(), (bar / f"{file}.mtx").read_text(), file)
        shutil.copy(bar / "scene.toml", folder)
        return folder


class Mechanics(Runs):
    def test_ball(self):
        reference = json.loads((gallery.REFERENCE / "moreau_ball.json").read_text())
        times = [float(t) for t in reference["exact"]["t"]]
        before = [float(v) for v in reference["exact"]["vminus"]]
        rest = float(reference["exact"]["zeno"])
        self.assertEqual([round(t, 6) for t in times[:3]], [0.447214, 1.162755, 1.735189])
        self.assertAlmostEqual(rest, 4.024922, delta=1e-6)

        def exact(t):
            if t >= rest or t < times[0]:
                return 0.0 if t >= rest else 1 - 5 * t * t
            i = np.searchsorted(times, t, side="right") - 1
            return -0.8 * before[i] * (t - times[i]) - 5 * (t - times[i]) ** 2

        one = np.eye(1)
        for more, variant, reach, texts in (
            ("", "A", 1.0, ("0.450 s", "4.470 s", "-1.21e-4", "-1.4e-4", "0.0202", "0.0040", "0.00073")),
            (" --set time.detection=midpoint", "C", 0.5, ("0.450 s", "4.325 s", "-1.65e-5", "-0.0080", "0.0409")),
            (" --set time.detection=current", "B", 0.0, ("0.455 s", "4.195 s", "-6.74e-6", "-0.0166", "0.0688")),
        ):
            name = "ball/scene.toml" + more
            self.promised(name, *texts)
            result = self.run_example(name)
            gallery.audit_mechanics(result, one, 0 * one, np.array([-10.0]), one, 0.0, 0.8, reach=reach)
            table = reference[f"e0.8 {variant} h=0.005"]
            q, v, t = result.x[:, 0], result.x[:, 1], result.t
            error = max(abs(q[k] - exact(t[k])) for k in range(len(t)))
            slow = t[np.flatnonzero(abs(v) > 1e-8)[-1] + 1]
            rebound = t[np.flatnonzero(v > 0)[0]]
            self.assertAlmostEqual(error, table["sup"], delta=1e-12)
            self.assertAlmostEqual(q[-1], table["qend"], delta=1e-12)
            self.assertAlmostEqual(q.min(), table["minq"], delta=1e-12)
            self.assertLess(abs(v[-1]), 1e-12)
            self.assertEqual(texts[:3], (f"{rebound:.3f} s", f"{slow:.3f} s", f"{q[-1]:.2e}".replace("e-0", "e-")))
            for found, text in ((q.min(), texts[3]), (error, texts[4])):
                self.assertAlmostEqual(found, float(text), delta=0.51 * 10 ** -4)
            self.assertAlmostEqual(result.energy[0].sum(), 10)
        for step, text in (("1e-3", "0.0040"), ("2e-4", "0.00073")):
            result = self.run_example("ball/scene.toml", "--set", f"time.step={step}")
            error = max(abs(result.x[k, 0] - exact(result.t[k])) for k in range(len(result.t)))
            self.assertEqual(f"{error:.2g}", f"{float(text):.2g}")

    def test_newtons_cradle(self):
        M, K = np.eye(5), 9.81 * np.eye(5)
        H = np.diff(np.eye(5), axis=0)
        speed = 0.1 * np.sqrt(9.81)
        self.assertAlmostEqual(speed, 0.3132, delta=5e-5)
        hit = np.pi / 2 / np.sqrt(9.81)
        self.assertAlmostEqual(hit, 0.5015, delta=5e-5)

        name = "newtons_cradle/touching.toml"
        self.promised(name, "(-0.6, 0.4, 0.4, 0.4, 0.4) v", "(8, 6, 4, 2)/5 v", "1.003 s", "(-1, 0, 0, 0, 0) v")
        result = self.run_example(name)
        gallery.audit_mechanics(result, M, K, np.zeros(5), H, 0.0, 1.0)
        impacts = result.impacts()
        self.assertEqual(list(impacts["constraint"]), [0, 0])
        self.assertAlmostEqual(impacts["t"][1] - impacts["t"][0], np.pi / np.sqrt(9.81), delta=2 * result.h)
        first, second = np.rint(impacts["t"] / result.h).astype(int)
        self.assertLessEqual(abs(impacts["t"][0] - hit), 2 * result.h)
        v = result.x[:, 5:] / speed
        # Where the contact is found, up to a step late, the first ball has lost h^2 of its speed.
        np.testing.assert_allclose(v[first], [-0.6, 0.4, 0.4, 0.4, 0.4], atol=1e-4)
        np.testing.assert_allclose(result.mu[first, :, 1] / speed, [1.6, 1.2, 0.8, 0.4], atol=1e-3)
        np.testing.assert_allclose(v[second], [-1, 0, 0, 0, 0], atol=5e-3)
        self.assertAlmostEqual(result.energy[0].sum(), 0.04905)
        self.assertLess(abs(result.energy[:, 2]).max(), 1e-14)

        name = "newtons_cradle/apart.toml"
        self.promised(name, "0.505, 0.508, 0.511, 0.514 s", "0.1 %", "8 in 2 s")
        result = self.run_example(name)
        gallery.audit_mechanics(result, M, K, np.zeros(5), H, 1e-3, 1.0)
        impacts = result.impacts()
        self.assertEqual(list(impacts["constraint"]), [0, 1, 2, 3, 3, 2, 1, 0])
        np.testing.assert_allclose(impacts["t"][:4], [0.505, 0.508, 0.511, 0.514])
        np.testing.assert_allclose(impacts["impulse"][:4], speed, rtol=1e-3)
        k = int(round(0.514 / result.h))
        np.testing.assert_allclose(result.x[k, 5:] / speed, [0, 0, 0, 0, 1], atol=1e-3)
        self.assertAlmostEqual(result.energy[0].sum(), 0.04905)

    def test_bouncing_column(self):
        name = (
            "falling_column/scene.toml --set model.count=200 --set time.end=12 --set time.scheme=moreau-jean"
            " --set time.theta=0.5 --set model.e=0.5"
        )
        self.promised(name, "853 impacts", "9.3 s", "2400", "1181.3 of 20915 J", "0.03 below 0")
        result = self.run_example(name)
        n = 200
        H = np.eye(n) - np.eye(n, k=-1)
        g0 = np.r_[0.0, np.full(n - 1, -1.0)]
        # Heights are up to 200: rounding of 1e-14 in q, and 1200 steps of it in gaps carried along.
        gallery.audit_mechanics(result, np.eye(n), np.zeros((n, n)), -np.ones(n), H, g0, 0.5, tolerance=1e-11)
        self.assertEqual(len(result.impacts()), 853)
        self.assertLess(abs(result.x[result.t >= 9.3][:, n:]).max(), 1e-6)
        self.assertAlmostEqual(result.mu[:, 0, 1].sum(), 2400, delta=1e-9)
        self.assertAlmostEqual(result.energy[-1, 2], 1181.3, delta=0.05)
        self.assertAlmostEqual(result.energy[0].sum(), 20915)
        self.assertAlmostEqual(result.w[-1].min(), -0.03, delta=0.001)

    def test_elastic_bar(self):
        name = "elastic_bar/scene.toml"
        self.promised(name, "1.005 s to 2.015 s", "4.010 s", "0.4929", "0.018")
        result, found = self.bar()
        np.testing.assert_allclose(found, [1.005, 2.015, 0.4929, 0.018], atol=5.1e-5)
        self.assertEqual([round(t, 3) for t in result.impacts()["t"]], [1.005, 4.010])
        # The foot's own mass, 1/400, stops twice: m v^2 / 2, v = 1/2 but for the waves of the mesh.
        self.assertAlmostEqual(result.energy[-1, 2], 2 * 0.5 / 400 * 0.25, delta=1e-4)
        self.assertAlmostEqual(result.energy[0, 1], 0.125, delta=1e-12)

        # The files are what make.py writes; with fewer masses contact and impulse are further from 1, 2, 1/2.
        self.made(200, files=("M", "K", "H", "q0", "v0"))
        _, coarse = self.bar("--set", "time.step=1e-2", folder=self.made(100))
        np.testing.assert_allclose(coarse, [1.01, 2.03, 0.4883, 0.029], atol=5.1e-4)  # README.md
        self.assertGreater(max(coarse[0] - 1, coarse[1] - 2), 1.5 * max(found[0] - 1, found[1] - 2))
        self.assertGreater(0.5 - coarse[2], 1.5 * (0.5 - found[2]))


class PendulumWalls(unittest.TestCase):
    EXAMPLE = Path(os.environ["SWEEPVI_BUILD"]) / "examples" / "example_pendulum_walls"
    CART, BOB, LENGTH, GRAVITY, STIFFNESS, WALL, E = 2.0, 1.0, 1.0, 9.81, 20.0, 0.3, 0.8  # its defaults

    def output(self, *words, ranks=1):
        command = [str(self.EXAMPLE), *words]
        if ranks > 1:
            command = ["mpiexec", "--oversubscribe", "-n", str(ranks), *command]
        environment = {**os.environ, **program.ENVIRONMENT}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=200)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        lines = done.stdout.splitlines()
        table = np.array([[float(word) for word in line.split()] for line in lines[2:-1]])
        return float(lines[0].split(":")[1]), table, lines[-1]

    def rates(self, y):
        x, phi, dx, turn = y
        mixed = self.BOB * self.LENGTH * np.cos(phi)
        M = [[self.CART + self.BOB, mixed], [mixed, self.BOB * self.LENGTH**2]]
        pull = self.BOB * self.LENGTH * turn**2 * np.sin(phi) - 2 * self.STIFFNESS * x
        a = np.linalg.solve(M, [pull, -self.BOB * self.GRAVITY * self.LENGTH * np.sin(phi)])
        return np.array([dx, turn, *a])

    def advance(self, y, h):
        a = self.rates(y)
        b = self.rates(y + 0.5 * h * a)
        c = self.rates(y + 0.5 * h * b)
        return y + h / 6 * (a + 2 * b + 2 * c + self.rates(y + h * c))

    def exact(self, ends, h=1e-3):
        """A single cart: Runge-Kutta steps, impacts found inside them. Times of impact, and states at `ends`."""
        y, t, impacts, states = np.array([0.0, 0.25, 0.0, 2.0]), 0.0, [], []
        gap = lambda y, side: self.WALL - side * (y[0] + self.LENGTH * np.sin(y[1]))
        for end in ends:
            while t < end - 1e-12:
                step = min(h, end - t)
                new = self.advance(y, step)
                side = next((s for s in (1, -1) if gap(new, s) < 0), 0)
                if side == 0:
                    y, t = new, t + step
                    continue
                low, high = 0.0, step
                for _ in range(60):
                    middle = 0.5 * (low + high)
                    low, high = (middle, high) if gap(self.advance(y, middle), side) > 0 else (low, middle)
                y, t = self.advance(y, low), t + low
                impacts.append(t)
                mixed = self.BOB * self.LENGTH * np.cos(y[1])
                M = np.array([[self.CART + self.BOB, mixed], [mixed, self.BOB * self.LENGTH**2]])
                H = -side * np.array([1.0, self.LENGTH * np.cos(y[1])])
                push = np.linalg.solve(M, H)
                y[2:] -= push * (1 + self.E) * (H @ y[2:]) / (H @ push)
            states.append(y.copy())
        return impacts, np.array(states)

    def test_one_cart_against_an_event_driven_solution(self):
        header = (gallery.EXAMPLES / "pendulum_walls/main.cpp").read_text()
        impacts, states = self.exact([1.0, 2.0, 5.0])
        self.assertEqual(len(impacts), 7)
        for text in ("7 impacts", f"{impacts[0]:.6f} s", f"{states[2, 1]:.6f} at 5 s"):
            self.assertIn(text, header)
        errors, balances = [], []
        for per_second, promised in ((100, "0.0251"), (1000, "0.00311")):
            derivatives, table, last = self.output("-steps_per_second", str(per_second))
            self.assertLess(derivatives, 1e-6)
            self.assertTrue(last.startswith("7 impacts, "))
            self.assertTrue(last.endswith("worst penetration 0.00e+00"))
            errors.append(abs(table[-1, 2] - states[2, 1]))
            balances.append(abs(table[:, 6]).max())
            self.assertIn(promised, header)
            self.assertAlmostEqual(errors[-1], float(promised), delta=0.02 * float(promised))
            self.assertAlmostEqual(table[-1, 5], 1.70, delta=0.01)
            self.assertAlmostEqual(table[0, 3:6].sum(), 2.31, delta=0.01)
        self.assertAlmostEqual(np.log10(errors[0] / errors[1]), 1, delta=0.2)
        np.testing.assert_allclose(balances, [8e-4, 8e-5], rtol=0.07)
        free = [
            abs(self.output("-wall", "10", "-seconds", "1", "-steps_per_second", n)[1][:, 6]).max() for n in ("100", "200")
        ]
        self.assertAlmostEqual(np.log2(free[0] / free[1]), 2, delta=0.2)

    def test_ranks_and_differences(self):
        row = ("-count", "7", "-seconds", "1")
        _, alone, _ = self.output(*row)
        _, two, _ = self.output(*row, ranks=2)
        np.testing.assert_allclose(two[:, :6], alone[:, :6], atol=1e-8)  # printed to eight digits
        _, differences, _ = self.output(*row, "-finite_differences")
        np.testing.assert_allclose(differences[:, :6], alone[:, :6], atol=1e-8)


if __name__ == "__main__":
    unittest.main()
