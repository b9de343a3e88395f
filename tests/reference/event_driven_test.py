# ranks: 1
"""The event-driven program against solutions of another one, stored here: states to their 17 digits, all events."""

import json
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "hard"))
from decimals import Decimal
from event_driven import IMPACT, EventDriven, Grazing
from linear_system import LinearSystem
from scenes import integrators, jerk_matrices, paper65

FOLDER = Path(__file__).resolve().parent


def flexible(count):
    """Chain of `flexible` elements with its defaults, coupling 1; states q, p, q', p' element by element."""
    n = 4 * count
    A, B, C = ([[0.0] * columns for _ in range(rows)] for rows, columns in ((n, n), (n, count), (count, n)))
    for i in range(count):
        q, p, v, u = range(4 * i, 4 * i + 4)
        A[q][v] = A[p][u] = B[u][i] = C[i][q] = 1.0
        A[v][q], A[v][p], A[u][q], A[u][p] = -13.0, 10.0, 10.0, -10.0  # two springs of 1 and the ground's
        for j in {i - 1, i + 1} & {*range(count)}:
            A[v][4 * j] = 1.0
    f = [-1.0 if i % 4 == 2 else 0.0 for i in range(n)]
    return {"A": A, "B": B, "C": C, "f": f, "x0": [v for i in range(count) for v in [0.5 + 0.1 * (i % 3)] * 2 + [0.0, 0.0]]}


class Stored(unittest.TestCase):
    def check_events(self, name, found):
        expected = [e for e in json.loads((FOLDER / f"{name}_events.json").read_text())["events"] if e["kind"] == "impact"]
        found = [(t, a) for t, a, kind in found if kind == IMPACT]
        self.assertEqual([a for _, a in found], [e["site"] for e in expected])
        for (t, _), e in zip(found, expected):
            self.assertLess(abs(t - Decimal(e["t"])), Decimal("1e-15"))  # their data were not rounded to doubles

    def test_jerk_chains(self):
        for count in (2, 3):
            with self.subTest(count):
                solution = EventDriven(LinearSystem(**jerk_matrices(count, 0.5))).run(Decimal(10), [Decimal(10)])
                self.check_events(f"jerk_chain_N{count}", solution.events)
                last = (FOLDER / f"jerk_chain_N{count}.csv").read_text().split()[-1].split(",")[1:]
                for mine, stored in zip(solution.x[-1], last):
                    self.assertLess(abs(mine - Decimal(stored)), Decimal("1e-15"))  # 17 digits of numbers up to 3

    def test_flexible_chains(self):
        """Measures of four levels; impacts that shrink super-linearly."""
        for count in (1, 2):
            with self.subTest(count):
                solution = EventDriven(LinearSystem(**flexible(count))).run(Decimal(5), [Decimal(5)])
                self.check_events(f"flexible_N{count}", solution.events)

    def test_paper65(self):
        model = {key: value for key, value in paper65().items() if key != "kind"}
        solution = EventDriven(LinearSystem(**model)).run(Decimal(10), [Decimal(10)])
        self.assertLess(abs(solution.events[1][0] - Decimal("6.199615848871525286")), Decimal("1e-18"))
        self.assertLess(abs(solution.x[-1][0] - Decimal("2.038074313834594676")), Decimal("1e-18"))


class ClosedForms(unittest.TestCase):
    def solve(self, end, **model):
        return EventDriven(LinearSystem(**model)).run(Decimal(end), [Decimal(end)])

    def test_two_walls(self):
        """x'' = 2 from 0 at rest meets the wall at 1 at t = 1 and stays; it would come back with a force of -2."""
        model = {key: v for key, v in integrators(2, [0.0, 0.0], 2.0, wmax=[1.0]).items() if key != "kind"}
        solution = self.solve(3, **model)
        self.assertEqual([(round(t, 40), a, kind) for t, a, kind in solution.events], [(1, 0, IMPACT)])
        self.assertEqual([round(v, 40) for v in solution.x[-1]], [1, 0])

    def test_degree_zero(self):
        """w = sin(pi t) + lambda: lambda = max(0, -w at lambda = 0) begins at 1, ends at 2; x' = lambda gains 2/pi."""
        wave = {"amplitude": 3.141592653589793, "frequency": 0.5, "phase": 1.5707963267948966}
        solution = self.solve(2.5, A=[[0, 0], [0, 0]], B=[[0], [1]], C=[[1, 0]], D=[[1]], x0=[0, 0], f=[wave, 0])
        self.assertEqual([kind for *_, kind in solution.events], ["impact", "lift-off"])
        for (t, *_), exact in zip(solution.events, (1.0, 2.0)):
            self.assertAlmostEqual(float(t), exact, places=14)  # pi, as a double
        self.assertAlmostEqual(float(solution.x[-1][1]), 2 / 3.141592653589793, places=14)

    def test_grazing(self):
        """w = 1 - cos t touches 0 at 2 pi without meeting it."""
        with self.assertRaises(Grazing):
            self.solve(7, A=[[0, 1], [-1, 0]], B=[[0], [1]], C=[[1, 0]], w0=[1.0], x0=[-1, 0])


if __name__ == "__main__":
    unittest.main()
