"""Hard complementarity problems for `sweepvi solve`, hard distributions over ranks, and very long runs."""

import numpy as np
from scenes import FALL, integrators, masses, moreau_jean, paper65, scene
from suite import SOLVERS, Case, complementary, exact_homsp, exact_moreau_jean, floats

PRIMAL_DUAL = ("-sweepvi_form", "primal-dual")
SAME = "the same steps in 60 digits"
CASES = []


def add(group, name, *rest, **keys):
    CASES.append(Case(group, name, *rest, **keys))


# ---------------------------------------------------------------- problems


def problem(name, M, q, right="certified", solution=None, code=0, limit=1e-12, **keys):
    tables = {"problem": {"M": [[float(v) for v in row] for row in M], "q": [float(v) for v in q]}}
    add("problem", name, tables, right, complementary(solution, limit), code=code, says="could not be certified" if code else "", **keys)


def program_of(A, b, c):
    """min c'x, A x <= b, x >= 0, as a complementarity problem of x and its multipliers."""
    A = np.array(A, float)
    m, n = A.shape
    return np.block([[np.zeros((n, n)), A.T], [-A, np.zeros((m, m))]]), [*c, *b]


for n in (10, 50, 200):
    triangle = [[1.0 if i == j else 2.0 if j < i else 0.0 for j in range(n)] for i in range(n)]
    problem(f"Murty's, n = {n}: 2^n pivots", triangle, [-1.0] * n, solution=[1.0] + [0.0] * (n - 1), quick=n == 10)
    if n <= 50:
        product = np.array(triangle) @ np.array(triangle).T
        # Integers up to 4 n: sums of n products are exact.
        problem(f"Fathi's, n = {n}: 2^n pivots, positive definite", product, [-1.0] * n, quick=n == 10)
beale = [[0.25, -60, -0.04, 9], [0.5, -90, -0.02, 3], [0, 0, 1, 0]]
problem("Beale's program, on which simplex cycles", *program_of(beale, [0, 0, 1], [-0.75, 150, -0.02, 6]), limit=1e-9, quick=True)
kuhn = [[-2, -9, 1, 9], [1 / 3, 1, -1 / 3, -2]]
problem("Kuhn's program, on which simplex cycles", *program_of([*kuhn, [2, 3, -1, -12]], [0, 0, 2], [-2, -3, 1, 12]), limit=1e-9)
problem("Kuhn's, without its last row: unbounded", *program_of(kuhn, [0, 0], [-2, -3, 1, 12]), right="exit 3", code=3)
problem("Kostreva's, on which pivoting cycles", [[1, 2, 0], [0, 1, 2], [2, 0, 1]], [-1] * 3, solution=[1 / 3] * 3)
problem("biactive: u = F = 0", [[2, 1], [1, 2]], [0, 0], solution=[0, 0])
problem("biactive in two of three", [[2, 1, 0], [1, 2, 1], [0, 1, 2]], [1, 0, -2], solution=[0, 0, 1])
problem("M = 0", [[0, 0], [0, 0]], [1, 0])
problem("M = 0, no solution", [[0, 0], [0, 0]], [1, -1], right="exit 3", code=3, quick=True)
problem("not P, three solutions", [[1, 2], [2, 1]], [-1, -1])
problem("not P, no solution", [[0, -1], [-1, 0]], [-1, -1], right="exit 3", code=3)
problem("skew, no solution", [[0, 1], [-1, 0]], [-1, -1], right="exit 3", code=3)
problem("singular, no solution: u runs away", [[1, -1], [-1, 1]], [-1, -1], right="exit 3", code=3, quick=True)
problem("singular, no solution, by a hair", [[1, -1, 0], [-1, 1, 0], [0, 0, 1]], [-1, 1 - 1e-3, 1], right="exit 3", code=3)
problem("singular, many solutions", [[1, -1], [-1, 1]], [-1, 1])
problem("positive definite, skew part 1e12", [[1, 1e12], [-1e12, 1]], [-1, -1])
problem("1e-300", [[1e-300]], [-1e-300], solution=[1])
problem("1e300", [[1e300]], [-1e300], solution=[1])
problem("q of 1e-310", [[1]], [-1e-310], solution=[1e-310])
problem("solution of 1e300", [[1e-150]], [-1e150], solution=[1e300])
problem("solution beyond the largest number", [[1e-300]], [-1e300], right="exit 3", code=3)

# ---------------------------------------------------------------- ranks


def elements(count, rest):
    """Half of the oscillators stay on their walls, the others never touch theirs: by elements, so by ranks."""
    return {
        "kind": "chain", "element": "wall", "count": count, "coupling": 0.0, "e": 0.5,
        "force": [FALL if rest(i) else 0.0 for i in range(count)],
        "x0": [0.0 if rest(i) else 1.0 for i in range(count)] + [0.0] * count,
    }  # fmt: skip


def stays(rest):
    def judge(run):
        count = run.model["count"]
        held = np.array([rest(i) for i in range(count)])
        q, impulse = run["x"][:, :count], run["mu"][1:, :, 1]
        return [
            ("moves", float(np.abs(q - np.where(held, 0.0, 1.0)).max()), 1e-14),
            ("impulses", float(np.abs(impulse - np.where(held, run.h, 0.0)).max()), 1e-15),
        ]

    return judge


for name, rest in (("all active", lambda i: True), ("none active", lambda i: False), ("active on one side only", lambda i: i < 30), ("a single one active", lambda i: i == 59)):
    add("ranks", name, moreau_jean(elements(60, rest), 1.0, 0.01), "closed form", stays(rest), ranks=(1, 2, 3), quick=name == "all active")
add("ranks", "one element on three ranks", scene(integrators(1, [1.0]), 2.0, 0.05), SAME, exact_homsp(), ranks=(1, 2, 3))
add("ranks", "one constraint of AB (65) on three ranks, primal-dual", scene(paper65(), 10.0, 0.05), SAME, exact_homsp(), ranks=(1, 2, 3), options=PRIMAL_DUAL)
balls = masses([[1, 0, 0], [-1, 1, 0], [0, -1, 1]], [0.5003, 1.7007, 3.0011], [0.0] * 3, [FALL] * 3, g0=[0.0, -1.0, -1.0])
add("ranks", "three balls on three ranks", moreau_jean(balls, 4.0, 0.01), SAME, exact_moreau_jean(), ranks=(1, 2, 3))
one = {"problem": {"M": [[2.0]], "q": [-1.0]}}
add("ranks", "a problem of one unknown on three ranks", one, "certified", complementary([0.5]), ranks=(1, 2, 3))

# ---------------------------------------------------------------- recording

wave = {"offset": -0.2, "amplitude": 1.0, "frequency": 0.31}
for name, output in (("every 7th step", {"every": 7}), ("first and last step", {"every": 10**6})):
    add("recording", name, scene(paper65(f=[0, 0, wave, 0, 0], x0=[0.3, 0, 0, 0, 0]), 10.0, 0.05, output), SAME + ", measures added up", exact_homsp(1e-9), quick="7th" in name)

# ---------------------------------------------------------------- theta and kappa

for theta in (0.5, 0.51, 1e-3, 1.0):
    flight = masses([[1], [-1]], [0.5], [1.0], [FALL], K=[[3.0]], g0=[0.0, 1.0], e=0.7, Cv=[[0.1]])
    add("theta", f"two walls and a spring, theta = {theta:g}", moreau_jean(flight, 3.0, 0.011, theta), SAME, exact_moreau_jean(1e-9))


def elastic(e):
    """Mechanical energy never rises, and is kept where e = 1, up to order h: an impact at speed 1.4 comes up to h late, and
    there are two in 5 s."""

    def judge(run):
        x, v = run["x"][:, 0], run["x"][:, 1]
        energy = 0.5 * v * v + x
        rises = np.diff(energy).max()
        return [("energy error / h", float(max(rises, abs(energy[-1] - energy[0]) if e == 1 else 0.0) / run.h), 10.0), ("outside by", float(max(0.0, -x.min())), 0.0)]

    return judge


for kappa in (1e-12, 0.5, 0.99):
    model = {"kind": "zhuravlev-ivanov", "kappa": kappa, "x0": 1.0, "v0": 0.0, "force": FALL}
    e = (1 - kappa) / (1 + kappa)
    add("theta", f"Zhuravlev-Ivanov, kappa = {kappa:g}", scene(model, 5.0, 1e-3, scheme="zhuravlev-ivanov"), "energy never rises", elastic(1 if e > 1 - 1e-9 else e))
for kappa in (0.0, 1.0):
    model = {"kind": "zhuravlev-ivanov", "kappa": kappa, "x0": 1.0, "v0": 0.0, "force": FALL}
    add("theta", f"Zhuravlev-Ivanov, kappa = {kappa:g}", scene(model, 5.0, 1e-3, scheme="zhuravlev-ivanov"), "refused by name", code=2, says="0 < kappa < 1")

# ---------------------------------------------------------------- a million steps

LONG = {"every": 10000}
MILLION = 10**6


def at_rest(limit):
    def judge(run):
        return [("drift of x", float(np.abs(run["x"][1:] - run["x"][1]).max()), limit), ("w", float(np.abs(run["w"][1:]).max()), limit)]

    return judge


def long(name, tables, right, judge):
    for verb in ("drift",):
        add(verb, name, {**tables, "output": LONG}, right, judge, ranks=(1,), solvers=("default",), timeout=1800)


resting = masses([[1]], [0.0], [0.0], [FALL])
twice = masses([[1, 0], [-1, 1], [0, 1]], [0.0, 1.0], [0.0, 0.0], [FALL, FALL], g0=[0.0, -1.0, -1.0])
H = 1e-2
long("mass at rest, Moreau-Jean", moreau_jean(resting, MILLION * H, H), "stays", at_rest(0.0))
long("two masses at rest under dependent constraints, Moreau-Jean", moreau_jean(twice, MILLION * H, H), "stays", at_rest(1e-9))
long("mass at rest, homsp", scene(integrators(2, [0.0, 0.0]), MILLION * H, H), "stays", at_rest(0.0))
CASES[-1].options = ()
long("mass at rest at x = 1, primal-dual", scene(integrators(2, [1.0, 0.0], w0=[-1.0]), MILLION * H, H), "stays", at_rest(0.0))
CASES[-1].options = PRIMAL_DUAL


def energy_kept(run):
    found = run["energy"][:, :2].sum(axis=1)
    return [("drift of the energy", float(np.abs(found / found[0] - 1.0).max()), 1e-9)]


long("ball bouncing, e = 1", moreau_jean(masses([[1]], [1.0], [0.0], [FALL], e=1.0), MILLION * H, H), "keeps its energy", energy_kept)
oscillator = masses([[1]], [1.0], [0.0], [0.0], K=[[1.0]], g0=[0.5], e=1.0)
long("oscillator before a wall, e = 1", moreau_jean(oscillator, MILLION * H, H), "keeps its energy", energy_kept)
