"""Installs the library, builds examples/own_system against it as a user would, and checks what it prints."""
# ranks: 2
# labels: no-sanitize
# timeout: 300

import os
import shlex
import subprocess
import sys
import unittest
from itertools import combinations
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

K, END = 10.0, 5.0  # stiffness and final time of the example


def force(t, order=0):
    """The order-th derivative of f."""
    omega = np.pi / 2
    return (-1.0 if order == 0 else 0.0) + 0.5 * omega**order * np.sin(omega * t + order * np.pi / 2)


def homsp(steps):
    """The example's scheme (README, "Many constraints"; AB (32)-(45)) for its z = (w, w', w'', w'''), r = n = 4, each
    step's complementarity problem by trying all sets of held outputs, the largest first."""
    h = END / steps
    # w' = q', w'' = k (p - q) - q + f, w''' = k (p' - q') - q' + f'; rows on (q, q', p, p')
    W = np.array([[1, 0, 0, 0], [0, 1, 0, 0], [-K - 1, 0, K, 0], [0, -K - 1, 0, K]])
    A = np.array([[0, 1, 0, 0], [-K - 1, 0, K, 0], [0, 0, 0, 1], [K, 0, -K, 0]])
    last = W[3] @ A @ np.linalg.inv(W)  # (w''' - f')' = last (z - g) - (k + 1) f + k lambda
    offset = lambda t: np.array([0, 0, force(t), force(t, 1)])
    implicit = np.eye(4) - h * np.eye(4, k=1)
    implicit[3] -= h * last
    input_of_mu = np.diag([1, 1, 1, K])
    z = W @ [0.5, 0, 0.5, 0] + offset(0.0)
    table = []
    for k in range(steps):
        level = 1
        while level < 4 and z[level - 1] <= 0:
            level += 1
        t = (k + 1) * h
        known = z.copy()
        known[3] += force(t, 1) - force(k * h, 1) - h * (last @ offset(t)) - h * (K + 1) * force(t)
        for held in (set(c) for size in range(level, -1, -1) for c in combinations(range(level), size)):
            system = implicit.copy()
            for i in held:  # unknown i is mu_i instead of z_i = 0
                system[:, i] = -input_of_mu[:, i]
            u = np.linalg.solve(system, known)
            if all(u[i] >= -1e-12 * abs(known).max() for i in range(level)):
                break
        else:
            raise AssertionError(f"step {k + 1}: no solution")
        z, mu = u.copy(), np.zeros(4)
        for i in held:
            z[i], mu[i] = 0, u[i]
        table.append((t, z[0], level, *mu))
    return np.array(table), np.linalg.solve(W, z - offset(END))


def printed(text):
    """The table and the end state the example prints."""
    lines = text.splitlines()
    numbers = [[float(word) for word in line.split()] for line in lines if line[:1] == " " and "mu_1" not in line]
    end = next(line for line in lines if line.startswith("end")).split()[1:]
    return np.array(numbers), np.array(end, dtype=float)


class OwnSystem(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        folder = program.temporary_folder()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = Path(folder.name)
        cls.prefix = cls.folder / "prefix"
        cls.call("cmake", "--install", os.environ["SWEEPVI_BUILD"], "--prefix", cls.prefix)

    @staticmethod
    def call(*command, **environment):
        result = subprocess.run(list(map(str, command)), env={**os.environ, **environment}, capture_output=True, text=True,
                                timeout=200)  # fmt: skip
        if result.returncode != 0:
            raise AssertionError(f"{command}: exit {result.returncode}\n{result.stdout}\n{result.stderr}")
        return result.stdout

    def check(self, executable, ranks, per_second):
        """Compares with our own computation; returns the times of the two impacts."""
        launcher = ["mpiexec", "--oversubscribe", "-n", ranks] if ranks > 1 else []
        out = self.call(*launcher, executable, "-steps_per_second", per_second, **program.ENVIRONMENT)
        self.assertIn("relative degree 4", out)
        table, end = printed(out)
        wanted, end_wanted = homsp(int(END) * per_second)
        for row in table:
            match = wanted[abs(wanted[:, 0] - row[0]) < 0.6e-3]
            # Printed with six digits, t with three: one of the steps that print alike.
            self.assertTrue((abs(match - row) <= [6e-4, *[1e-5 * abs(v) + 1e-12 for v in row[1:]]]).all(axis=1).any(), row)
        events = {round(t, 9) for t, *_ in wanted[(wanted[:, 4] > 0)]}  # mu_2 acts in the impacts only
        self.assertEqual(len(events), 2)
        self.assertEqual(np.count_nonzero(table[:, 4] > 0), 2)
        np.testing.assert_allclose(end, end_wanted, atol=1e-13)
        np.testing.assert_allclose(end, [0, 0, 0.05, 0], atol=1e-13)  # p = -f(5) / k, in a held position
        mu_4 = table[-1, 6]
        self.assertAlmostEqual(mu_4 * per_second, -force(END, 2) / K - force(END), delta=2.0 / per_second)
        return table[table[:, 3] > 0, 0]

    def test_with_cmake_on_one_and_two_ranks(self):
        build = self.folder / "build"
        self.call("cmake", "-S", program.SOURCE / "examples" / "own_system", "-B", build,
                  f"-DCMAKE_PREFIX_PATH={self.prefix}")  # fmt: skip
        self.call("cmake", "--build", build)
        cache = (build / "CMakeCache.txt").read_text()
        self.assertIn(str(self.prefix), next(line for line in cache.splitlines() if line.startswith("sweepvi_DIR")))
        for ranks in (1, 2):
            for per_second, early in ((100, 0.1), (1000, 0.015)):
                with self.subTest(ranks=ranks, per_second=per_second):
                    bounce, stay = self.check(build / "own_system", ranks, per_second)
                    for found, exact in ((bounce, 1.390600), (stay, 1.734852)):
                        self.assertLess(found, exact + 1 / per_second)
                        self.assertGreater(found, exact - early)

    def test_with_pkg_config(self):
        pc = next(self.prefix.rglob("sweepvi.pc")).parent
        path = os.pathsep.join(filter(None, [str(pc), os.environ.get("PKG_CONFIG_PATH")]))
        flags = shlex.split(self.call("pkg-config", "--cflags", "--libs", "sweepvi", PKG_CONFIG_PATH=path))
        executable = self.folder / "with_pkg_config"
        self.call("g++", "-std=c++20", program.SOURCE / "examples/own_system/main.cpp", "-o", executable, *flags,
                  f"-Wl,-rpath,{pc.parent}")  # fmt: skip
        self.check(executable, 1, 100)


if __name__ == "__main__":
    unittest.main()
