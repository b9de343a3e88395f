"""Random box VIs of which it is known without rounding whether they have a solution, and what the solver makes of them.

usage: solvable.py SEED [--count N] [--largest N] [--small N] [--ranks N]

Large ones, 2 to --largest unknowns: matrices with positive semidefinite symmetric part and a nonnegative vector d with M'd <= 0
(Laplacians, transport and other skew matrices, products G G', rank one), scaled on both sides so that stiffness is spread over
up to 14 decades. Those without a solution have q'd < 0, by 1e-6 of |q| or more (Farkas); those with one have q = w - M u with
u, w >= 0, which is enough. Both are checked in integers. Small ones, up to 8 unknowns, of all kinds, are judged by a search in
integers. Right is: no problem without a solution is certified; all with one are, if monotone or P; what is certified has an
exact solution next to it.
"""

import argparse
import os
import random
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy.sparse as sp

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
from exact_lcp import solvable

INFINITY = float("inf")
UNIT = 2**20
NEXT_TO = 1e-8  # of 1 + |u|: small problems have integer data, conditions up to 1e4, and are solved to 1e-14 to 1e-12


@dataclass
class Problem:
    name: str
    M: sp.csr_matrix
    q: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    u0: np.ndarray
    has_solution: bool
    must_be_found: bool  # monotone or P
    integer: bool = False  # small ones: what is certified is compared with exact solutions

    def data(self):
        return self.M.toarray().tolist(), self.q.tolist(), self.lower.tolist(), self.upper.tolist()


def product(M, x):
    """M x, M and x of integers."""
    total = [0] * M.shape[0]
    M = M.tocoo()
    for i, j, v in zip(M.row.tolist(), M.col.tolist(), M.data.tolist()):
        if x[j]:
            total[i] += int(v) * x[j]
    return total


# ---------------------------------------------------------------- large ones


def laplacian(draw, n, decades):
    """Of a connected graph, symmetric: d = 1. (M, d)"""
    edges = [(i, draw.randrange(i)) for i in range(1, n)] + [tuple(draw.sample(range(n), 2)) for _ in range(n // 2)]
    weights = [2.0 ** draw.randint(0, int(decades * 3.32)) for _ in edges]
    i, j = np.array([a for a, _ in edges]), np.array([b for _, b in edges])
    W = sp.coo_matrix((weights, (i, j)), shape=(n, n)).tocsr()
    W = W + W.T
    return sp.diags(np.asarray(W.sum(axis=1)).ravel()) - W, [1] * n


def transport(draw, n, decades):
    """Skew; d is 1 on supplies and demands."""
    rows = max(1, int((n + 1) ** 0.5) - 1)
    columns = max(1, (n - rows) // (rows + 1))
    A, B = sp.kron(sp.eye(rows), np.ones((1, columns))), sp.kron(np.ones((1, rows)), sp.eye(columns))
    M = sp.bmat([[None, A.T, -B.T], [-A, None, None], [B, None, None]])
    return M, [0] * (rows * columns) + [1] * (rows + columns)


def programme(draw, n, decades):
    """Skew: of the linear programme min c'x, G x >= b with two rows that contradict each other for some b."""
    m = max(2, n // 2)
    columns = max(1, n - m)
    G = sp.random(m, columns, min(1.0, 4.0 / columns), random_state=draw.randrange(2**31), data_rvs=lambda k: np.array([draw.choice([-2, -1, 1, 2, 3]) for _ in range(k)], float)).tolil()
    G[1] = -G[0]
    G = G.tocsr()
    M = sp.bmat([[sp.csr_matrix((columns, columns)), -G.T], [G, sp.csr_matrix((m, m))]])
    return M, [0] * columns + [1, 1] + [0] * (m - 2)


def gram(draw, n, decades):
    """G G' of incidence columns, with a skew part of the same kernel: every two ends of d are tied by some."""
    k = max(1, n // 2)
    pairs = [draw.sample(range(n), 2) for _ in range(k)]
    G = sp.coo_matrix(([1.0] * k + [-1.0] * k, ([a for a, _ in pairs] + [b for _, b in pairs], [*range(k)] * 2)), shape=(n, k)).tocsr()
    K = sp.coo_matrix(([1.0] * (k // 2), ([*range(k // 2)], [*range(k // 2, 2 * (k // 2))])), shape=(k, k))
    W = sp.diags([2.0 ** draw.randint(0, int(decades * 3.32)) for _ in range(k)])
    return G @ (W + (K - K.T)) @ G.T, [1] * n


def rank_one(draw, n, decades):
    """a a' with entries of both signs: d stands on one of each."""
    n = min(n, 300)  # dense
    a = np.array([draw.choice([-3, -2, -1, 0, 0, 1, 2]) for _ in range(n)], float)
    a[0], a[1] = draw.choice([1, 2, 3]), -draw.choice([1, 2, 3])
    return sp.csr_matrix(np.outer(a, a)), [int(-a[1]), int(a[0])] + [0] * (n - 2)


KINDS = {"Laplacian": laplacian, "transport": transport, "programme": programme, "Gram": gram, "rank one": rank_one}


def large(draw, kind, n, feasible, stiff):
    decades = draw.uniform(0, 14) if stiff and kind in ("Laplacian", "Gram") else 0
    M, d = KINDS[kind](draw, n, decades)
    n = M.shape[0]
    M = M.tocsr()
    if stiff and not decades:  # D M D, by powers of two
        scale = sp.diags([2.0 ** draw.randint(0, 23) for _ in range(n)])
        M = (scale @ M @ scale).tocsr()
        largest = int(scale.diagonal().max())
        d = [v * largest // int(s) for v, s in zip(d, scale.diagonal())]
    M.sum_duplicates()
    M.eliminate_zeros()
    if feasible:
        loose = draw.choice([0.0, 0.3, 1.0])  # how many rows have w > 0: none is the edge of being solvable
        u = [draw.choice([0, 0, 1, 2, 3]) for _ in range(n)]
        w = [draw.choice([1, 2, 5]) if draw.random() < loose else 0 for _ in range(n)]
        exact = [UNIT * (a - b) for a, b in zip(w, product(M, u))]  # q in units of 1 / UNIT
    else:
        assert all(v <= 0 for v in product(M.T, d)), kind
        exact = [UNIT * draw.randint(-4, 8) for _ in range(n)]
        on, largest = [i for i in range(n) if d[i]], max(d)
        gap = lambda: -sum(exact[i] * d[i] for i in on)
        i = draw.choice(on)
        exact[i] += gap() // d[i] - 1  # just below 0
        while 10**6 * gap() < max(map(abs, exact)) * largest or draw.random() < 0.5:
            exact[i] -= max(map(abs, exact)) * draw.choice([1, 2, 5]) // 10**6 + 1
        assert gap() > 0
    q = np.array([v / UNIT for v in exact])
    if [int(v * UNIT) for v in q] != exact or any(v % 1 for v in M.data):
        return large(draw, kind, n, feasible, False)  # rounded: again, not so stiff
    size = draw.choice([0.0, 1.0, 1e3, 1e6])
    u0 = np.array([round(draw.random() * size) for _ in range(n)], float)
    name = f"{kind}, n = {n}{', stiff' if stiff else ''}, start {size:g}"
    return Problem(name, M, q, np.zeros(n), np.full(n, INFINITY), u0, feasible, True)


def large_ones(draw, count, largest):
    """`count` without a solution, then as many with one."""
    for feasible in (False, True):
        for k in range(count):
            kind = [*KINDS][k % len(KINDS)]
            n = max(3, round(2 * (largest / 2) ** draw.random()))
            problem = large(draw, kind, n, feasible, draw.random() < 0.4)
            if len(problem.q) <= 8:
                assert solvable(*problem.data()) == feasible, problem.name
            yield problem


# ---------------------------------------------------------------- small ones


def small_matrix(draw, n):
    """(kind, M, whether monotone or P)"""
    kind = draw.choice(["any", "sparse", "monotone", "skew", "rank one", "Laplacian", "repeated rows", "P"])
    entry = lambda: draw.choice([-2, -1, 0, 1, 2])
    M = np.array([[entry() for _ in range(n)] for _ in range(n)], float)
    if kind == "sparse":
        M *= np.array([[draw.random() < 0.4 for _ in range(n)] for _ in range(n)])
    if kind in ("monotone", "repeated rows"):
        G = M[:, : max(1, n // 2)]
        if kind == "repeated rows":
            G[n // 2 :] = G[: n - n // 2]
        K = np.array([[entry() for _ in range(G.shape[1])] for _ in range(G.shape[1])], float)
        M = G @ (np.eye(G.shape[1]) + K - K.T) @ G.T
    if kind == "skew":
        M = M - M.T
    if kind == "rank one":
        a = M[0].copy()
        M = np.outer(a, a)
    if kind == "Laplacian":
        W = np.abs(M) * (np.abs(M) > 1)
        W = np.triu(W, 1) + np.triu(W, 1).T
        M = np.diag(W.sum(axis=1)) - W
    if kind == "P":
        M = M - np.diag(np.diag(M))
        M += np.diag(np.abs(M).sum(axis=1) + 1)
    if draw.random() < 0.3:
        M = M / 8
    return kind, M, kind not in ("any", "sparse")


def small(draw):
    n = draw.randint(1, 8)
    kind, M, good = small_matrix(draw, n)
    q = np.array([draw.randint(-3, 3) for _ in range(n)], float) / draw.choice([1, 1, 4])
    lower, upper = np.zeros(n), np.full(n, INFINITY)
    boxes = draw.choice(["LCP", "LCP", "mixed", "walls"])
    for i in range(n):
        if boxes == "mixed" and draw.random() < 0.4:
            lower[i] = -INFINITY
        elif boxes == "walls":
            lower[i], upper[i] = draw.choice([(0, INFINITY), (-1, 2), (-INFINITY, 1), (1, 1), (-INFINITY, INFINITY), (0, 0.5)])
    u0 = np.array([draw.randint(-2, 2) * draw.choice([0.0, 1.0, 1e6]) for _ in range(n)])
    has = solvable(M.tolist(), q.tolist(), lower.tolist(), upper.tolist())
    return Problem(f"{kind}, {boxes}, n = {n}", sp.csr_matrix(M), q, lower, upper, u0, has, good, True)


# ---------------------------------------------------------------- the solver


def write(problem, file):
    M = problem.M.tocsr().tocoo()
    order = np.lexsort((M.col, M.row))
    np.array([len(problem.q), M.nnz], np.int64).tofile(file)
    for values in (M.row, M.col):
        values[order].astype(np.int64).tofile(file)
    for values in (M.data[order], problem.q, problem.lower, problem.upper, problem.u0):
        values.astype(np.float64).tofile(file)


def solve(problems, ranks=1, timeout=100, options=()):
    """[(certified, seconds, rung, u)] of all of them, in one process."""
    import program

    executable = Path(os.environ["SWEEPVI_BUILD"]) / "tests" / "many_problems_program"
    with tempfile.TemporaryDirectory(prefix="sweepvi_") as folder:
        given, made = Path(folder) / "problems", Path(folder) / "answers"
        with open(given, "wb") as file:
            for problem in problems:
                write(problem, file)
        command = [executable, given, made, *options]
        if ranks > 1:
            command = ["mpiexec", "--oversubscribe", "-n", str(ranks), *command]
        try:
            outcome = subprocess.run(command, env={**os.environ, **program.ENVIRONMENT}, timeout=timeout, capture_output=True, text=True)
            ended = f"exit {outcome.returncode}: {outcome.stderr[-500:]}"
        except subprocess.TimeoutExpired:
            ended = f"did not end within {timeout} s"
        values = np.fromfile(made) if made.exists() else np.zeros(0)
    answers, at = [], 0
    for problem in problems:
        n = len(problem.q)
        if at + 3 + n > len(values):
            raise AssertionError(f"{problem.name}: {ended}")
        answers.append((values[at] == 1, *values[at + 1 : at + 3], values[at + 3 : at + 3 + n]))
        at += 3 + n
    return answers


def wrong_with(problem, certified, u):
    """What is wrong with the answer; '' if nothing. 'missed': not found, and nobody promised it."""
    if not certified:
        return "" if not problem.has_solution else "not certified" if problem.must_be_found else "missed"
    if not problem.has_solution:
        return f"certified without a solution, |u| = {np.abs(u).max():.2g}"
    if problem.integer:
        within = NEXT_TO * (1 + float(np.abs(u).max()))
        return "" if solvable(*problem.data(), near=u.tolist(), within=within) else f"certified, no exact solution within {within:.2g}"
    # Monotone LCPs, backwards: F and u are right up to 1e-9 of the data and what rounding leaves of their rows' terms; what
    # changes no row by more than that is 0.
    F = problem.M @ u + problem.q
    allowed = 1e-9 * np.abs(problem.q) + 1e-14 * (abs(problem.M) @ np.abs(u) + np.abs(problem.q))
    seen = sp.diags(1 / np.maximum(allowed, 1e-300)) @ abs(problem.M) @ sp.diags(u)
    negligible = np.asarray(seen.max(axis=0).todense()).ravel() <= 1
    wrong = (u < 0) | (F < -allowed) | ((F > allowed) & ~negligible)
    return f"certified, {wrong.sum()} rows wrong" if wrong.any() else ""


def judge(problems, answers, out=sys.stdout):
    """Prints what is wrong; returns (wrong, missed)."""
    wrong = missed = 0
    for k, (problem, (certified, seconds, rung, u)) in enumerate(zip(problems, answers)):
        what = wrong_with(problem, certified, u)
        missed += what == "missed"
        if what and what != "missed":
            wrong += 1
            print(f"WRONG {k}: {problem.name}: {what} (rung {rung:.0f}, {seconds:.2g} s)", file=out, flush=True)
    return wrong, missed


def main(seed, count, largest, small_count, ranks=1, timeout=100, out=sys.stdout):
    begin = time.monotonic()
    draw = random.Random(seed)
    problems = [*large_ones(draw, count, largest), *(small(draw) for _ in range(small_count))]
    drawn = time.monotonic() - begin
    answers = solve(problems, ranks, timeout)
    wrong, missed = judge(problems, answers, out)
    spent = sum(answer[1] for answer in answers)
    feasible = sum(problem.has_solution for problem in problems)
    print(f"seed {seed}: {len(problems) - feasible} problems without, {feasible} with a solution, {ranks} ranks: {wrong} wrong, {missed} missed where nothing is promised; solved in {spent:.1f} s, longest {max(a[1] for a in answers):.2g} s, drawn in {drawn:.0f} s", file=out, flush=True)  # fmt: skip
    return wrong


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("seed")
    parser.add_argument("--count", type=int, default=1000, help="large ones without a solution, and as many with one")
    parser.add_argument("--largest", type=int, default=2000)
    parser.add_argument("--small", type=int, default=1000)
    parser.add_argument("--ranks", type=int, default=1)
    parser.add_argument("--timeout", type=float, default=3600)
    given = parser.parse_args()
    sys.exit(1 if main(given.seed, given.count, given.largest, given.small, given.ranks, given.timeout) else 0)
