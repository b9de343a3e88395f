"""Event-driven solutions of linear complementarity systems in 60 digits.

Between events x' = A x + B lambda + f with M lambda = -(z_r' at lambda = 0) on constraints in contact (degree 0:
C x + D lambda + w0 = wall), by Taylor series as long as they are accurate to 50 digits. The first root of a free constraint's
distance from its walls, or of a contact's lambda, is the next event: intervals without a root are excluded by bounds on the
second derivative, roots on monotone ones found by Newton's method; what neither decides is `Grazing`. At an event the state
jumps by the measures of all levels i <= r*, x+ = x- + sum d_{a,i} mu_{a,i}, 0 <= z_{a,i}+ _|_ mu_{a,i} >= 0, again until
nobody heads out. Who touches with all outputs 0 stays in contact or leaves as the Taylor coefficients of w and lambda decide,
the first that is not 0 first.
"""

from dataclasses import dataclass, field
from itertools import product

import numpy as np
from decimals import ONE, ZERO, Decimal, box_solutions, dot, identity, solve

TERMS = 48
CONVERGED = Decimal(10) ** -52
SNAP = Decimal(10) ** -34  # outputs below it, relative to the state, are 0
CELLS = 64
# Of a constraint: it meets its wall (or a jump takes it there); it leaves it. A jump's measures on one in contact, and the
# leave of one that only the jump took to its wall, are kicks and rebounds: no change of contact.
IMPACT, LIFT_OFF, KICK, REBOUND = "impact", "lift-off", "kick", "rebound"


class Grazing(Exception):
    """The solution is not decided: a double root, an accumulation, an LCP without or with several solutions."""


@dataclass
class Solution:
    t: list  # as asked for
    x: list = field(default_factory=list)  # states then, right limits at events
    events: list = field(default_factory=list)  # (t, constraint, kind)
    margins: list = field(default_factory=list)  # (t, how far a decision was from another one)
    size: Decimal = ZERO  # largest |x_i|

    def margin(self, t, v):
        if v:
            self.margins.append((t, abs(v)))


def value(p, s):
    total = ZERO
    for c in reversed(p):
        total = total * s + c
    return total


def derivative(p):
    return [k * c for k, c in enumerate(p)][1:]


def first_root(p):
    """(The first root in (0, 1] or None, least value at an interior minimum before it or None) of p, p(0) > 0."""
    c = np.array([float(v) for v in p])
    k = np.arange(len(c))
    s = np.linspace(0.0, 1.0, CELLS + 1)
    polynomial = np.polynomial.polynomial
    v, second = polynomial.polyval(s, c), polynomial.polyval(s, polynomial.polyder(c, 2) if len(c) > 2 else [0.0])
    fourth = float((np.abs(c) * k * (k - 1) * (k - 2) * (k - 3)).sum())  # bounds the fourth derivative on [0, 1]
    bend = np.maximum(np.abs(second[:-1]), np.abs(second[1:])) + fourth / CELLS**2 / 8  # and the second one on each cell
    noise = 1e-13 * float((np.abs(c) * (1 + k * k)).sum())
    low = np.minimum(v[:-1], v[1:]) - bend / CELLS**2 / 8 - noise
    half = ONE / (2 * CELLS)
    root, before = None, CELLS
    for i in map(int, np.flatnonzero(low <= 0)):
        middle = (2 * i + 1) * half
        root = root_in(shifted(p, middle, half))
        if root is not None:
            root, before = middle + half * root, i + 1
            break
    return root, min((v[i] for i in range(1, before) if v[i] <= v[i - 1] and v[i] < v[i + 1]), default=None)


def shifted(p, middle, half):
    """q(s) = p(middle + half s)."""
    p = list(p)
    for first in range(len(p) - 1):
        for k in range(len(p) - 2, first - 1, -1):
            p[k] += middle * p[k + 1]
    power = ONE
    for k in range(len(p)):
        p[k] *= power
        power *= half
    return p


def root_in(p, depth=0):
    """The first root of p in (-1, 1], where p > 0 up to -1; None if there is none."""
    if p[0] > sum(map(abs, p[1:])):
        return None
    slope = derivative(p)
    if slope and abs(slope[0]) > sum(map(abs, slope[1:])):  # monotone
        if slope[0] > 0 or sum(p) > 0:
            return None
        a, b, s = -ONE, ONE, ZERO
        for _ in range(200):
            at = value(p, s)
            a, b = (s, b) if at > 0 else (a, s)
            new = s - at / value(slope, s)
            if abs(new - s) <= CONVERGED:
                return new
            s = new if a < new < b else (a + b) / 2
        return b
    if depth == 60:
        raise Grazing("a double root")
    half = ONE / 2
    for middle in (-half, half):
        root = root_in(shifted(p, middle, half), depth + 1)
        if root is not None:
            return middle + half * root
    return None


class EventDriven:
    """Solves one system once: `EventDriven(system).run(end, times)`. `push`: constant force in addition, on each state."""

    def __init__(self, system, x0=None, push=None, most_events=60):
        self.system, self.x, self.t = system, list(x0 or system.x0), ZERO
        self.push = push
        self.n, self.m = len(system.A), len(system.C)
        self.sparse_A = [[(j, v) for j, v in enumerate(row) if v] for row in system.A]
        self.sparse_C = [[(j, v) for j, v in enumerate(row) if v] for row in system.C]
        last = [system.rows[system.first[a + 1] - 1] if r else system.C[a] for a, r in enumerate(system.degree)]
        self.sparse_last = [[(j, v) for j, v in enumerate(row) if v] for row in last]
        self.inverses = {}
        self.contact = [0] * self.m
        self.most_events = most_events

    # ------------------------------------------------------------ motion

    def multipliers(self, contact):
        """(those in contact, inverse of M on them)."""
        key = tuple(contact)
        if key not in self.inverses:
            held = [a for a in range(self.m) if contact[a]]
            block = [[self.system.markov[a][b] for b in held] for a in held]
            self.inverses[key] = held, solve(block, identity(len(held)))
        return self.inverses[key]

    def walls(self, contact):
        return [ZERO if side < 0 else self.system.wmax[a] if side > 0 else None for a, side in enumerate(contact)]

    def series(self, contact, count, f, above):
        """Taylor coefficients: states, lambda, w, `count` of each."""
        system = self.system
        held, inverse = self.multipliers(contact)
        if inverse is None:
            raise Grazing("contacts whose multipliers are not unique")
        walls = self.walls(contact)
        x, X, L, W = self.x, [], [], []
        for k in range(count):
            rate = [sum([v * x[j] for j, v in row], c) for row, c in zip(self.sparse_A, f[k])]
            Cx = [sum([v * x[j] for j, v in row], system.w0[a] if k == 0 else ZERO) for a, row in enumerate(self.sparse_C)]
            lam = [ZERO] * self.m
            if held:
                free = [
                    sum([v * rate[j] for j, v in self.sparse_last[a]], above[k][a]) if system.degree[a]
                    else Cx[a] - (walls[a] if k == 0 else ZERO)
                    for a in held
                ]  # fmt: skip
                for a, row in zip(held, inverse):
                    lam[a] = -dot(row, free)
            W.append([Cx[a] + dot(system.D[a], lam) for a in range(self.m)])
            X.append(x)
            L.append(lam)
            for a in held:
                if lam[a]:
                    rate = [v + b * lam[a] if b else v for v, b in zip(rate, system.pushes[a])]
            x = [v / (k + 1) for v in rate]
        return X, L, W

    def forces(self, count):
        f, above = self.system.taylor_forcing(self.t, count)
        if self.push:
            f[0] = [v + p for v, p in zip(f[0], self.push)]
        return f, above

    def outputs(self):
        """z, with what is 0 (or at its wall) but for rounding exactly there. A push leaves outputs as they are: it stands
        for errors, which the level rule does not see either."""
        system = self.system
        size = 1 + max(abs(v) for v in self.x)
        z = system.outputs(self.t, self.x)
        for a, r in enumerate(system.degree):
            for i in range(system.first[a], system.first[a] + r):
                if abs(z[i]) <= SNAP * size:
                    z[i] = ZERO
                elif i == system.first[a] and system.wmax[a] is not None and abs(z[i] - system.wmax[a]) <= SNAP * size:
                    z[i] = system.wmax[a]
        return z

    # ------------------------------------------------------------ events

    def heads_out(self, z):
        system = self.system
        for a, r in enumerate(system.degree):
            side = system.side(a, z) if r else 0
            if not side:
                continue
            own = system.of(a, z)
            distances = [own[0] if side < 0 else system.wmax[a] - own[0]] + [-side * v for v in own[1:]]
            if next((v for v in distances if v), ZERO) < 0:
                return True
        return False

    def jump(self, z, solution):
        """Measures of all levels i <= r*: new z; moves x."""
        system = self.system
        boxes, _ = system.boxes(z)
        used = [q for q, box in enumerate(boxes) if box != (None, None)]
        guess = [(-1 if boxes[q][0] is not None else 1) if (boxes[q][0] is None or z[q] <= boxes[q][0]) else 0 for q in used]
        matrix = [[system.cross[i][j] for j in used] for i in used]
        found = next(box_solutions(matrix, [z[q] for q in used], [boxes[q] for q in used], guess), None)
        if found is None:
            raise Grazing("a jump without solution")
        snap = SNAP * (1 + max(map(abs, self.x)))
        measures, after = ({q: v if abs(v) > snap else ZERO for q, v in zip(used, values)} for values in (found[1], found[0]))
        for q, old in enumerate(z):  # what decides: signs of measures, of what is left of outputs, of outputs in the level rule
            solution.margin(self.t, measures.get(q) or after.get(q, old))
        self.x = [v + sum((d[i] * measures[q] for q, d in enumerate(system.directions) if measures.get(q)), ZERO) for i, v in enumerate(self.x)]
        new = self.outputs()
        for q, value_ in after.items():
            new[q] = value_ if abs(value_) <= snap or value_ == boxes[q][1] else new[q]
        return new, [a for a in range(self.m) if any(measures.get(q) for q in range(system.first[a], system.first[a + 1]))]

    def decide(self, z, solution):
        """Contact of all constraints after t: the one whose series of w and lambda begin with the right signs."""
        system = self.system
        options = []
        for a, r in enumerate(system.degree):
            side = system.side(a, z) if r else 0
            if r == 0:
                options.append([-1, 0] + ([1] if system.wmax[a] is not None else []))
            elif side and not any(system.of(a, z)[1:]):
                options.append([side, 0])
            else:
                options.append([0])
        count = max(system.degree) + 5
        forces = self.forces(count)
        fits = []
        for contact in sorted(product(*options), key=lambda c: c.count(0)):
            try:
                _, L, W = self.series(contact, count, *forces)
            except Grazing:
                continue
            leading = [self.leading(a, contact[a], z, L, W) for a in range(self.m) if len(options[a]) > 1]
            if all(v >= 0 for v in leading):
                fits.append((contact, leading))
        if not fits:
            raise Grazing("nobody can say who stays in contact")
        contact, leading = fits[0]
        for v in leading:
            solution.margin(self.t, v)
        return list(contact)

    def leading(self, a, side, z, L, W):
        """The first coefficient that is not 0 of what must not be negative."""
        system = self.system
        if side:
            series = [[-side * row[a] for row in L]]
        else:
            low = [row[a] for row in W]
            series = [low]
            if system.wmax[a] is not None:
                series.append([system.wmax[a] - low[0]] + [-v for v in low[1:]])
            if system.degree[a]:
                series = [series[0] if system.side(a, z) < 0 else series[1]]
        size = 1 + max(abs(v) for v in self.x)
        return min(next((v for v in one if abs(v) > SNAP * size), ZERO) for one in series)

    def at_event(self, touched, solution):
        """Jumps, then who is in contact; tells the events of this instant. `touched`: constraints that met a wall."""
        system = self.system
        z, kicked, there = self.outputs(), set(), set(touched)
        for jumps in range(20):
            for a, r in enumerate(system.degree):
                if r and not self.contact[a] and system.side(a, z):
                    touched.add(a)
                    if jumps == 0:
                        there.add(a)
            if not self.heads_out(z):
                break
            z, moved = self.jump(z, solution)
            kicked.update(moved)
        else:
            raise Grazing("jumps without end")
        before, self.contact = self.contact, self.decide(z, solution)
        for a, r in enumerate(system.degree):
            if r == 0 and self.contact[a] and not before[a]:
                touched.add(a)
                there.add(a)
            if r == 0 and before[a] and self.contact[a] and before[a] != self.contact[a]:
                raise Grazing("from wall to wall")
        thrown = {a for a in range(self.m) if before[a] and self.contact[a] and before[a] != self.contact[a]}  # from wall to wall
        touched |= thrown
        solution.events += [(self.t, a, IMPACT) for a in sorted(touched)]
        solution.events += [(self.t, a, KICK) for a in sorted(kicked - touched)]
        away = [a for a in range(self.m) if a in thrown or ((before[a] or a in touched) and not self.contact[a])]
        solution.events += [(self.t, a, LIFT_OFF if before[a] or a in there else REBOUND) for a in away]
        if len(solution.events) > self.most_events:
            raise Grazing("too many events")
        return z

    def guards(self, z, L, W, H):
        """{(constraint, wall)}: polynomials on [0, 1], s = tau / H, that are positive until the next event."""
        system = self.system
        size = 1 + max(abs(v) for v in self.x)
        powers = [ONE]
        for _ in W[1:]:
            powers.append(powers[-1] * H)
        for a, r in enumerate(system.degree):
            if self.contact[a]:
                yield (a, 0), [-self.contact[a] * row[a] * p for row, p in zip(L, powers)]
                continue
            low = [row[a] * p for row, p in zip(W, powers)]
            for side in (-1, 1) if system.wmax[a] is not None else (-1,):
                yield (a, side), low if side < 0 else [system.wmax[a] - low[0]] + [-v for v in low[1:]]

    def run(self, end, times):
        """The solution up to `end`, with states at `times`."""
        solution = Solution(list(times))
        waiting = list(times)
        z = self.at_event(set(), solution)
        solution.events.clear()
        fresh = True  # an event stands at t
        while True:
            X, L, W = self.series(self.contact, TERMS, *self.forces(TERMS))
            size = 1 + max(abs(v) for v in self.x)
            bounds = [max(max(map(abs, X[k])), max(map(abs, W[k])), max(map(abs, L[k]))) for k in range(TERMS - 4, TERMS)]
            H = min(ONE, end - self.t)
            for k, bound in zip(range(TERMS - 4, TERMS), bounds):
                if bound:
                    H = min(H, (CONVERGED * size / bound) ** (ONE / k))
            first, hit = None, set()
            polynomials = dict(self.guards(z, L, W, H))
            for (a, side), p in polynomials.items():
                if fresh:
                    while len(p) > 1 and abs(p[0]) <= SNAP * size:  # leaves its wall, or begins to push, from 0
                        p = p[1:]
                if p[0] < 0:
                    raise Grazing("behind the wall")
                if all(abs(c) <= SNAP * size for c in p):  # neither pushed nor away from its wall
                    continue
                root, least = first_root(p)
                if least is not None:
                    solution.margin(self.t, Decimal(least))
                if root is not None and (first is None or root < first):
                    first = root
            tau = H if first is None else first * H
            while waiting and waiting[0] < self.t + tau:
                solution.x.append(self.state(X, waiting.pop(0) - self.t))
            self.x = self.state(X, tau)
            solution.size = max(solution.size, *map(abs, self.x))
            self.t += tau
            fresh = first is not None
            if fresh:
                for (a, side), p in polynomials.items():
                    if abs(value(p, first)) <= SNAP * size and not (p[0] == 0 and len(p) == 1):
                        hit.add((a, side))
                z = self.at_event({a for a, side in hit if side and self.system.degree[a]}, solution)
                solution.size = max(solution.size, *map(abs, self.x))
            if self.t >= end - Decimal(10) ** -45:
                solution.x += [self.x for _ in waiting]
                return solution

    def state(self, X, tau):
        x = [ZERO] * self.n
        for row in reversed(X):
            x = [v * tau + c for v, c in zip(x, row)]
        return x


class Bouncing(EventDriven):
    """Masses with Newton's restitution: all degrees 2, and of those at their wall 0 <= p _|_ z_2+ + e z_2- >= 0; positions do
    not jump."""

    def __init__(self, system, e, **known):
        super().__init__(system, **known)
        self.e = [Decimal(v) for v in e]

    def jump(self, z, solution):
        system = self.system
        used = [system.first[a] + 1 for a in range(self.m) if system.side(a, z)]
        least = [-self.e[a] * z[system.first[a] + 1] for a in range(self.m) if system.side(a, z)]
        matrix = [[system.cross[i][j] for j in used] for i in used]
        moved = [z[q] - v for q, v in zip(used, least)]
        found = next(box_solutions(matrix, moved, [(ZERO, None)] * len(used), [-1] * len(used)), None)
        if found is None:
            raise Grazing("a jump without solution")
        snap = SNAP * (1 + max(map(abs, self.x)))
        measures = {q: v if abs(v) > snap else ZERO for q, v in zip(used, found[1])}
        after = {q: v + low for q, v, low in zip(used, found[0], least)}
        for q, rest in zip(used, found[0]):
            solution.margin(self.t, measures[q] or (rest if abs(rest) > snap else ZERO) or after[q])
        self.x = [v + sum((system.directions[q][i] * p for q, p in measures.items() if p), ZERO) for i, v in enumerate(self.x)]
        new = self.outputs()
        for q, v in after.items():
            new[q] = v if abs(v) > snap else ZERO
        return new, [a for a in range(self.m) if measures.get(system.first[a] + 1)]
