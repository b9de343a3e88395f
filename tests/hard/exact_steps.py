"""The schemes in 60-digit arithmetic, written from the formulas alone: what a run of the program is judged by.

Small and slow: matrices are dense lists of Decimal, each step's complementarity problem is solved by trying active
sets. Only where two sets both fit does a tolerance decide, 40 digits below the size of the terms.
"""

from decimal import Decimal, DefaultContext, setcontext
from itertools import product

DefaultContext.prec = 60  # of threads to come
setcontext(DefaultContext)
TINY = Decimal(10) ** -40
INFINITY = Decimal("Infinity")
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899862803482534211706798214808651")


def exact(value):
    """A number (a double is taken for what it is), or lists of them."""
    return [exact(v) for v in value] if isinstance(value, (list, tuple)) else Decimal(value)


def times(a, b):
    """Matrix by matrix, or matrix by vector."""
    if a and not isinstance(b[0], list):
        return [sum((p * q for p, q in zip(row, b) if p), Decimal(0)) for row in a]
    columns = list(zip(*b))
    return [[sum((p * q for p, q in zip(row, column) if p), Decimal(0)) for column in columns] for row in a]


def solve(a, b):
    """x with a x = b (b a matrix), by elimination with pivots. None if a is singular."""
    n = len(a)
    rows = [list(left) + list(right) for left, right in zip(a, b)]
    for k in range(n):
        pivot = max(range(k, n), key=lambda i: abs(rows[i][k]))
        if abs(rows[pivot][k]) <= TINY * max(abs(v) for v in a[pivot if pivot == k else k]):
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        head = rows[k][k]
        for i in range(n):
            if i != k and rows[i][k]:
                factor = rows[i][k] / head
                rows[i] = [u - factor * v for u, v in zip(rows[i], rows[k])]
    return [[v / rows[i][i] for v in rows[i][n:]] for i in range(n)]


def sine(x):
    x %= 2 * PI
    term = total = x
    k = 1
    while abs(term) > Decimal(10) ** -70:
        term *= -x * x / ((k + 1) * (k + 2))
        total += term
        k += 2
    return total


class Signal:
    """offset + amplitude sin(2 pi frequency t + phase), and its derivatives."""

    def __init__(self, given):
        given = {"offset": given} if not isinstance(given, dict) else given
        self.offset, self.amplitude, self.frequency, self.phase = (
            Decimal(given.get(key, 0)) for key in ("offset", "amplitude", "frequency", "phase")
        )

    def at(self, t, derivative=0):
        if not self.amplitude:
            return self.offset if derivative == 0 else Decimal(0)
        rate = 2 * PI * self.frequency
        wave = self.amplitude * rate**derivative * sine(rate * t + self.phase + derivative * PI / 2)
        return wave + (self.offset if derivative == 0 else 0)


def box_solutions(m, q, boxes):
    """All z = q + m mu, l <= z <= b, mu >= 0 only where z = l, mu <= 0 only where z = b: (z, mu, places) one by one.

    `boxes`: (lower, upper) of each row, None where there is no bound. `places`: 0 free, -1 at lower, 1 at upper; in a
    degenerate problem the largest set of rows at a bound comes first.
    """
    size = len(q)
    choices = [([-1] if low is not None else []) + ([1] if high is not None else []) + [0] for low, high in boxes]
    for places in sorted(product(*choices), key=lambda p: p.count(0)):
        held = [i for i in range(size) if places[i]]
        target = [boxes[i][0] if places[i] < 0 else boxes[i][1] for i in held]
        mu = [Decimal(0)] * size
        if held:
            found = solve([[m[i][j] for j in held] for i in held], [[t - q[i]] for t, i in zip(target, held)])
            if found is None:
                continue
            for i, (value,) in zip(held, found):
                mu[i] = value
        z = [v + w for v, w in zip(q, times(m, mu))]
        for t, i in zip(target, held):
            z[i] = t
        scale = [abs(v) + sum(abs(p * w) for p, w in zip(row, mu)) for v, row in zip(q, m)]
        for i in held:
            if abs(mu[i] * m[i][i]) <= TINY * scale[i]:
                mu[i] = Decimal(0)
        fits = all(
            -places[i] * mu[i] >= 0
            if places[i]
            else (low is None or z[i] >= low - TINY * scale[i]) and (high is None or z[i] <= high + TINY * scale[i])
            for i, (low, high) in enumerate(boxes)
        )
        if fits:
            for i, bounds in enumerate(boxes):
                for bound in bounds:
                    if bound is not None and abs(z[i] - bound) <= TINY * scale[i]:
                        z[i] = bound
            yield z, mu, places


class Homsp:
    """AB (32)-(45) for several constraints, as README.md has it."""

    def __init__(self, A, B, C, x0, h, f=None, w0=None, wmax=None, start=0):
        self.A, self.B, self.C, self.x, self.h = exact(A), exact(B), exact(C), exact(x0), Decimal(h)
        n, m = len(self.A), len(self.C)
        self.f = [Signal(s) for s in (f or [0] * n)]
        self.w0 = exact(w0 or [0] * m)
        self.wmax = [None if w is None or Decimal(w) == INFINITY else Decimal(w) for w in (wmax or [None] * m)]
        self.t = Decimal(start)
        self.rows, self.first, self.degree, columns = [], [0], [], []
        for a in range(m):
            row, size, pushed, levels = self.C[a], [abs(v) for v in self.C[a]], None, []
            for _ in range(n):
                levels.append(row)
                reach = times([row], self.B)[0]
                terms = times([size], [[abs(v) for v in row] for row in self.B])[0]
                if any(abs(v) > TINY * t for v, t in zip(reach, terms)):
                    break
                row = times([row], self.A)[0]
                size = [sum(s * abs(v) for s, v in zip(size, column)) for column in zip(*self.A)]
            else:
                raise ValueError(f"constraint {a} has no relative degree")
            r = len(levels)
            krylov = [[row[a] for row in self.B]]
            for _ in range(r - 1):
                krylov.append(times(self.A, krylov[-1]))
            gram = [[sum(p * q for p, q in zip(level, k)) for k in krylov] for level in levels]
            gamma = solve(gram, [[Decimal(int(i == j)) for j in range(r)] for i in range(r)])
            for i in range(r):
                columns.append([sum(gamma[k][i] * krylov[k][j] for k in range(r)) for j in range(n)])
            self.rows += levels
            self.degree.append(r)
            self.first.append(self.first[-1] + r)
        self.D = [list(v) for v in zip(*columns)]
        identity = [[Decimal(int(i == j)) for j in range(n)] for i in range(n)]
        self.inverse = solve([[e - self.h * a for e, a in zip(*pair)] for pair in zip(identity, self.A)], identity)
        self.M = times(times(self.rows, self.inverse), self.D)
        self.cross = times(self.rows, self.D)
        self.lower_levels = [q for a in range(m) for q in range(self.first[a], self.first[a + 1] - 1)]
        self.markov = [Decimal(1)] * len(self.rows)
        for a in range(m):
            self.markov[self.first[a + 1] - 1] = sum(
                p * row[a] for p, row in zip(self.rows[self.first[a + 1] - 1], self.B)
            )
        self.z = [v + g for v, g in zip(times(self.rows, self.x), self.forcing(self.t))]
        self.mu = [Decimal(0)] * len(self.rows)
        self.level = [0] * m
        self.step_number, self.start = 0, Decimal(start)

    def forcing(self, t):
        """g of each output: w0 on level 1, sum_p C A^(i-2-p) f^(p) on level i."""
        g = []
        for a in range(len(self.C)):
            for i in range(1, self.degree[a] + 1):
                value = self.w0[a] if i == 1 else Decimal(0)
                for p in range(i - 1):
                    row = self.rows[self.first[a] + i - 2 - p]
                    value += sum(c * s.at(t, p) for c, s in zip(row, self.f) if c)
                g.append(value)
        return g

    def boxes(self):
        boxes, self.side = [], []
        for a, r in enumerate(self.degree):
            z = self.z[self.first[a] : self.first[a + 1]]
            side = -1 if z[0] <= 0 else 1 if self.wmax[a] is not None and z[0] >= self.wmax[a] else 0
            star = 1
            if side:
                while star < r and (star == 1 or -side * z[star - 1] <= 0):
                    star += 1
            self.level[a] = star
            self.side.append(side)
            boxes.append((Decimal(0), self.wmax[a]))
            for i in range(2, r + 1):
                boxes.append((None, None) if i > star else (Decimal(0), None) if side < 0 else (None, Decimal(0)))
        return boxes

    def step(self):
        old, old_g = self.t, self.forcing(self.t)
        self.step_number += 1
        self.t = self.start + self.step_number * self.h
        g = self.forcing(self.t)
        boxes = self.boxes()
        used = [q for q, box in enumerate(boxes) if box != (None, None)]
        phi = [self.h * s.at(self.t) for s in self.f]
        if any(s.amplitude for s in self.f) and self.lower_levels:
            image = times(self.rows, phi)
            defect = [[self.h * g[q + 1] - (g[q] - old_g[q]) - image[q]] for q in self.lower_levels]
            c = solve([[self.cross[i][j] for j in self.lower_levels] for i in self.lower_levels], defect)
            for (value,), q in zip(c, self.lower_levels):
                phi = [p + value * row[q] for p, row in zip(phi, self.D)]
        free = times(self.inverse, [x + p for x, p in zip(self.x, phi)])
        q = [v + w for v, w in zip(times(self.rows, free), g)]
        found = next(
            box_solutions([[self.M[i][j] for j in used] for i in used], [q[i] for i in used], [boxes[i] for i in used]),
            None,
        )
        if found is None:
            raise ArithmeticError(f"step {self.step_number} has no solution")
        z, mu, _ = found
        self.mu = [Decimal(0)] * len(self.rows)
        for place, value in zip(used, mu):
            self.mu[place] = value
        self.x = [v + w for v, w in zip(free, times(self.inverse, times(self.D, self.mu)))]
        self.z = [v + w for v, w in zip(times(self.rows, self.x), g)]
        for place, value in zip(used, z):
            self.z[place] = value
        return self

    def measures(self):
        """As /mu has them: the highest level in units of lambda."""
        return [value / unit for value, unit in zip(self.mu, self.markov)]


class MoreauJean:
    """AB (22)-(24) with theta: M dv + h (C v + K q - f)_theta = H' p, H v+ >= -e H v-, where a gap is detected."""

    AHEAD = {"predicted": Decimal(1), "midpoint": Decimal("0.5"), "current": Decimal(0)}

    def __init__(self, M, K, H, q0, v0, h, C=None, f=None, g0=None, e=0, theta=1, detection="predicted"):
        n, m = len(q0), len(H)
        self.M, self.K, self.H, self.q, self.v = exact(M), exact(K), exact(H), exact(q0), exact(v0)
        self.C = exact(C or [[0] * n] * n)
        self.f, self.h, self.theta = [Signal(s) for s in (f or [0] * n)], Decimal(h), Decimal(theta)
        self.e = exact(e if isinstance(e, list) else [e] * m)
        self.ahead = self.AHEAD[detection]
        self.gap = [v + g for v, g in zip(times(self.H, self.q), exact(g0 or [0] * m))]
        self.speed = times(self.H, self.v)
        self.detection, self.steps = detection, 0
        w = self.h * self.theta
        J = [[m + w * c + w * w * k for m, c, k in zip(*rows)] for rows in zip(self.M, self.C, self.K)]
        identity = [[Decimal(int(i == j)) for j in range(n)] for i in range(n)]
        self.inverse = solve(J, identity)
        self.push = times(self.inverse, [list(c) for c in zip(*self.H)])
        self.delassus = times(self.H, self.push)

    def step(self):
        h, theta, rest = self.h, self.theta, 1 - self.theta
        t = [self.steps * h, (self.steps + 1) * h]
        self.steps += 1
        force = [theta * s.at(t[1]) + rest * s.at(t[0]) for s in self.f]
        moved = [q + h * theta * rest * v for q, v in zip(self.q, self.v)]
        right = [
            m + h * (f - rest * c - k)
            for m, f, c, k in zip(times(self.M, self.v), force, times(self.C, self.v), times(self.K, moved))
        ]
        free = times(self.inverse, right)
        tested = [g + self.ahead * h * s for g, s in zip(self.gap, self.speed)]
        closed = [a for a, g in enumerate(tested) if (g < 0 if self.detection == "current" else g <= 0)]
        bounds = [-self.e[a] * self.speed[a] for a in closed]
        q = [v - b for v, b in zip((times(self.H, free)[a] for a in closed), bounds)]
        m = [[self.delassus[a][b] for b in closed] for a in closed]
        found = next(box_solutions(m, q, [(Decimal(0), None)] * len(closed)), None)
        if found is None:
            raise ArithmeticError(f"step {self.steps} has no solution")
        self.impulse = [Decimal(0)] * len(self.H)
        for a, p in zip(closed, found[1]):
            self.impulse[a] = p
        v_new = [v + p for v, p in zip(free, times(self.push, self.impulse))]
        speed = times(self.H, v_new)
        for a, z, b in zip(closed, found[0], bounds):
            speed[a] = z + b
        self.gap = [g + h * (theta * new + rest * old) for g, new, old in zip(self.gap, speed, self.speed)]
        self.q = [q + h * (theta * new + rest * old) for q, new, old in zip(self.q, v_new, self.v)]
        self.v, self.speed = v_new, speed
        return self
