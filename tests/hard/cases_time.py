"""Hard moments: accumulations of impacts, tangents, many events in a step, data that violate constraints, small and large
steps, levels up to 8.
"""

import sys
from pathlib import Path

import numpy as np
from scenes import FALL, integrators, jerk_matrices, masses, moreau_jean, paper65, scene
from suite import SOLVERS, Case, exact_homsp, exact_moreau_jean, worst_of_all

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))
from exact import bouncing_ball

PRIMAL_DUAL = ("-sweepvi_form", "primal-dual")
SAME = "the same steps in 60 digits"
CASES = []


def add(group, name, *rest, **keys):
    CASES.append(Case(group, name, *rest, **keys))


def both_forms(group, name, tables, judge, quick=False):
    add(group, name, tables, SAME, judge, quick=quick)
    add(group, name + ", primal-dual", tables, SAME, judge, options=PRIMAL_DUAL)


# ---------------------------------------------------------------- Zeno


def bounces(restitution, per_step, x0=1.0, v0=0.0, gravity=1.0):
    """The exact motion through all accumulations; the error is at most per_step h, and 0 once at rest."""

    def judge(run):
        t = run["t"]
        exact_t, exact_x, _, _ = bouncing_ball(x0, v0, gravity, restitution, t[-1])
        count = run["x"].shape[1] // 2
        errors = [np.abs(run["x"][:, i] - np.interp(t, exact_t, exact_x)).max() for i in range(count)]
        return [("error / h", float(max(errors) / run.h), per_step), ("speed at the end", float(np.abs(run["x"][-1, count:]).max()), run.h * gravity)]

    return judge


ball = masses([[1]], [1.0], [0.0], [FALL], e=0.5)
add("Zeno", "ball, e = 0.5", moreau_jean(ball, 6.0, 5e-3), SAME, exact_moreau_jean(), quick=True)
# The scheme is of order 1: an impact found late by up to h at speed sqrt(2) makes 1.4 h, twice that with its rebound.
add("Zeno", "ball against its exact motion", moreau_jean(ball, 6.0, 5e-3), "error <= 3 h, at rest after 4.24 s", bounces(0.5, 3.0))
add("Zeno", "ball, no rebound after rest over 1e5 steps", moreau_jean(ball, 1000.0, 1e-2, output=None), "at rest", bounces(0.5, 3.0), ranks=(1,))  # fmt: skip
zi = {"kind": "zhuravlev-ivanov", "kappa": 1.0 / 3.0, "x0": 1.0, "v0": 0.0, "force": FALL}  # e = (1 - kappa) / (1 + kappa) = 1/2
# README.md, "ball of HO section II": .01015 at h = 1e-3 from a fall of four times the height, 10 h.
add("Zeno", "Zhuravlev-Ivanov ball", scene(zi, 6.0, 1e-3, scheme="zhuravlev-ivanov"), "error <= 20 h, at rest", bounces(0.5, 20.0), quick=True)
zi_chain = {"kind": "chain", "element": "zhuravlev-ivanov", "count": 20, "kappa": 1.0 / 3.0, "force": FALL, "x0": [1.0] * 20 + [0.0] * 20}
add("Zeno", "20 Zhuravlev-Ivanov balls, all at once", scene(zi_chain, 6.0, 1e-3, scheme="zhuravlev-ivanov"), "error <= 20 h, at rest", bounces(0.5, 20.0))  # fmt: skip
column = masses([[1, 0, 0], [-1, 1, 0], [0, -1, 1]], [0.5, 1.7, 3.0], [0.0] * 3, [FALL] * 3, g0=[0.0, -1.0, -1.0], e=0.5)
add("Zeno", "column of three balls, e = 0.5", moreau_jean(column, 6.0, 1e-2), SAME, exact_moreau_jean())

# ---------------------------------------------------------------- grazing: in binary fractions nothing is rounded

h = 2.0**-6
touch = 16  # the step that ends at the wall, with speed 0: x'' = 2, v_k = 2 h (k - touch)
graze = -h * sum(2 * h * (k - touch) for k in range(1, touch + 1))


def grazing(height, side=1.0, offset=0.0, **keys):
    """x'' = 2 towards the wall and away again; `side` -1: the upper wall of two; w = x + offset."""
    wall = {"w0": [-offset]} if side > 0 else {"w0": [1.0 - offset], "wmax": [1.0]}
    return scene(integrators(2, [offset + side * height, -side * 2 * h * touch], 2.0 * side, **wall, **keys), 40 * h, h)


def grazes(run):
    """Free flight, up to rounding: what pushes is no more than that. At the tangent, r* is a matter of rounding too."""
    k = np.arange(len(run["t"]))
    free = graze + h * np.cumsum(np.where(k > 0, 2 * h * (k - touch), 0.0))
    return [
        ("x", float(np.abs(run["x"][:, 0] - free).max()), 1e-14),
        ("impulses", float(np.abs(run["mu"]).max()), 1e-14),
        ("outside by", float(max(0.0, -run["w"].min())), 0.0),
    ]


for name, height, judge in (
    ("exactly tangent", graze, lambda run: exact_homsp(without=("mu",))(run) + grazes(run)),
    ("one rounding too high", graze * (1 + 2.0**-52), grazes),
    ("one rounding too low", graze * (1 - 2.0**-53), grazes),
):
    both_forms("grazing", name, grazing(height), judge, quick=name == "exactly tangent")
add("grazing", "exactly tangent to the upper of two walls", grazing(graze, -1.0), SAME, exact_homsp(), quick=True)
add("grazing", "exactly tangent, wall at x = 1, primal-dual", grazing(graze, 1.0, 1.0), SAME, exact_homsp(), options=PRIMAL_DUAL)
fall3 = integrators(3, [0.0, 0.0, 0.0], 0.0)
both_forms("grazing", "resting on the wall without weight, r = 3", scene(fall3, 1.0, h), lambda run: exact_homsp()(run) + [("impulses", float(np.abs(run["mu"]).max()), 0.0)])
grazing_ball = masses([[1]], [graze], [-2 * h * touch], [2.0], e=0.5)
add("grazing", "Moreau-Jean, tangent", moreau_jean(grazing_ball, 40 * h, h, 1.0), SAME, exact_moreau_jean())

# ---------------------------------------------------------------- all constraints in the same step


def like_one(single, columns):
    """Every element moves like a single one does."""

    def judge(run):
        count = run.model["count"]
        x = run["x"].reshape(len(run["t"]), count, columns)
        return [("elements differ by", float(np.abs(x - x[:, :1]).max()), 1e-12), *single(run, x[:, 0])]

    return judge


def jerk_single(run, x):
    from scheme_steps import Homsp

    exact = Homsp(**{k: v for k, v in jerk_matrices(1, 0.0, base=0.5, spread=0.0).items()}, h=run.h)
    states = [exact.x] + [list(exact.step().x) for _ in range(len(x) - 1)]
    return [("x", worst_of_all(x, np.array(states, float)), 1e-10)]


ring = {"kind": "chain", "element": "jerk", "count": 100, "coupling": 0.5, "topology": "ring", "base": 0.5, "spread": 0.0}
add("all at once", "ring of 100 jerk elements", scene(ring, 4.0, 0.02), "each like a single one", like_one(jerk_single, 5), ranks=(1, 2, 3), quick=True)  # fmt: skip


def wall_single(run):
    count = run.model["count"]
    q = run["x"][:, :count]
    exact = exact_moreau_jean()
    single = masses([[1]], [0.5], [0.0], [-0.5], e=0.5)
    shadow = type("Shadow", (), {"model": single, "time": run.time, "h": run.h, "case": run.case})()
    shadow.__class__.__getitem__ = lambda _, name: {"x": run["x"][:, [0, count]], "w": run["w"][:, :1], "mu": run["mu"][:, :1]}[name]
    return [("elements differ by", float(np.abs(q - q[:, :1]).max()), 1e-12), *exact(shadow)]


walls = {"kind": "chain", "element": "wall", "count": 100, "coupling": 1.0, "topology": "ring", "base": 0.5, "amplitude": 0.0}
add("all at once", "ring of 100 walls, e = 0.5", moreau_jean(walls, 4.0, 0.01), "each like a single one", wall_single, ranks=(1, 2, 3))


def touching(count):
    """A ball hits a row of others, all touching: Moreau's law makes all move on with v / N."""

    def judge(run):
        v = run["x"][1, count:]
        impulse = (count - np.arange(1, count)) / count
        return [
            ("speeds", float(np.abs(v - 1.0 / count).max() * count), 1e-9),
            ("impulses", float(np.abs(run["mu"][1, :, 1] - impulse).max()), 1e-9),
        ]

    return judge


def row_of_balls(count):
    H = [(k, k, -1.0) for k in range(count - 1)] + [(k, k + 1, 1.0) for k in range(count - 1)]
    text = lambda rows, entries: f"%%MatrixMarket matrix coordinate real general\n{rows} {count} {len(entries)}\n" + "".join(
        f"{i + 1} {j + 1} {value!r}\n" for i, j, value in entries
    )
    zeros = [(i, i, 0.0) for i in range(count)]
    files = {"M.mtx": text(count, [(i, i, 1.0) for i in range(count)]), "K.mtx": text(count, zeros), "H.mtx": text(count - 1, H)}
    model = {"kind": "lagrangian", "M": "M.mtx", "K": "K.mtx", "H": "H.mtx", "q0": [0.0] * count, "v0": [1.0] + [0.0] * (count - 1)}
    return moreau_jean(model, 0.01, 0.01, 1.0), files


for count, quick in ((100, True), (1000, False), (10000, False)):
    tables, files = row_of_balls(count)
    add("all at once", f"{count} touching balls", tables, "v / N each; impulses (N - k) / N", touching(count), files=files, quick=quick, timeout=600)

# ---------------------------------------------------------------- several events in one step

wave = lambda period, amplitude: {"amplitude": amplitude, "frequency": 1.0 / period, "phase": 0.3}
for name, period in (("two steps", 0.1), ("one step", 0.05), ("a third of a step", 0.05 / 3), ("1e-6 of a step", 0.05e-6)):
    push = {**wave(period, 3.0), "offset": FALL, "phase": 0.7}
    both_forms("within one step", f"force of period {name}", scene(integrators(2, [0.1, 0.0], push), 5.0, 0.05), exact_homsp(1e-8 if period > 1e-3 else 1e-6))  # t itself is rounded
both_forms("within one step", "from wall to wall", scene(integrators(2, [0.5, 30.0], wave(0.37, 40.0), wmax=[1.0]), 5.0, 0.05), exact_homsp(), quick=True)
both_forms("within one step", "from wall to wall, r = 4", scene(integrators(4, [0.5, 30.0, 0.0, 0.0], wave(1.9, 90.0), wmax=[1.0]), 8.0, 0.05), exact_homsp())  # fmt: skip
add("within one step", "Moreau-Jean, e = 1, two walls passed in a step", moreau_jean(masses([[1], [-1]], [0.5], [30.0], [0.0], g0=[0.0, 1.0], e=1.0), 5.0, 0.05), SAME, exact_moreau_jean())  # fmt: skip

# ---------------------------------------------------------------- inconsistent data

for name, model in {
    "position, r = 2": integrators(2, [-1.0, 0.5]),
    "velocity, r = 2": integrators(2, [0.0, -3.0]),
    "both, r = 2": integrators(2, [-1.0, -3.0]),
    "all levels, r = 4": integrators(4, [-1.0, -2.0, -3.0, -4.0]),
    "levels 1 and 3, r = 4": integrators(4, [-1.0, 2.0, -3.0, 4.0]),
    "beyond the upper wall, r = 3": integrators(3, [2.0, 3.0, 4.0], wmax=[1.0]),
    "beyond the lower of two walls, r = 3": integrators(3, [-2.0, 3.0, -4.0], wmax=[1.0]),
    "AB (65), all levels": paper65(x0=[-1, -1, -1, 1, 1]),
}.items():
    both_forms("inconsistent data", name, scene(model, 3.0, 0.05), exact_homsp(), quick="all levels, r = 4" == name)
add("inconsistent data", "Moreau-Jean, below the floor and falling", moreau_jean(masses([[1]], [-0.5], [-1.0], [FALL], e=0.5), 3.0, 0.05), SAME, exact_moreau_jean())  # fmt: skip

# ---------------------------------------------------------------- relative degree and step

for r in range(1, 9):
    fall = scene(integrators(r, [1.0] + [-1.0] * (r - 1)), 2.4, 0.02)
    both_forms("relative degree", f"r = {r}: impact and rest", fall, exact_homsp(), quick=r in (1, 8))
    push = {"offset": -0.3, "amplitude": 1.0, "frequency": 1 / 6}
    both_forms("relative degree", f"r = {r}: forced", scene(integrators(r, [0.1] + [-0.5] * (r - 1), push), 12.0, 0.1), exact_homsp(1e-9))
    # AB (32)-(45): z_i(0) = -1 on all levels is projected level by level: mu_i = -z_i(0) - h z_{i+1}(1) = 1, on level r 1 + h.
for step in (1e-9, 1e-6, 1e-3, 1.0):
    near = integrators(2, [1.0 + 10.25 * step, -1.0], FALL, w0=[-1.0])
    add("step", f"h = {step:g}: impact at x = 1", scene(near, 60 * step, step), SAME, exact_homsp(), quick=step == 1e-9)
    # x is rounded to 1e-16 where the wall is at 1: what is left of distances of h is 1e-16 / h.
    add("step", f"h = {step:g}: impact at x = 1, primal-dual", scene(near, 60 * step, step), SAME, exact_homsp(max(1e-10, 1e-14 / step)), options=PRIMAL_DUAL)  # fmt: skip
    leave = integrators(2, [1.0, 0.0], 1e-3, w0=[-1.0])
    add("step", f"h = {step:g}: slow lift-off at x = 1, primal-dual", scene(leave, 60 * step, step), "leaves, " + SAME, exact_homsp(max(1e-10, 1.0)), options=PRIMAL_DUAL)  # fmt: skip
    add("step", f"h = {step:g}: AB (65)", scene(paper65(x0=[0.5 * step, -1.0, -1.0, 0.3, 0.1]), 60 * step, step), SAME, exact_homsp())
    add("step", f"h = {step:g}: Moreau-Jean", moreau_jean(masses([[1]], [10.25 * step], [-1.0], [FALL], e=0.5), 60 * step, step), SAME, exact_moreau_jean())
