"""Random systems (tests/reference/random_systems.py) against 60 digits: steps of HOMSP, and event-driven solutions.

usage: random_runs.py steps|events|impacts SEED [--count N] [--tolerance X] [--step S] [--ranks N] [--option=WORD]...

What is asked of a run: steps: no level of r* differs but where an output is within 1e3 roundings of deciding otherwise, and
states are within 1e3 times what a rounding in each step makes of the exact run. events: states within 10 x tolerance x size x
kappa, size the largest |x_i|, kappa the exact solution's own response to perturbations of tolerance x size, in the start and,
as a force, all along; every impact and lift-off, and no other; the recorded w is C x + D lambda + w0. Systems with kappa above
1e4, and those that such perturbations lead onto another course, are drawn again before the program sees them. impacts: the
same of bouncing masses.
"""

import argparse
import math
import random
import sys
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from functools import cache, partial

import numpy as np
import suite
from event_driven import IMPACT, KICK, LIFT_OFF, Bouncing, EventDriven, Grazing
from decimals import Decimal
from linear_system import LinearSystem, masses
from random_systems import random_masses, random_model
from scenes import scene
from scheme_steps import Homsp
from suite import Case, floats

ROUNDING = 2.0**-53
ROUNDINGS = 1e3
END = 3.0
SAMPLES = 24  # times at which states are compared
LARGEST_KAPPA = 1e4


def keys(model):
    return {name: value for name, value in model.items() if name != "kind"}


# ---------------------------------------------------------------- steps


class Rounded(Homsp):
    """The same, with a rounding of the largest state in each step."""

    def __init__(self, draw, *rest, **known):
        super().__init__(*rest, **known)
        self.draw = draw

    def step(self):
        super().step()
        unit = Decimal(ROUNDING) * max(map(abs, self.x))
        error = [unit * self.draw.choice([-1, 1]) for _ in self.x]
        self.x = [v + e for v, e in zip(self.x, error)]
        # What is held stays exactly where it is.
        self.z = [z if place else z + sum(r * e for r, e in zip(row, error)) for z, place, row in zip(self.z, self.places, self.system.rows)]
        return self


def steps_of(seed):
    """Case of HOMSP on the system of this seed."""
    model, degree = random_model(seed)
    draw = random.Random(f"steps {seed}")
    h, count = draw.choice([0.02, 0.05, 0.1]), draw.choice([40, 60])
    table = scene(model, count * h, h, scheme="homsp")
    h = table["time"]["end"] / count

    def trajectory(make):
        exact = make(**keys(model), h=h)
        x, z, level = [exact.x], [exact.z], [[0] * len(exact.level)]
        for _ in range(count):
            exact.step()
            x.append(exact.x)
            z.append(exact.z)
            level.append(list(exact.level))
        return floats(x), floats(z), np.array(level), exact.system

    @cache
    def known():
        rounded = [trajectory(lambda **given: Rounded(random.Random(f"{seed} {k}"), **given)) for k in range(2)]
        return trajectory(Homsp), rounded

    def judge(run):
        (x, z, level, system), others = known()
        last = count  # up to where roundings do not change the course
        for _, _, other, _ in others:
            changed = np.flatnonzero((other != level).any(axis=1))
            last = min(last, changed[0] - 1 if changed.size else count)
        moved = np.maximum.accumulate(np.max([np.abs(other[0] - x).max(axis=1) for other in others], axis=0))
        size = np.maximum.accumulate(np.abs(x).max(axis=1))
        allowed = np.maximum(moved, ROUNDING * size)
        wrong = 0
        degree = np.array(system.degree)
        differing = np.flatnonzero(((run["level"] != level) & (degree > 0)).any(axis=1))
        if differing.size and differing[0] <= last:
            k = last = differing[0]
            for a in np.flatnonzero(run["level"][k] != level[k]):
                own = z[k - 1][system.first[a] : system.first[a + 1]]
                rows = floats(system.rows[system.first[a] : system.first[a + 1]])
                near = ROUNDINGS * (np.abs(rows).sum(axis=1) * allowed[k - 1])
                walls = [0.0] + ([float(system.wmax[a])] if system.wmax[a] is not None else [])
                distance = np.array([min(abs(own[0] - w) for w in walls), *map(abs, own[1:])])
                wrong += not ((distance > 0) & (distance <= near)).any()
            last -= 1
        verdicts = [("steps with another r*", float(wrong), 0)]
        bounds = {"x": allowed[:, None]}
        if system.rows:  # what roundings of x make of an output, and of what moves with time in it
            size_of = np.abs(floats(system.rows)).sum(axis=1)
            bounds["z"] = allowed[:, None] * size_of + ROUNDING * np.maximum.accumulate(np.abs(z))
        for name, exact in {"x": x, "z": z}.items():
            if name in bounds and name in run.data:
                over = np.abs(run[name] - exact) / (ROUNDINGS * bounds[name])
                verdicts.append((f"{name} over its bound", float(over[: last + 1].max()), 1.0))
        return verdicts

    return Case("random systems", f"seed {seed}, r = {degree}", table, "the same steps in 60 digits", judge)


# ---------------------------------------------------------------- events


@dataclass
class Course:
    """An exact solution, and how it answers to perturbations of `step` = tolerance x size."""

    times: list
    x: np.ndarray
    events: dict  # constraint -> [(kind, t)]
    others: list  # (constraint, kind, t) of kicks (which may be told as impacts) and rebounds (as lift-offs)
    size: float
    margin: float
    step: float = 0.0
    kappa: float = 1.0  # of states
    late: float = 1.0  # of times of events
    jumps: list = field(default_factory=list)


def system_of(model):
    """(system, how it is solved)"""
    if model["kind"] == "linear":
        return LinearSystem(**keys(model)), EventDriven
    parts = {name: value for name, value in keys(model).items() if name != "e"}
    return LinearSystem(**masses(**parts)), partial(Bouncing, e=model["e"])


def course(system, solver, **changes):
    times = [Decimal(END) * k / SAMPLES for k in range(1, SAMPLES + 1)]
    solution = solver(system, **changes).run(Decimal(END), times)
    events, others = {}, []
    for t, a, kind in solution.events:
        if kind in (IMPACT, LIFT_OFF):
            events.setdefault(a, []).append((kind, t))
        else:
            others.append((a, IMPACT if kind == KICK else LIFT_OFF, t))
    margin = min((float(v) for _, v in solution.margins), default=math.inf)
    return Course(times, solution.x, events, others, float(solution.size), margin, jumps=sorted({t for t, *_ in solution.events}))


def kinds(events):
    return {a: [kind for kind, _ in own] for a, own in events.items()}


def perturbed(system, solver, step, draw, count):
    """Courses of the system whose start and forces are off by `step`; the start not where it is at a wall, which is where it
    has to stay."""
    z = system.outputs(Decimal(0), system.x0)
    at_wall = any(system.side(a, z) for a, r in enumerate(system.degree) if r)
    off = lambda size: [Decimal(step) * size * draw.choice([-1, 1]) for _ in system.x0]
    for _ in range(count):
        push = off(1 / Decimal(END))
        x0 = [v + d for v, d in zip(system.x0, off(0 if at_wall else 1))]
        yield course(system.perturbed(push), solver, x0=x0)


def answers(system, solver, exact, tolerance, draw, count=3):
    """`exact` with its kappa; Grazing where the system is of no use for this tolerance."""
    if exact.size < 1e-3:
        raise Grazing("rests")
    step = tolerance * exact.size
    kappa, late = 1.0, 1.0
    for other in perturbed(system, solver, step, draw, count):
        if kinds(other.events) != kinds(exact.events):
            raise Grazing("another course")
        pairs = [(float(abs(s - t)), s, t) for a, own in exact.events.items() for (_, s), (_, t) in zip(own, other.events[a])]
        late = max([late, *(apart / step for apart, *_ in pairs)])
        for k, t in enumerate(exact.times):
            if not any(min(a, b) <= t <= max(a, b) for _, a, b in pairs):
                kappa = max(kappa, max(float(abs(p - q)) for p, q in zip(exact.x[k], other.x[k])) / step)
    if kappa > LARGEST_KAPPA:
        raise Grazing("kappa")
    near = 10 * step * max(kappa, late)
    gaps = [float(b - a) for a, b in zip(exact.jumps, [*exact.jumps[1:], Decimal(END)])]
    if exact.margin <= near or (exact.jumps and (min(gaps) <= near or float(exact.jumps[0]) <= near)):
        raise Grazing("within the tolerance of another course")
    return replace(exact, step=step, kappa=kappa, late=late)


def events_of(seed, tolerance, step=END / SAMPLES, perturbations=3, bouncing=False):
    """(Case of the hybrid scheme on the system of this seed, its exact course); Grazing where it is of no use."""
    model = random_masses(seed) if bouncing else random_model(seed)[0]
    system, solver = system_of(model)
    exact = answers(system, solver, course(system, solver), tolerance, random.Random(f"events {seed}"), perturbations)
    table = scene(model, END, step, scheme="hybrid", tolerance=tolerance)

    def judge(run):
        allowed = 10 * exact.step * exact.kappa
        near = 10 * exact.step * exact.late + 1e-14
        t, x = run["t"], run["x"]
        error = 0.0
        for when, state in zip(exact.times, floats(exact.x)):
            recorded = abs(float(when) / step - round(float(when) / step)) < 1e-9
            if not recorded or any(abs(float(when - s)) <= near for s in exact.jumps):
                continue
            row = np.flatnonzero(np.abs(t - float(when)) <= 1e-12)
            error = max(error, float(np.abs(x[row[-1]] - state).max()) if row.size else math.inf)
        found = told(run)
        verdicts = [("error over its bound", error / allowed, 1.0), *events_verdicts(exact, found, near), *consistent(run, system)]
        if "solver/error" in run.data:
            estimate = float(run["solver/error"][-1])
            run.ratio = estimate / max(error, 1e-300)
            rounding = 16 * ROUNDING * exact.size * exact.kappa  # which no estimate need tell
            verdicts.append(("error over estimate", error / max(estimate, rounding), 10.0))
        run.distance = error
        return verdicts

    return Case("random systems", f"seed {seed}, {'masses' if bouncing else f'r = {system.degree}'}, hybrid, tolerance {tolerance:g}", table, "event-driven solution", judge), exact


def told(run):
    """Impacts and lift-offs of a run after its start, constraint by constraint; levels of one impact are one event."""
    found = {}
    for row in run.data.get("events", []):
        event = (IMPACT if row["kind"] == 0 else LIFT_OFF, float(row["t"]))
        own = found.setdefault(int(row["constraint"]), [])
        if row["t"] > 0 and (row["kind"] == 1 or event not in own):
            own.append(event)
    return found


def events_verdicts(exact, found, near):
    near = max(near, 1e-13)
    missed = extra = 0
    late = 0.0
    for a in {*exact.events, *found}:
        told = list(found.get(a, []))
        for kind, t in exact.events.get(a, []):
            same = [e for e in told if e[0] == kind and abs(e[1] - float(t)) <= near]
            missed += not same
            if same:
                nearest = min(same, key=lambda e: abs(e[1] - float(t)))
                told.remove(nearest)
                late = max(late, abs(nearest[1] - float(t)))
        may = [(kind, float(t)) for b, kind, t in exact.others if b == a]
        extra += sum(1 for kind, t in told if not any(kind == k and abs(s - t) <= near for k, s in may))
    return [("events missed", float(missed), 0), ("events invented", float(extra), 0), ("late", late, near)]


def consistent(run, system):
    """Outputs come from states: |w - (C x + w0)| at rounding, constraints without D."""
    C, x, w0 = floats(system.C), run["x"], np.array(system.w0, float)
    plain = np.array(system.degree) > 0
    # Of a state that vanishes: what it was, and a thousandth of what it is a sum of.
    terms = (np.abs(x) + np.abs(x).max(axis=0) + 1e-3 * np.abs(x).max()) @ np.abs(C).T + np.abs(w0)
    off = np.abs(run["w"] - (x @ C.T + w0)) / np.maximum(terms, 1e-300)
    return [("w - C x - w0 over terms", float(off[:, plain].max(initial=0.0)), 1e-13)]


# ---------------------------------------------------------------- the runs


def cases(kind, seed, count, **how):
    """(case, exact course or None) of the first `count` systems from this seed that are of use; says what was left out."""
    found, left_out = 0, Counter()
    while found < count:
        name = f"{seed}.{found + left_out.total()}"
        try:
            made = (steps_of(name), None) if kind == "steps" else events_of(name, **how)
        except Grazing as why:
            left_out[str(why)] += 1
            continue
        found += 1
        yield made
    if left_out:
        print(f"left out before any run: {dict(left_out)}", file=sys.stderr)


def main(kind, seed, count, options=(), ranks=1, out=sys.stdout, **how):
    """Runs them; returns how many did not end as they should (hybrid may refuse 2 in 100)."""
    begin = time.monotonic()
    wrong, refused, ratios, worst = 0, 0, [], {}
    for case, exact in cases(kind, seed, count, **how):
        case.options = options
        with suite.program.temporary_folder() as folder:
            run = suite.Run(case, ranks, "default", folder)
            verdicts = run.verdicts()
        if run.code == 2:
            refused += 1
            print(f"refused {case.name}: {run.error[-300:]}", file=sys.stderr, flush=True)
            continue
        bad = [(what, value, limit) for what, value, limit in verdicts if not value <= limit]
        wrong += bool(bad)
        for what, value, limit in bad:
            detail = f", kappa {exact.kappa:.2g}, error {getattr(run, 'distance', math.nan):.2g}" if exact else ""
            print(f"FAILED {case.name}: {what} = {value:.3g}, more than {limit:.3g}{detail}", file=sys.stderr, flush=True)
        for what, value, _ in verdicts:
            if math.isfinite(value):
                worst[what] = max(worst.get(what, 0.0), value)
        if hasattr(run, "ratio"):
            ratios.append(run.ratio)
    numbers = ", ".join(f"{what} {value:.2g}" for what, value in worst.items())
    if ratios:
        numbers += f", median of estimate over error {np.median(ratios):.3g}"
    title = " ".join([kind, *(f"{key} {value:g}" for key, value in how.items() if key != "bouncing"), *options])
    print(f"| {title} | seed {seed} | {count} systems | wrong {wrong}, refused {refused} | {numbers} | {time.monotonic() - begin:.0f} s |", file=out, flush=True)  # fmt: skip
    too_many = kind == "steps" and refused or refused > count // 50
    return wrong + bool(too_many) + bool(ratios and np.median(ratios) > 100)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("kind", choices=["steps", "events", "impacts"])
    parser.add_argument("seed")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--tolerance", type=float, default=1e-8)
    parser.add_argument("--step", type=float, default=END / SAMPLES, help="of recording; a part of 3 s")
    parser.add_argument("--option", action="append", default=[], help="word handed to the program")
    parser.add_argument("--ranks", type=int, default=1)
    given = parser.parse_args()
    how = {} if given.kind == "steps" else {"tolerance": given.tolerance, "step": given.step, "bouncing": given.kind == "impacts"}
    sys.exit(1 if main(given.kind, given.seed, given.count, given.option, given.ranks, **how) else 0)
