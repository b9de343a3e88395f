# Chains of flexible elements (r = 4). One and two against event-driven solutions in 50 digits (tests/reference): the
# scheme is of order 1, in the constraint w uniformly and on all four levels in L1. Fifty: an impact of one element makes
# no state of any other jump.
#
# ranks: 2
# timeout: 240
import json
import math

import numpy as np
from chain_runs import REFERENCE, Verdict, homsp, program, run, write_scene

END = 5.0
GRID = 0.01
STEPS = (1e-2, 1e-3, 1e-4)
LEVELS = 4
# A plain implementation of the same step has these largest errors of w on the 0.01 s grid.
EXPECTED = {1: (2.33e-3, 2.52e-4, 2.54e-5), 2: (4.64e-3, 4.91e-4, 4.91e-5)}
# Error = c h (1 + O(h)) + (an impact at speed s comes late by (error of w) / s and by up to one step more, where all levels
# jump). c thus depends on where in its step an impact falls: over two decades by a factor of 10^(2 0.1) = 1.6.
ORDER = (0.9, 1.1)


def flexible(count, **keys):
    return {"kind": "chain", "element": "flexible", "count": count, **keys}


def free_flow(count, joint=10.0, ground=1.0, coupling=1.0, force=-1.0):
    """A and f of the standard chain, in the order of /x: q p q' p' element by element."""
    A, f = np.zeros((4 * count, 4 * count)), np.zeros(4 * count)
    for i in range(count):
        q, p, dq, dp = range(4 * i, 4 * i + 4)
        A[q, dq] = A[p, dp] = 1.0
        A[dq, q] = -joint - ground - 2.0 * coupling
        A[dq, p] = A[dp, q] = joint
        A[dp, p] = -joint
        for neighbour in {i - 1, i + 1} & set(range(count)):
            A[dq, 4 * neighbour] = coupling
        f[dq] = force
    return A, f


# ---------------------------------------------------------------- exact solutions


def exponential(matrix):
    """exp by Taylor series of 2^-8 of it; the matrices here have norms below 1."""
    small = matrix / 256.0
    power = result = np.eye(len(matrix))
    for k in range(1, 12):
        power = power @ small / k
        result = result + power
    return np.linalg.matrix_power(result, 256)


class Exact:
    """z(t) between the events of the reference: in contact a constraint's outputs rest at 0."""

    def __init__(self, count):
        reference = json.loads((REFERENCE / f"flexible_N{count}_events.json").read_text())
        self.W = np.array(reference["W"])
        self.w0 = np.array(reference["w0"])
        self.A, self.f = free_flow(count)
        heights = 0.5 + 0.1 * (np.arange(count) % 3)
        self.start = self.W @ np.kron(heights, [1.0, 1.0, 0.0, 0.0]) + self.w0
        self.events = [(float(e["t"]), np.array(e["after"], dtype=float)) for e in reference["events"]]

    def flow(self, z):
        """The matrix of (z, 1)' = F (z, 1) after a start in z: constraints whose outputs are all 0 stay there."""
        n = len(z)
        back = np.linalg.inv(self.W)
        flow = np.zeros((n + 1, n + 1))
        flow[:n, :n] = self.W @ self.A @ back
        flow[:n, n] = self.W @ (self.f - self.A @ back @ self.w0)
        for first in range(0, n, LEVELS):
            if not z[first : first + LEVELS].any():
                flow[first : first + LEVELS] = 0.0
        return flow

    def at(self, times):
        """z, right limits."""
        result = np.empty((len(times), len(self.start)))
        pieces = [(0.0, self.start), *self.events, (math.inf, None)]
        for (begin, state), (end, _) in zip(pieces, pieces[1:]):
            inside = np.flatnonzero((times >= begin) & (times < end))
            if len(inside) == 0:
                continue
            flow = self.flow(state)
            z = exponential((times[inside[0]] - begin) * flow) @ np.append(state, 1.0)
            step = exponential((times[1] - times[0]) * flow)
            for k in inside:
                result[k] = z[:-1]
                z = step @ z
        return result


def test_exact(count, exact, verdict):
    """The tests' own solution against the table."""
    table = np.loadtxt(REFERENCE / f"flexible_N{count}.csv", delimiter=",", skiprows=1)
    difference = np.abs(exact.at(table[:, 0]) - table[:, 1:]).max()
    # 500 products of matrices with entries up to 100.
    verdict.expect(difference <= 1e-10, f"N = {count}: exact solution and table differ by {difference:.1e}")


# ---------------------------------------------------------------- order


def errors(file, h, exact):
    """Largest error of w on the 0.01 s grid; integrals over time of the errors of each level, over all elements."""
    z = file["z"][:]
    difference = np.abs(z - exact.at(file["t"][:]))
    sup = difference[:: round(GRID / h), ::LEVELS].max()
    return sup, [h * difference[:, level::LEVELS].sum() for level in range(LEVELS)]


def test_order(folder, count, verdict):
    exact = Exact(count)
    test_exact(count, exact, verdict)
    table = []
    for h, expected in zip(STEPS, EXPECTED[count]):
        scene = write_scene(folder, f"N{count}_{h:g}", homsp(END, h), flexible(count))
        file, summary = run(scene)
        sup, levels = errors(file, h, exact)
        table.append((sup, levels))
        verdict.expect(
            abs(sup / expected - 1.0) <= 0.1,
            f"N = {count}, h = {h:g}: sup error of w {sup:.3e} (expected {expected:.3e}), L1 on the levels "
            + " ".join(f"{level:.2e}" for level in levels)
            + f", {summary['seconds_stepping']:.1f} s",
        )
    coarse, fine = ([sup, *levels] for sup, levels in (table[0], table[-1]))
    for name, a, b in zip(("w, largest", "z1 in L1", "z2 in L1", "z3 in L1", "z4 in L1"), coarse, fine):
        order = math.log(a / b) / math.log(STEPS[0] / STEPS[-1])
        verdict.expect(ORDER[0] <= order <= ORDER[1], f"N = {count}: order of the error of {name}: {order:.3f}")


# ---------------------------------------------------------------- neighbours


def test_neighbours(folder, verdict):
    count, h = 50, 1e-2
    file, _ = run(write_scene(folder, "neighbours", homsp(END, h), flexible(count)))
    x, mu = file["x"][:], file["mu"][1:]
    A, f = free_flow(count)
    # Rows of (I - hA) x_new - x_old - h f: what no measure moved is zero up to rounding of its own terms.
    residual = np.abs(x[1:] - h * x[1:] @ A.T - x[:-1] - h * f)
    terms = np.abs(x[1:]) + h * np.abs(x[1:]) @ np.abs(A).T + np.abs(x[:-1]) + h * np.abs(f)
    ratio = (residual / np.maximum(terms, np.finfo(float).tiny)).reshape(len(mu), count, 4).max(axis=2)
    hit = mu.any(axis=2)
    beside = np.zeros_like(hit)
    beside[:, 1:] |= hit[:, :-1]
    beside[:, :-1] |= hit[:, 1:]
    quiet = ~hit
    # The linear solver leaves at most 1e-14 of the row's terms (-sweepvi_target_rtol), the predictor a few roundings.
    verdict.expect(
        ratio[quiet].max() <= 1e-13,
        f"N = {count}: {quiet.sum()} steps of elements without measures, {(quiet & beside).sum()} of them beside one with: "
        f"their rows are zero up to {ratio[quiet].max():.1e} of their terms",
    )
    verdict.expect(
        (quiet & beside).sum() > 100 and ratio[hit].max() > 1e-3,
        f"N = {count}: where measures act, rows move by up to {ratio[hit].max():.1e} of their terms",
    )


def test_many(folder, verdict):
    """A hundred elements reach the wall in one step: a system with as many pivots that are zero."""
    scene = write_scene(folder, "many", homsp(2.0, 1e-2), flexible(300, topology="ring"))
    file, summary = run(scene, options=("-sweepvi_predictor", "active-set"))
    most = file["/solver/active"][:].max()
    verdict.expect(
        summary["max_residual"] <= 1e-10 and most >= 100,
        f"ring of 300: up to {most} in contact, worst certificate {summary['max_residual']:.1e}",
    )


def test_no_factorization(folder, verdict):
    """Elements are weakly coupled, also across ranks and with outputs of very different size: none is needed."""
    for ranks in (1, 2):
        _, summary = run(write_scene(folder, "weak", homsp(1.5, 1e-2), flexible(50)), ranks=ranks)
        verdict.expect(
            summary["factorizations"] == 0 and summary["predictor_hits"] == summary["steps"],
            f"50 on {ranks} ranks: {summary['factorizations']} factorizations, {summary['predictor_hits']} hits in {summary['steps']} steps",
        )


def main():
    verdict = Verdict()
    with program.temporary_folder() as name:
        folder = program.Path(name)
        for count in EXPECTED:
            test_order(folder, count, verdict)
        test_neighbours(folder, verdict)
        test_many(folder, verdict)
        test_no_factorization(folder, verdict)
    verdict.exit()


main()
