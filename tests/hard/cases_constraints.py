"""Hard constraints: dependent ones, Markov matrices of all kinds, zero dynamics, coupling, masses, magnitudes."""

import numpy as np
import random_runs
from scenes import FALL, integrators, jerk_matrices, markov, masses, moreau_jean, paper65, scene
from suite import Case, exact_homsp, exact_moreau_jean

PRIMAL_DUAL = ("-sweepvi_form", "primal-dual")
SAME = "the same steps in 60 digits"
CASES = []


def add(group, name, *rest, **keys):
    CASES.append(Case(group, name, *rest, **keys))


# ---------------------------------------------------------------- dependent constraints, rows of C

SINGULAR = "Markov matrix .* is singular: constraints 0, 1"
fall = lambda n: [v for _ in range(n) for v in (0.0, FALL)]
for difference in (0.0, 1e-14, 1e-12, 1e-9):
    two = {
        "kind": "linear", "A": [[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0, 1], [0, 0, 0, 0]],
        "B": [[0, 0], [1, 1], [0, 0], [0, difference]], "C": [[1, 0, 0, 0], [1, 0, difference, 0]],
        "x0": [1, 0, 1, 0], "f": fall(2),
    }  # fmt: skip
    add("dependent rows of C", f"r = 2, differing by {difference:g}", scene(two, 2.0, 0.02), "refused by name", code=2, says=SINGULAR, quick=difference == 0.0)


def wedge(difference):
    """x <= difference y both bound the same corner: x' = -1 + l_0 + l_1, y' = -1 + difference l_1."""

    def judge(run):
        x, w, t = run["x"], run["w"], run["t"]
        push = run["mu"][:, :, 0].cumsum(axis=0)
        balance = x[:, 0] - (1.0 - t + push.sum(axis=1))
        other = x[:, 1] - (-t + difference * push[:, 1])
        return [
            ("outside by", float(max(0.0, -w.min())), 1e-12),
            ("balance", float(max(np.abs(balance).max(), np.abs(other).max())), 1e-11),
            ("pull", float(max(0.0, -run["mu"].min())), 0.0),
            ("push off the wall", float((run["mu"][:, :, 0] * np.maximum(w, 0.0)).max()), 1e-12),
        ]

    return judge


for difference in (0.0, 1e-14, 1e-12, 1e-9, 1e-6):
    two = {"kind": "linear", "A": [[0, 0], [0, 0]], "B": [[1, 1], [0, difference]], "C": [[1, 0], [1, difference]], "x0": [1, 0], "f": [-1.0, -1.0]}
    add("dependent rows of C", f"r = 1, differing by {difference:g}", scene(two, 2.0, 0.02), "inside, balanced, complementary", wedge(difference), quick=difference == 1e-12)  # fmt: skip

third = lambda w0: {"kind": "linear", "A": [[0]], "B": [[1, -1, 1]], "C": [[1], [-1], [1]], "w0": [0.0, 1.0, w0], "x0": [0.7], "f": [FALL]}


def stops_at(place):
    return lambda run: [("x", float(np.abs(run["x"][:, 0] - np.maximum(0.7 - run["t"], place)).max()), 1e-12)]


add("dependent rows of C", "two walls and a third row, r = 1", scene(third(-0.5), 2.0, 0.02), "stops at 0.5", stops_at(0.5), quick=True)
add("dependent rows of C", "two walls and a third row beyond them, r = 1", scene(third(-1.5), 2.0, 0.02), "no step, says why", code=3, says="contradict", quick=True)  # fmt: skip
opposite = integrators(1, [0.7], w0=[0.0, -1.0], B=[[1.0, -1.0]], C=[[1.0], [-1.0]])
add("dependent rows of C", "opposite rows without room", scene(opposite, 2.0, 0.02), "refused by name", code=2, says="constraints 0 and 1 are opposite and leave no room")

# ---------------------------------------------------------------- dependent constraints, rows of H

drop = [0.0, 0.1003]  # no step ends with a gap of exactly 0: rounding would decide


def same_motion(run):
    """Impulses of dependent rows are not unique; the motion is. Rows that differ by 1e-9 lose nine digits."""
    return exact_moreau_jean(1e-8, impulses=False)(run)


for name, H, e, quick in (
    ("the same row twice", [[0, 1], [0, 1]], 0.0, True),
    ("a row and twice it, e = 0.5", [[0, 1], [0, 2]], 0.5, False),
    ("rows differing by 1e-9", [[0, 1], [1e-9, 1]], 0.0, False),
    ("rows differing by 1e-14", [[0, 1], [1e-14, 1]], 0.0, False),
    ("three faces through a vertex of two dimensions", [[1, 1], [-1, 1], [0, 1]], 0.0, True),
    ("three faces, e = 0.5", [[1, 1], [-1, 1], [0, 1]], 0.5, False),
):
    add("dependent rows of H", name, moreau_jean(masses(H, drop, [0.0, 0.0], [0.0, FALL], e=e), 1.0, 0.01), SAME, same_motion, quick=quick)
pyramid = masses([[1, 0, 1], [-1, 0, 1], [0, 1, 1], [0, -1, 1]], [0.0, 0.0, 0.1003], [0.1, 0.0, 0.0], [0.0, 0.0, FALL])
add("dependent rows of H", "four faces through a vertex of three dimensions", moreau_jean(pyramid, 1.0, 0.01), SAME, same_motion)
add("dependent rows of H", "the same row with another e", moreau_jean(masses([[1], [1]], [0.1], [-1.0], [FALL], e=[0.2, 0.8]), 1.0, 0.01), SAME, same_motion)
for name, slope, code, says in (("exactly", 0.0, 3, "contradict|exclude"), ("up to 1e-6", 1e-6, 0, "")):
    squeeze = masses([[1, 0], [-1, slope]], [0.0, 0.0], [1.0, 0.0], [0.0, 0.0], g0=[-1e-3, -1e-3], e=[0.2, 0.8])
    add("dependent rows of H", f"opposite walls, both passed, with rebounds that contradict each other {name}",
        moreau_jean(squeeze, 0.05, 0.01, detection="current"), "no step, says why" if code else SAME, exact_moreau_jean(), code=code, says=says, quick=True)  # fmt: skip

# ---------------------------------------------------------------- Markov matrices

CYCLE = [[1, 3, 0], [0, 1, 3], [3, 0, 1]]
for name, M, quick in (
    ("positive definite, skew part 1e6", [[1, 1e6], [-1e6, 1]], False),
    ("positive definite, skew part 1e12", [[1, 1e12], [-1e12, 1]], True),
    ("P, not positive definite", [[1, 100], [0, 1]], True),
    ("P, cyclic", CYCLE, False),
    ("diagonal, 1e-12 and 1e12", [[1e-12, 0], [0, 1e12]], False),
):
    for r in (1, 2, 4):
        limit = 1e-9 if r < 4 else 1e-7
        add("Markov matrix", f"{name}, r = {r}", scene(markov(M, r), 2.0, 0.019), SAME, exact_homsp(limit), quick=quick and r == 2)
for name, M in (("not P, several solutions", [[1, 2], [2, 1]]), ("not P, no solution", [[1, -2], [-2, 1]])):
    add("Markov matrix", f"{name}, r = 2", scene(markov(M, 2), 2.0, 0.02), "refused by name", code=2, says="constraints 0, 1 is not a P-matrix", quick=True)


def some_solution(run):
    """Each step's own problem is solved: x = x_k - h + M mu, x >= 0, mu >= 0, one of them 0."""
    M = np.array(run.model["B"], float)
    x, mu = run["x"], run["mu"][1:, :, 0]
    steps = x[1:] - x[:-1] + run.h - mu @ M.T
    return [("step", float(np.abs(steps).max()), 1e-12), ("min(x, mu)", float(np.abs(np.minimum(x[1:], mu)).max()), 1e-12)]


add("Markov matrix", "not P, several solutions, r = 1", scene(markov([[1, 2], [2, 1]], 1), 2.0, 0.019), "one of them", some_solution)
add("Markov matrix", "not P, no solution, r = 1", scene(markov([[1, -2], [-2, 1]], 1), 2.0, 0.019), "no step, says why", code=3, says="not .*P-matrix", quick=True)
add("Markov matrix", "skew, no solution, r = 1", scene(markov([[0, 1], [-1, 0]], 1), 2.0, 0.019), "no step, says why", code=3, says="semidefinite")
add("Markov matrix", "zero diagonal, one solution, r = 1", scene(markov([[0, 1], [1, 0]], 1), 2.0, 0.019), "that one", some_solution)
add("Markov matrix", "negative, r = 3", scene(markov([[-1]], 3), 2.0, 0.02), "refused by name", code=2, says="constraint 0 has a negative leading Markov parameter")

# ---------------------------------------------------------------- zero dynamics


def zero_dynamics(own, back=1.0):
    """x'' = -x + xi + lambda, xi' = own xi + back x, w = x: xi are the zero dynamics."""
    return {
        "kind": "linear", "A": [[0, 1, 0], [-1, 0, 1], [back, 0, own]], "B": [[0], [1], [0]], "C": [[1, 0, 0]],
        "x0": [1.0, 0.0, -0.3], "f": [0.0, -1.0, 0.0],
    }  # fmt: skip


for name, own, end in (("unstable, growth e^10", 1.0, 10.0), ("unstable, growth e^300", 30.0, 10.0), ("stiff", -1e8, 10.0), ("undamped", 0.0, 10.0)):
    # What rounding makes of the first steps grows with the solution itself.
    add("zero dynamics", name, scene(zero_dynamics(own), end, 0.02), SAME, exact_homsp(1e-9), quick="e^10" in name)
    add("zero dynamics", name + ", primal-dual", scene(zero_dynamics(own), end, 0.02), SAME, exact_homsp(1e-9), options=PRIMAL_DUAL)
backwards = {"kind": "linear", "A": [[0, 1, 0], [0, 0, 1], [-1, -2, -2]], "B": [[0], [0], [1]], "C": [[-1, 1, 0]], "x0": [-0.5, 0.5, 0.0], "f": [0.0, 0.0, -1.0]}
add("zero dynamics", "non-minimum phase: w = x' - x", scene(backwards, 5.0, 0.02), SAME, exact_homsp(1e-9), quick=True)

# ---------------------------------------------------------------- everything at once

CASES += [random_runs.steps_of(str(seed)) for seed in range(20)]

# ---------------------------------------------------------------- coupling, masses, magnitudes

for coupling in (1e-8, 1.0, 1e4, 1e8):
    chain = {"kind": "chain", "element": "jerk", "count": 2, "coupling": coupling}
    # h^3 coupling = 1e2 at most: what rounding makes of z_3 is multiplied by the springs.
    limit = 1e-9 if coupling <= 1e4 else 1e-7
    add("coupling", f"two jerk elements, {coupling:g}", scene(chain, 2.0, 0.011), SAME, exact_homsp(limit, matrices=jerk_matrices(2, coupling)), quick=coupling == 1e8)
    stiffness = [[2 * coupling, -coupling], [-coupling, 2 * coupling]]
    springs = masses([[1, 0], [0, 1]], [0.5, 0.2], [0.0, 0.0], [FALL, FALL], K=stiffness, e=0.5)
    add("coupling", f"two masses, e = 0.5, theta = 1, {coupling:g}", moreau_jean(springs, 2.0, 0.011, 1.0), SAME, exact_moreau_jean(1e-9))
for name, M, quick in (("light below heavy", [1e-6, 1e6], True), ("heavy below light", [1e6, 1e-6], False), ("light between heavy", [1e6, 1e-6, 1e6], False)):
    n = len(M)
    H = [[1.0] + [0.0] * (n - 1)] + [[-1.0 if j == i - 1 else 1.0 if j == i else 0.0 for j in range(n)] for i in range(1, n)]
    for e in (0.0, 0.5):
        column = masses(H, [1.3 * i + 1.0 for i in range(n)], [-1.0] * n, [FALL * m for m in M], M=M, g0=[0.0] + [-1.0] * (n - 1), e=e)
        add("masses", f"{name}, 12 decades, e = {e:g}", moreau_jean(column, 3.0, 0.01), SAME, exact_moreau_jean(1e-9), quick=quick and e == 0.0)
    if n == 2:
        flat = masses(H, [1.0, 2.3], [-1.0] * n, [FALL * m for m in M], M=M, g0=[0.0, -1.0])
        # In units of its diagonal the Markov matrix is [1 -s; -s 1], s^2 = 1 / (1 + m_1 / m_0): 1 - s = 5e-13 or s = 1e-6.
        code = 2 if M[0] < M[1] else 0
        add("masses", f"{name}, homsp", scene(flat, 3.0, 0.011, scheme="homsp"), "refused by name" if code else "stops on the other", lambda run: [("outside by", float(max(0.0, -run["w"].min())), 1e-12), ("speed at the end", float(np.abs(run["x"][-1, 2:]).max()), 1e-9)], code=code, says=SINGULAR)  # fmt: skip
spread = masses([[1, 0], [0, 1]], [0.5, 0.2], [0.0, 0.0], [FALL * 1e-6, FALL * 1e6], M=[1e-6, 1e6], K=[[1.0, -1.0], [-1.0, 1.0]], e=0.5)
add("masses", "two walls and a spring, 12 decades", moreau_jean(spread, 2.0, 0.011, 1.0), SAME, exact_moreau_jean(1e-9))

for size in (1e-300, 1e-150, 1e150, 1e300):
    add("magnitude", f"states of {size:g}", scene(integrators(2, [size, 0.0], FALL * size), 3.0, 0.05), SAME, exact_homsp(), quick=size in (1e-300, 1e300))
    add("magnitude", f"states of {size:g}, primal-dual", scene(integrators(2, [size, 0.0], FALL * size), 3.0, 0.05), SAME, exact_homsp(), options=PRIMAL_DUAL)
    add("magnitude", f"states of {size:g}, Moreau-Jean", moreau_jean(masses([[1]], [size], [0.0], [FALL * size], e=0.5), 3.0, 0.05), SAME, exact_moreau_jean())
for key, size in (("B", 1e-150), ("B", 1e150), ("C", 1e-150), ("C", 1e150)):
    unit = integrators(3, [1.0, 0.0, 0.0])
    unit[key] = [[size * v for v in row] for row in unit[key]]
    add("magnitude", f"{key} of {size:g}, r = 3", scene(unit, 3.0, 0.05), SAME, exact_homsp())
for gap, code in ((1e-6, 0), (1e-11, 0), (1e-15, 3), (1e-100, 3)):
    squeezed = integrators(2, [0.3 * gap, 0.0], {"amplitude": 1.0, "frequency": 0.47}, wmax=[gap])
    add("magnitude", f"walls {gap:g} apart", scene(squeezed, 3.0, 0.05), SAME if code == 0 else "no step, says why", exact_homsp(1e-8), code=code, says="walls, which are .* apart", quick=gap == 1e-15)  # fmt: skip
add("magnitude", "AB (65), damped by 1e12", scene(paper65(A=[[0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [-1, -1, -1e12, 0, 1], [0, 0, 0, 0, 1], [1, 0, 0, -1, 0]]), 10.0, 0.05), SAME, exact_homsp(1e-9))  # fmt: skip
damped = masses([[1, 0], [-1, 1]], [1.0, 2.3], [-1.0, -1.0], [FALL, FALL], g0=[0.0, -1.0], e=0.5, Cv=[[1e12, -1e12], [-1e12, 1e12]])
add("magnitude", "Moreau-Jean, damped by 1e12", moreau_jean(damped, 3.0, 0.011, 1.0), SAME, exact_moreau_jean(1e-4))  # h Cv v = 1e10 is rounded to 1e-6
