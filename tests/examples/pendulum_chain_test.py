"""Runs examples/pendulum_chain and holds its one pendulum against an event-driven solution of its own."""
# ranks: 2
# timeout: 240

import os
import subprocess
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

G, K, MOTOR, TORQUE = 9.81, 10.0, 10.0, -1.0  # the example's defaults
IMPACT, W_AT_1 = 0.578894, 0.168121  # as the example's header says
EXAMPLE = Path(os.environ["SWEEPVI_BUILD"]) / "examples" / "example_pendulum_chain"


def physical(y):
    """Link q and motor p in free flight, y = (q, p, q', p')."""
    q, p, dq, dp = y
    return np.array([dq, dp, -G * np.sin(q) + K * (p - q), MOTOR * (q - p) + TORQUE])


def advance(y, h):
    a = physical(y)
    b = physical(y + 0.5 * h * a)
    c = physical(y + 0.5 * h * b)
    d = physical(y + h * c)
    return y + h / 6 * (a + 2 * b + 2 * c + d)


def outputs(y):
    q, p, dq, dp = y
    return np.array([q, dq, -G * np.sin(q) + K * (p - q), -G * np.cos(q) * dq + K * (dp - dq)])


def state(z):
    p = z[0] + (z[2] + G * np.sin(z[0])) / K
    dp = z[1] + (z[3] + G * np.cos(z[0]) * z[1]) / K
    return np.array([z[0], p, z[1], dp])


def exact(end, h=1e-4):
    """w at `end` and the first impact: fourth-order steps, the impact found inside its step. An impact takes the
    velocity, and a negative acceleration, and then a negative z_4: levels 2, 3, 4."""
    y, t, impact = np.array([0.5, 0.5, 0.0, 0.0]), 0.0, None
    while t < end - 1e-12:
        step = min(h, end - t)
        new = advance(y, step)
        if new[0] < 0.0 and impact is None:
            low, high = 0.0, step
            for _ in range(60):
                middle = 0.5 * (low + high)
                low, high = (middle, high) if advance(y, middle)[0] > 0.0 else (low, middle)
            y, t = advance(y, low), t + low
            impact = t
            z = outputs(y)
            z[0] = 0.0
            for i in (1, 2, 3):
                if z[i] > 0.0:
                    break  # leaves by itself
                z[i] = 0.0
            y = state(z)
            continue
        y, t = new, t + step
    return y[0], impact


class PendulumChain(unittest.TestCase):
    def output(self, *words, ranks=1):
        command = [str(EXAMPLE), *words]
        if ranks > 1:
            command = ["mpiexec", "--oversubscribe", "-n", str(ranks), *command]
        done = subprocess.run(command, env={**os.environ, **program.ENVIRONMENT}, capture_output=True, text=True,
                              timeout=200)
        self.assertEqual(done.returncode, 0, done.stdout + done.stderr)
        lines = done.stdout.splitlines()
        jacobian_error = float(lines[0].split(":")[1])
        table = np.array([[float(word) for word in line.split()] for line in lines[2:-1]])
        return jacobian_error, table

    def test_first_order(self):
        w, impact = exact(1.0)
        errors = {}
        for per_second in (100, 1000):
            jacobian_error, table = self.output("-steps_per_second", str(per_second))
            self.assertLess(jacobian_error, 1e-7)  # forward differences
            errors[per_second] = abs(table[np.isclose(table[:, 0], 1.0), 1][0] - w)
        self.assertAlmostEqual(impact, IMPACT, delta=1e-6)
        self.assertAlmostEqual(w, W_AT_1, delta=1e-6)
        self.assertAlmostEqual(np.log10(errors[100] / errors[1000]), 1.0, delta=0.1)
        self.assertLess(errors[1000], 0.004)

    def test_ranks_and_differences(self):
        _, alone = self.output("-count", "7")
        _, two = self.output("-count", "7", ranks=2)
        np.testing.assert_allclose(two, alone, atol=1e-9)  # printed to ten digits
        _, differences = self.output("-count", "7", "-finite_differences")
        np.testing.assert_allclose(differences, alone, atol=1e-6)  # jumps of neighbours are known to 1e-7


if __name__ == "__main__":
    unittest.main()
