"""The table of the tests of orders: what is run, what its error is measured by, and between which numbers its order lies."""

import math
from dataclasses import dataclass, field

import numpy as np
from orders_models import bounce, linear, masses, signal, slide, tracked_flight, twist


@dataclass(frozen=True)
class Band:
    """An order and what is left for the finite step."""

    low: float
    high: float
    why: str


@dataclass(frozen=True)
class Case:
    name: str
    model: dict
    end: float
    schemes: tuple
    band: Band
    steps: tuple  # groups of numbers of steps; the errors of a group are averaged
    norms: tuple = ("final",)  # columns of `sweepvi study`
    time: dict = field(default_factory=dict)  # keys of the scene
    components: tuple = ()  # of the state; none: all
    exact: tuple = ()  # the state at the end, for what orders_exact.py does not follow


# Smooth phases: e = c h^p (1 + O(h)). Rates of the models are below 5 (4 of them (s + 1)^4), steps from end/40 on, ends
# around 1: with 160 steps and more the second term is some per cent at the coarsest step and changes by 7/8 of that
# over three doublings.
SMOOTH = ((40,), (80,), (160,), (320,))
ONE = Band(0.96, 1.04, "implicit Euler's error is c h (1 + c' h), c' h some per cent at the coarsest of steps 8 times apart")
TWO = Band(1.96, 2.04, "the midpoint rule's error is c h^2 (1 + c' h^2), c' h^2 below a per cent: the band is that of one")
HALF_LINE = Band(0.96, 1.04, "theta = 3/4: the second derivative counts half, and the order is one, not two")

# Across events: an event falls anywhere within its step, so that the factor c of e = c h depends on where: it jumps up and
# down by as much as itself from one step to the next, and a line through single errors is a lottery. With K, K+1, ...,
# K+6 steps the fraction K t/end of an event at t moves by t/end each time, evenly through the step: the mean is that over
# all places to about 1/7. Means good to 15 % at steps 6.25 times apart: log(1.15) sqrt(2) / log(6.25) = 0.1, and 0.05 as above.
EVENTS = tuple(tuple(range(first, first + 7)) for first in (80, 200, 500))
# Velocities up to 40 and a dozen changes of sign: the same with finer steps.
FINE = tuple(tuple(range(first, first + 7)) for first in (200, 500, 1250))
ACROSS = Band(0.85, 1.15, "the mean over the places of events in their steps is c h, known to 15 % at steps 6.25 times apart")
JUMPS = Band(0.85, 1.15, "in L1 a jump that comes late by a part of h counts as that part of its height; the mean as above")

ALL = ("homsp", "zd-euler", "naive-euler")
HOMSP = ("homsp",)


def linear_cases():
    wave = signal(-0.5, 1.0, 0.5)
    for r in (1, 2, 3, 4):
        free = linear([r], [2.0, 0.5, 0.0, 0.0][:r] + [0.5, 0.5], [wave])
        yield Case(f"r = {r}, free", free, 1.0, ALL, ONE, SMOOTH)
        held = linear([r], [0.0] * r + [0.5, 0.5], [signal(-3.0, 1.0, 0.5)])
        # naive Euler's lambda is of z's rounding times h^-r, AB after (48): beyond r = 2 its contact is noise at small h.
        yield Case(f"r = {r}, in contact", held, 1.0, ALL if r <= 2 else HOMSP, ONE, SMOOTH)
    # One impact, contact, lift-off and flight; r = 1: and a second impact.
    pull = signal(-2.0, 3.0, 0.25, 3.0)
    hits = {
        1: ([0.5], signal(-0.5, 2.0, 0.5, 3.0), 2.5),
        2: ([0.5, 0.0], signal(-1.5, 3.0, 0.25, 3.0), 4.0),
        3: ([0.5, 0.0, -0.5], pull, 4.0),
        4: ([0.5, -0.5, 0.0, 0.0], pull, 4.0),
    }
    for r, (z, force, end) in hits.items():
        model = linear([r], [*z, 0.5, 0.5], [force])
        yield Case(f"r = {r}, across events", model, end, ALL if r == 1 else HOMSP, ACROSS, EVENTS, ("final", "l1"))
    model = linear([2], [0.5, 0.0, 0.5, 0.5], [hits[2][1]])
    # Their multiplier stands on the last level alone: an impact of r = 2 takes two steps, (0 - z_1)/h in the first.
    yield Case("r = 2, across events", model, 4.0, ALL[1:], ACROSS, EVENTS)
    model = linear([3], [0.5, 0.0, -0.5, 0.5, 0.5], [pull])
    why = "z_1 put to 0 in one step leaves z_3 = O(1/h) behind, AB (54)-(55): the error grows like 1/h, and no order is left"
    yield Case("r = 3, across an impact", model, 2.0, ALL[1:], Band(-1.6, -0.4, why), EVENTS)


def coupled_cases():
    quick, slow = signal(-0.5, 2.0, 0.5, 3.0), signal(-2.0, 3.0, 0.25, 3.0)
    starts = {1: [0.5], 2: [0.5, 0.0], 3: [0.5, 0.0, -0.5], 4: [0.5, -0.5, 0.0, 0.0]}
    for degrees in ((1, 2), (1, 3), (2, 4)):
        forces = [quick if degrees[0] == 1 else slow, slow]
        model = linear(degrees, sum((starts[r] for r in degrees), []), forces, oscillator=False, weight=0.5)
        yield Case(f"r = {degrees}, across events", model, 3.5, HOMSP, ACROSS, EVENTS)
        away = dict(model, x0=sum(([2.0] + [0.0] * (r - 1) for r in degrees), []))
        yield Case(f"r = {degrees}, free", away, 0.8, HOMSP, ONE, SMOOTH)
    # With D the solution is continuous and piecewise smooth.
    spring = {
        "kind": "linear", "A": [[0.0, 1.0], [-1.0, 0.0]], "B": [[0.0], [1.0]], "C": [[1.0, 0.0]], "D": [[0.25]],
        "f": [0.0, 0.0],
    }  # fmt: skip
    mixed = {
        "kind": "linear", "A": [[0.0, 1.0, 0.0], [-1.0, -0.2, 0.5], [1.0, 0.0, -0.5]], "B": [[0.0, 0.0], [1.0, 0.5], [0.5, 1.0]],
        "C": [[1.0, 0.0, 0.0], [0.0, 0.0, 1.0]], "D": [[0.5, 0.0], [0.0, 0.0]], "f": [-0.2, 0.0, -0.6],
    }  # fmt: skip
    yield Case("r = 0, lambda = 0", dict(spring, x0=[0.5, 1.0]), 1.5, ALL, ONE, SMOOTH)
    yield Case("r = 0, lambda > 0", dict(spring, x0=[-0.5, -0.5]), 0.8, ALL, ONE, SMOOTH)
    yield Case("r = 0, across events", dict(spring, x0=[0.5, 1.0]), 5.0, ALL, ACROSS, EVENTS)
    yield Case("r = (0, 1), across events", dict(mixed, x0=[0.5, 0.5, 0.6]), 5.0, ALL, ACROSS, EVENTS)


def sweeping_cases():
    scheme = ("catching-up",)
    flow = {"kind": "sweeping", "A": [[-0.5, 1.0], [-1.0, -0.5]], "f": [0.5, signal(0.0, 1.0, 0.4)]}
    box = dict(
        flow, u0=[0.2, 0.0], lower=[signal(-0.3, 0.5, 0.5), -0.4], upper=[signal(0.5, 0.5, 0.5), signal(0.4, 0.2, 1.0)]
    )
    polyhedron = dict(
        flow, u0=[0.1, 0.2], G=[[1.0, 1.0], [1.0, -1.0], [-1.0, 0.2]],
        g=[signal(-0.5, 0.6, 0.5), signal(-0.6, 0.5, 0.3), -0.8],
    )  # fmt: skip
    yield Case("a moving box, across events", box, 3.0, scheme, ACROSS, EVENTS)
    yield Case("a moving polyhedron, across events", polyhedron, 3.0, scheme, ACROSS, EVENTS)
    # Pushed all the time along a bound that moves: that component is exact, the other one feels it.
    pushed = dict(box, lower=[signal(0.2, 1.0, 0.25), -3.0], upper=[math.inf, 3.0])
    yield Case("a moving box, pushed", pushed, 0.5, scheme, ONE, SMOOTH)
    pushed = dict(polyhedron, g=[signal(0.3, 1.5, 0.25), -3.0, -3.0])
    yield Case("a moving half-plane, pushed", pushed, 0.5, scheme, ONE, SMOOTH)
    free = dict(box, lower=[-3.0, -3.0], upper=[3.0, 3.0])
    yield Case("a box far away", free, 1.0, scheme, ONE, SMOOTH)


def moreau_jean_cases():
    scheme, force = ("moreau-jean",), signal(-1.0, 3.0, 0.25, 3.0)
    for theta, band in ((1.0, ONE), (0.75, HALF_LINE), (0.5, TWO)):
        yield Case(f"masses in flight, theta = {theta}", masses(0.0, force, [2.0, 2.0]), 0.8, scheme, band, SMOOTH, time={"theta": theta})
        # The second mass swings, and the wall carries what that does to the first one.
        resting = masses(0.0, -8.0, [0.0, 2.0])
        yield Case(f"masses, one at rest, theta = {theta}", resting, 0.8, scheme, band, SMOOTH, time={"theta": theta})
    ends = {0.0: 2.5, 0.5: 1.35, 1.0: 2.2}  # before impacts accumulate
    for e, end in ends.items():
        for theta in (1.0, 0.5):
            name, time = f"masses before walls, e = {e}, theta = {theta}", {"theta": theta}
            model = masses(e, force, [0.5, 0.8])
            yield Case(name, model, end, scheme, JUMPS, EVENTS, ("l1",), time)
            if e > 0:
                yield Case(f"{name}, positions", model, end, scheme, ACROSS, EVENTS, ("l1",), time, (0, 1))
    for theta in (1.0, 0.5):
        model = masses(1.0, force, [0.5, 0.8], shared=True)
        yield Case(f"masses in a row, theta = {theta}", model, 2.2, scheme, JUMPS, EVENTS, ("l1",), {"theta": theta})
    # Where a gap is found closed from q + h v, and v becomes 0, up to h |v| of it is left: the mass falls once more, and
    # meets the wall with sqrt(2 a h |v|), after a time O(sqrt(h)). In L1 that is O(h).
    model, why = masses(0.0, force, [0.5, 0.8]), "velocities of O(sqrt(h)) where a mass falls through what the impact left of its gap"
    half = Band(0.35, 0.65, why)
    yield Case("masses before walls, e = 0, filled graphs", model, 2.5, scheme, half, EVENTS, ("hausdorff",), {"theta": 1.0})
    time = {"theta": 1.0, "detection": "current"}  # found when it has passed the wall: nothing is left to fall
    yield Case("the same, detected at q < 0", model, 2.5, scheme, ACROSS, EVENTS, ("hausdorff",), time)


def impact_cases():
    scheme, weight = ("zhuravlev-ivanov",), signal(-9.81, 4.0, 0.5)
    ball = {"kind": "zhuravlev-ivanov", "kappa": 0.2, "x0": 2.0, "v0": -1.0, "force": weight}
    chain = {
        "kind": "chain", "element": "zhuravlev-ivanov", "count": 3, "coupling": 4.0, "kappa": 0.2, "force": weight,
        "x0": [1.0, 1.5, 1.2, 0.0, 0.0, 0.0],
    }  # fmt: skip
    for theta, band in ((1.0, ONE), (0.5, TWO)):
        time = {"theta": theta}
        yield Case(f"a ball in flight, theta = {theta}", ball, 0.5, scheme, band, SMOOTH, time=time)
        yield Case(f"a chain in flight, theta = {theta}", chain, 0.3, scheme, band, SMOOTH, time=time)
        yield Case(f"a bouncing ball, theta = {theta}", ball, 1.3, scheme, JUMPS, EVENTS, ("l1",), time)
        yield Case(f"bouncing balls on springs, theta = {theta}", chain, 0.9, scheme, JUMPS, EVENTS, ("l1",), time)


def controlled_cases():
    scheme, kappa = ("zhuravlev-ivanov",), 0.5
    for theta, smooth in ((1.0, ONE), (0.5, TWO)):
        time = {"theta": theta}
        gains, bodies = (10.0, 4.0), [(3.0, 2.0)]
        model = {
            "kind": "zhuravlev-ivanov", "kappa": kappa, "x0": 3.0, "v0": 2.0, "force": 0.0,
            "regulator": dict(zip(("mu1", "mu2"), gains)),
        }  # fmt: skip
        exact, changes = twist(kappa, gains, bodies, np.array([0.0]), 1.35)
        assert changes >= 2, changes
        yield Case(f"regulator, theta = {theta}", model, 1.35, scheme, ACROSS, FINE, time=time, exact=tuple(exact))
        gains, bodies = (30.0, 17.0), [(6.0, 5.0), (3.0, 3.0)]
        model = {
            "kind": "zhuravlev-ivanov", "kappa": kappa, "x0": 6.0, "v0": 5.0, "force": -9.81,
            "regulator": dict(zip(("mu1", "mu2"), gains)),
            "reference": {"kappa": kappa, "x0": 3.0, "v0": 3.0, "force": -19.81},
        }  # fmt: skip
        exact, changes = twist(kappa, gains, bodies, np.array([0.0, -19.81]), 0.785)
        assert changes >= 6, changes
        yield Case(f"tracking, theta = {theta}", model, 0.785, scheme, ACROSS, FINE, time=time, exact=tuple(exact))
        force = signal(-19.81, 20.0, 3.0, 0.5)
        exact = tracked_flight(kappa, gains, bodies, force, 0.06)
        flight = dict(model, reference=dict(model["reference"], force=force))
        yield Case(f"tracking in flight, theta = {theta}", flight, 0.06, scheme, smooth, SMOOTH, time=time, exact=tuple(exact))


CASES = (
    *linear_cases(), *coupled_cases(), *sweeping_cases(), *moreau_jean_cases(), *impact_cases(), *controlled_cases()
)  # fmt: skip


# ---------------------------------------------------------------- hybrid: tolerances instead of steps


@dataclass(frozen=True)
class Tolerated:
    name: str
    model: dict
    end: float
    exact: tuple


def tolerated_cases():
    paper65 = (2.038074313834594676, 0.453192855214661465, -1.056047929937494749, 2.615870338795054074, 0.624221522682221825)
    yield Tolerated("AB (65)", linear([3], [1.0, 0.0, 0.0, 0.0, 0.0], [0.0]), 10.0, paper65)  # tests/reference/README.md
    e, kappa = 0.8, 1 / 9
    end = 2.5
    exact, bounces = bounce(4.0, 9.81, e, 1.0, 0.0, end)
    assert bounces >= 3
    ball = {"kind": "lagrangian", "M": [[1.0]], "K": [[4.0]], "H": [[1.0]], "q0": [1.0], "v0": [0.0], "e": e, "f": [-9.81]}
    yield Tolerated("a mass on a spring before a wall", ball, end, tuple(exact))
    # One element between fixed ends: x'' = -2 coupling x - 9.81.
    oscillator = {"kind": "chain", "element": "zhuravlev-ivanov", "count": 1, "coupling": 2.0, "kappa": kappa, "x0": [1.0, 0.0]}
    yield Tolerated("the same as an impact oscillator", oscillator, end, tuple(exact))
    exact, events = slide(0.5, 0.4, 0.5, 1.0, 5.5)
    assert events >= 3
    pushed = {"kind": "sweeping", "u0": [1.0], "A": [[-1.0]], "lower": [signal(0.5, 0.4, 0.5)]}
    yield Tolerated("a point pushed along", pushed, 5.5, tuple(exact))


TOLERATED = tuple(tolerated_cases())
TOLERANCES = (1e-4, 1e-6, 1e-8, 1e-10, 1e-12)
