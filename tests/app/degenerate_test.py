# ranks: 1
# timeout: 240
"""`sweepvi solve` on degenerate monotone problems beyond the size that pivoting takes: linear programs, dependent rows,
obstacle problems. Judged by the natural residual, added up by numpy, and by the optimal value that HiGHS (scipy) finds."""

import unittest
from pathlib import Path

import h5py
import numpy as np
import program
import scipy.io
import scipy.sparse as sp
from scipy.optimize import linprog

INFINITY = np.inf
CERTIFICATE = 1e-10  # worst natural residual over row terms, the program's default
FREE = -INFINITY


class Problem:
    """M u + q against u in [lower, upper]."""

    def __init__(self, M, q, lower=0.0, upper=INFINITY):
        self.M, self.q = sp.csr_matrix(M), np.asarray(q, float)
        self.lower, self.upper = (np.broadcast_to(bound, self.q.shape) for bound in (lower, upper))

    def solve(self, ranks=1, options=()):
        """(u, summary), after what holds for any solution was asserted."""
        with program.temporary_folder() as name:
            folder = Path(name)
            scipy.io.mmwrite(folder / "M.mtx", sp.coo_matrix(self.M), precision=17)
            with h5py.File(folder / "data.h5", "w") as file:
                file["q"], file["lower"], file["upper"] = self.q, self.lower, self.upper
            vectors = "".join(f'{key} = {{file = "data.h5", dataset = "/{key}"}}\n' for key in ("q", "lower", "upper"))
            (folder / "problem.toml").write_text(f'[problem]\nM = "M.mtx"\n{vectors}')
            words = ["solve", "problem.toml", "-o", "solution.h5", "--summary", "summary.json", *options]
            outcome = program.run(*words, ranks=ranks, cwd=folder, timeout=120)
            assert outcome.code == 0, outcome
            with h5py.File(folder / "solution.h5") as file:
                u = np.ravel(file["solution"][:])
            self.judge(u)
            return u, program.read_json(folder / "summary.json")

    def judge(self, u):
        assert np.all((self.lower <= u) & (u <= self.upper)), "/solution leaves the box"
        f = self.M @ u + self.q
        terms = abs(self.M) @ abs(u) + abs(self.q)
        wrong = abs(u - np.clip(u - f, self.lower, self.upper))
        ratio = np.max(wrong / np.where(terms > 0, terms, 1.0))
        assert ratio <= CERTIFICATE, f"natural residual over row terms {ratio}"


def transport(random, rows, columns):
    """Least cost of carrying supplies to demands: the skew LCP of its optimality conditions, with many optima."""
    supply = 10.0 * random.integers(1, 9, rows)
    demand = 10.0 + 10.0 * random.multinomial(int(supply.sum() / 10) - columns, np.ones(columns) / columns)
    supply[0] += 5
    cost = random.integers(1, 7, rows * columns).astype(float)
    A, B = sp.kron(sp.eye(rows), np.ones((1, columns))), sp.kron(np.ones((1, rows)), sp.eye(columns))
    problem = Problem(sp.bmat([[None, A.T, -B.T], [-A, None, None], [B, None, None]]), np.concatenate([cost, supply, -demand]))
    best = linprog(cost, A_ub=sp.vstack([A, -B]), b_ub=np.concatenate([supply, -demand]), method="highs").fun
    return problem, cost, best


def flow(random, n):
    """Least cost of a flow with capacities on a grid: two-sided boxes, and potentials that are only known up to a
    constant (the rows of conservation add up to zero)."""
    node = np.arange(n * n).reshape(n, n)
    tail = np.concatenate([node[:, :-1].ravel(), node[:-1].ravel(), node[:, 1:].ravel(), node[1:].ravel()])
    head = np.roll(tail, tail.size // 2)
    arcs = np.arange(tail.size)
    E = sp.csr_matrix((np.repeat([1.0, -1.0], arcs.size), (np.r_[tail, head], np.r_[arcs, arcs])), shape=(n * n, arcs.size))
    cost = random.integers(1, 9, arcs.size).astype(float)
    balance = E @ (random.integers(0, 4, arcs.size) * (random.random(arcs.size) < 0.3))
    lower = np.r_[np.zeros(arcs.size), np.full(n * n, FREE)]
    upper = np.r_[np.full(arcs.size, 5.0), np.full(n * n, INFINITY)]
    problem = Problem(sp.bmat([[None, -E.T], [E, None]]), np.r_[cost, -balance], lower, upper)
    best = linprog(cost, A_eq=E, b_eq=balance, bounds=(0, 5), method="highs").fun
    return problem, cost, best


def repeated(random, times):
    """min 1/2 x'K x - f'x where G x >= g, each row of G `times` times; the states are unique, multipliers are not."""
    n, m = 60, 30
    K = sp.diags([-np.ones(n - 1), np.full(n, 2.1), -np.ones(n - 1)], [-1, 0, 1])
    G = sp.random(m, n, 0.06, random_state=5) + sp.eye(m, n)
    f, g = random.normal(size=n), 0.3 * random.normal(size=m)

    def of(G, g):
        lower = np.r_[np.full(n, FREE), np.zeros(len(g))]
        return Problem(sp.bmat([[K, -G.T], [G, None]]), np.r_[-f, -g], lower)

    return of(sp.vstack([G] * times), np.tile(g, times)), of(G, g), n


def obstacle(n):
    """A membrane over a cone: the free boundary moves by one cell in an iteration of an active-set method."""
    L = sp.diags([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], [-1, 0, 1])
    x, y = np.meshgrid(*[np.arange(1, n + 1) / (n + 1)] * 2)
    cone = np.maximum(0.0, 0.5 - 6 * np.hypot(x - 0.3, y - 0.4)).ravel()
    h = 1 / (n + 1)
    return Problem(sp.kron(L, sp.eye(n)) + sp.kron(sp.eye(n), L), np.full(n * n, h * h), cone)


class Degenerate(unittest.TestCase):
    def setUp(self):
        self.random = np.random.default_rng(7)

    def judge_program(self, problem, cost, best, ranks):
        u, summary = problem.solve(ranks)
        # The certificate bounds each row; the duality gap sums them, over 1e3 rows.
        self.assertAlmostEqual(cost @ u[: len(cost)], best, delta=1e-7 * best)
        self.assertEqual(summary["rungs"]["interior_point"], 1, "a rung before that solved it: this test shows nothing")

    def test_transport(self):
        for ranks in 1, 2:
            with self.subTest(ranks=ranks):
                self.judge_program(*transport(self.random, 25, 40), ranks)

    def test_flow_with_capacities_on_three_ranks(self):
        self.judge_program(*flow(self.random, 16), ranks=3)

    def test_rows_repeated_38_times(self):
        many, once, states = repeated(self.random, 38)
        x, _ = many.solve(ranks=2)
        expected, _ = once.solve()
        # Both certified to 1e-10 of terms of size 1, with K's smallest eigenvalue 0.1.
        np.testing.assert_allclose(x[:states], expected[:states], atol=1e-8)

    def test_obstacle_takes_no_more_factorizations_than_snesvi_alone(self):
        problem = obstacle(60)
        u, summary = problem.solve()
        alone, of_snesvi = problem.solve(options=("-sweepvi_predictor", "none"))
        self.assertLessEqual(summary["factorizations"], of_snesvi["factorizations"])
        np.testing.assert_allclose(u, alone, atol=1e-7)  # 1e-10 over the smallest eigenvalue, 5e-3

    def test_without_solution(self):
        """Demands beyond the supplies."""
        problem, _, _ = transport(self.random, 25, 40)
        problem.q[25 * 40] -= 1e4
        with self.assertRaises(AssertionError) as raised:
            problem.solve()
        self.assertIn("exit 3", str(raised.exception))

    def test_a_preconditioner_that_cannot_be_set_up_is_bad_input(self):
        """It is told before a file is written, on any number of ranks."""
        for ranks in 1, 2:
            with self.subTest(ranks=ranks), self.assertRaises(AssertionError) as raised:
                obstacle(8).solve(ranks, options=("-pc_type", "fieldsplit"))
            self.assertIn("exit 2", str(raised.exception))
            self.assertIn("fieldsplit", str(raised.exception))


if __name__ == "__main__":
    unittest.main()
