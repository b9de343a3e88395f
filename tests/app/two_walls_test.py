# ranks: 1
# timeout: 240
"""One two-sided constraint and two opposite rows are the same motion, and each row is told in its own terms."""

import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program
from in_folder import InFolder

S, T = 2.5, 0.3  # row b reads -S times what row a reads; its input is -T times that of row a. S is not 1 / T, which measures scale by.
STEPS, END = 240, 12.0
H = END / STEPS


def toml(matrix):
    return str(np.asarray(matrix, dtype=float).tolist())


def scene(system, rows, walls):
    """`rows`: constraints as (C row, B column, w0)."""
    C = [row[0] for row in rows]
    B = np.column_stack([row[1] for row in rows])
    return f"""[time]
end = {END}
step = {H}
[model]
kind = "linear"
A = {toml(system["A"])}
B = {toml(B)}
C = {toml(C)}
f = {system["f"]}
x0 = {toml(system["x0"])}
w0 = {toml([row[2] for row in rows])}
{"" if walls is None else f"wmax = {walls}"}
"""


def system_of(r):
    """The two driven copies that each scene holds, as one of them: r = 1, 2, 3, 4; walls at 0 and L."""
    wave = "{offset = 0.5, amplitude = 3.0, frequency = 0.2}"
    return {
        1: {"A": [[-0.2]], "b": [2.0], "c": [1.0], "f": [wave], "x0": [0.4], "L": 1.0, "M": 2.0},
        2: {"A": [[0, 1], [-0.4, -0.2]], "b": [0, 1.5], "c": [1, 0], "f": ["0", wave], "x0": [0.4, 0], "L": 0.8, "M": 1.5},
        3: {
            "A": [[0, 1, 0, 0], [0, 0, 1, 0], [-1, -1, -1, 0.5], [1, 0, 0, -1]],
            "b": [0, 0, 1, 0],
            "c": [1, 0, 0, 0],
            "f": ["0", "0", wave, "0"],
            "x0": [0.5, 0, 0, 0],
            "L": 1.0,
            "M": 1.0,
        },
        4: {
            "A": [[0, 0, 1, 0], [0, 0, 0, 1], [-11, 10, -0.5, 0], [10, -10, 0, -0.5]],
            "b": [0, 0, 0, 0.5],
            "c": [1, 0, 0, 0],
            "f": ["0", "0", wave, "0"],
            "x0": [0.4, 0.4, 0, 0],
            "L": 1.0,
            "M": 5.0,
        },
    }[r]


def pair(r):
    """The system twice, weakly coupled in the zero-th state of each other (at the top level), with other inputs."""
    one = system_of(r)
    A, n = np.array(one["A"], dtype=float), len(one["x0"])
    both = {"A": np.kron(np.eye(2), A), "n": n, "L": [one["L"], 0.7 * one["L"]], "M": [one["M"]] * 2}
    top = {1: 0, 2: 1, 3: 2, 4: 2}[r]
    both["A"][top, n] = both["A"][n + top, 0] = 0.1
    both["f"] = "[" + ", ".join(one["f"] + [f.replace("0.2}", "0.15, phase = 1.0}") for f in one["f"]]) + "]"
    both["x0"] = np.concatenate([one["x0"], one["x0"]])
    unit = np.eye(2)
    both["c"] = [np.kron(unit[i], one["c"]) for i in range(2)]
    both["b"] = [np.kron(unit[i], one["b"]) for i in range(2)]
    return both


class TwoWalls(InFolder):
    def runs(self, r, ranks, *words):
        both = pair(r)
        offset = 0.05  # of row a
        a = [(both["c"][i], both["b"][i], offset) for i in range(2)]
        b = [(-S * both["c"][i], -T * both["b"][i], S * (both["L"][i] - offset)) for i in range(2)]
        two_sided = self.simulate(scene(both, a, both["L"]), *words, name=f"one{ranks}", ranks=ranks)
        # In the order (0, 1, opposite of 1, opposite of 0): partners are apart.
        opposite = self.simulate(scene(both, [a[0], a[1], b[1], b[0]], None), *words, name=f"two{ranks}", ranks=ranks)
        return both, two_sided, opposite

    def judge(self, r, ranks, *words):
        both, (one, _, one_summary), (two, _, two_summary) = self.runs(r, ranks, *words)
        self.assertEqual(one_summary["unknowns"], two_summary["unknowns"])
        self.assertEqual(two_summary["constraints"], 4, "four rows of the scene")
        # The same equations up to the rounding of L = (w0 + ...) / S: 240 steps on values of size 1 (r = 4: 50).
        close = lambda found, expected, text: np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10, err_msg=text)
        close(two["x"], one["x"], "x")
        side = np.zeros((STEPS, 2))  # where each step began
        for i, row in ((0, 3), (1, 2)):  # constraint, its opposite row
            L = both["L"][i]
            close(two["w"][:, i], one["w"][:, i], "w of row a")
            close(two["w"][:, row], S * (L - one["w"][:, i]), "w of row b")
            z = one["z"].reshape(STEPS + 1, 2, r)[:, i]
            rows = two["z"].reshape(STEPS + 1, 4, r)
            close(rows[:, i], z, "z of row a")
            close(rows[:, row], S * (np.eye(r)[0] * L - z), "z of row b")
            mu = one["mu"][:, i]
            scale = np.full(r, S)
            scale[-1] = 1.0 / T
            close(two["mu"][:, i], np.maximum(mu, 0.0), "mu of row a")
            close(two["mu"][:, row], scale * np.maximum(-mu, 0.0), "mu of row b")
            self.assertGreater(two["mu"][:, i, -1].max(), 0.01, "row a is at work")
            self.assertGreater(two["mu"][:, row, -1].max(), 0.01, "row b is at work")

            side[:, i] = np.where(one["w"][:-1, i] <= 0.0, 1, np.where(one["w"][:-1, i] >= L, -1, 0))
            level = one["level"][1:, i]
            np.testing.assert_array_equal(two["level"][1:, i], np.where(side[:, i] < 0, 1, level))
            np.testing.assert_array_equal(two["level"][1:, row], np.where(side[:, i] > 0, 1, level))
        self.balance(both, two, r)
        self.events(one, two, r, side)

    def balance(self, both, two, r):
        """The step itself, from the rows as the file has them: what moved x is h (A x + f), inputs times measures of
        level r, and nothing else where no lower level acts. (r <= 2: f needs no completing.)"""
        if r > 2:
            return
        x, mu = two["x"], two["mu"]
        n = both["n"]
        t = two["t"][1:]
        wave = lambda frequency, phase: 0.5 + 3.0 * np.sin(2 * np.pi * frequency * t + phase)
        f = np.zeros((STEPS, 2 * n))
        f[:, n - 1], f[:, 2 * n - 1] = wave(0.2, 0.0), wave(0.15, 1.0)
        moved = x[1:] - x[:-1] - H * (x[1:] @ both["A"].T + f)
        inputs = np.column_stack([both["b"][0], both["b"][1], -T * both["b"][1], -T * both["b"][0]])
        alone = (mu[1:, :, :-1] == 0.0).all(axis=(1, 2))
        self.assertGreater(alone.sum(), STEPS // 2)
        pushed = mu[1:, :, -1] @ inputs.T
        np.testing.assert_allclose(moved[alone], pushed[alone], rtol=0, atol=1e-12, err_msg="B mu")
        self.assertGreater(np.abs(pushed[alone]).max(), 0.01)

    def events(self, one, two, r, side):
        """Those of the two-sided constraint, told by the row whose wall it was, with that row's impulse."""
        partner = {0: 3, 1: 2}

        def expected(event):
            i, level = int(event["constraint"]), int(event["level"])
            step = round(event["t"] / H) - 1
            began, ended = side[step, i], np.sign(event["impulse"])
            impact = event["kind"] == two_kind["impact"]
            upper = (ended < 0) if impact and event["impulse"] != 0.0 else began < 0
            scale = (1.0 / T if level == r else S) if upper else 1.0
            return (round(event["t"] / H), partner[i] if upper else i, level, int(event["kind"]), scale * abs(event["impulse"]))

        kinds = sorted(set(int(kind) for kind in one["events"]["kind"]))
        self.assertEqual(len(kinds), 2, "impacts and lift-offs")
        lift_off = next(int(e["kind"]) for e in one["events"] if e["impulse"] == 0.0)
        two_kind = {"impact": next(kind for kind in kinds if kind != lift_off)}
        want = sorted(expected(event) for event in one["events"])
        found = sorted(
            (round(e["t"] / H), int(e["constraint"]), int(e["level"]), int(e["kind"]), float(e["impulse"]))
            for e in two["events"]
        )
        self.assertEqual([e[:4] for e in found], [e[:4] for e in want])
        np.testing.assert_allclose([e[4] for e in found], [e[4] for e in want], rtol=0, atol=1e-10)
        self.assertEqual({e[1] for e in found}, {0, 1, 2, 3}, "every row has events")

    def test_all_degrees(self):
        # Two copies on three ranks: one rank owns nothing, and partners are two ranks apart.
        for r, ranks in ((1, 1), (2, 1), (3, 1), (4, 1), (1, 2), (3, 2), (2, 3)):
            with self.subTest(r=r, ranks=ranks):
                self.judge(r, ranks)

    def test_primal_dual(self):
        for r, ranks in ((2, 1), (3, 1), (4, 2)):
            with self.subTest(r=r, ranks=ranks):
                self.judge(r, ranks, "-sweepvi_form", "primal-dual")


if __name__ == "__main__":
    unittest.main()
