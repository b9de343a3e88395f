"""Numbers with 60 digits: linear algebra, signals, and box VIs by active sets.

Matrices are dense lists of Decimal. Only where two active sets both fit does a tolerance decide, 40 digits below the
size of the terms.
"""

from decimal import Decimal, DefaultContext, setcontext
from itertools import product

DefaultContext.prec = 60  # of threads to come
setcontext(DefaultContext)
ZERO, ONE = Decimal(0), Decimal(1)
TINY = Decimal(10) ** -40
INFINITY = Decimal("Infinity")
PI = Decimal("3.14159265358979323846264338327950288419716939937510582097494459230781640628620899862803482534211706798214808651")


def exact(value):
    """A number (a double is taken for what it is), or lists of them."""
    return [exact(v) for v in value] if isinstance(value, (list, tuple)) else Decimal(value)


def dot(row, x):
    return sum((p * q for p, q in zip(row, x) if p), ZERO)


def times(a, b):
    """Matrix by matrix, or matrix by vector."""
    if not a or not isinstance(b[0], list):
        return [dot(row, b) for row in a]
    columns = list(zip(*b))
    return [[dot(row, column) for column in columns] for row in a]


def identity(n):
    return [[Decimal(int(i == j)) for j in range(n)] for i in range(n)]


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
        self.rate = 2 * PI * self.frequency

    def at(self, t, derivative=0):
        if not self.amplitude:
            return self.offset if derivative == 0 else ZERO
        wave = self.amplitude * self.rate**derivative * sine(self.rate * t + self.phase + derivative * PI / 2)
        return wave + (self.offset if derivative == 0 else 0)

    def derivatives(self, t, count):
        """[f(t), f'(t), ...], `count` of them."""
        if not self.amplitude:
            return [self.offset] + [ZERO] * (count - 1)
        angle = self.rate * t + self.phase
        wave = [self.amplitude * sine(angle), self.amplitude * sine(angle + PI / 2)]
        values, power = [], ONE
        for k in range(count):
            values.append((-power if k % 4 > 1 else power) * wave[k % 2])
            power *= self.rate
        values[0] += self.offset
        return values


class Combined:
    """sum of weights times signals."""

    def __init__(self, weights, signals):
        self.parts = [(w, s) for w, s in zip(weights, signals) if w]
        self.amplitude = any(s.amplitude for _, s in self.parts)

    def at(self, t, derivative=0):
        return sum((w * s.at(t, derivative) for w, s in self.parts), ZERO)

    def derivatives(self, t, count):
        parts = [(w, s.derivatives(t, count)) for w, s in self.parts]
        return [sum((w * values[k] for w, values in parts), ZERO) for k in range(count)]


# ---------------------------------------------------------------- box VIs


def values_at(m, q, boxes, places):
    """(z, mu, sizes of the terms of z) where rows are at their bounds as `places` says: 0 free, -1 lower, 1 upper. None if
    the held block is singular."""
    held = [i for i, place in enumerate(places) if place]
    target = [boxes[i][0] if places[i] < 0 else boxes[i][1] for i in held]
    mu = [ZERO] * len(q)
    if held:
        found = solve([[m[i][j] for j in held] for i in held], [[t - q[i]] for t, i in zip(target, held)])
        if found is None:
            return None
        for i, (value,) in zip(held, found):
            mu[i] = value
    z = [v + w for v, w in zip(q, times(m, mu))]
    for t, i in zip(target, held):
        z[i] = t
    scale = [abs(v) + sum(abs(p * w) for p, w in zip(row, mu)) for v, row in zip(q, m)]
    for i in held:
        if abs(mu[i] * m[i][i]) <= TINY * scale[i]:
            mu[i] = ZERO
    return z, mu, scale


def misfits(z, mu, scale, boxes, places):
    """{row: where it should rather be} of all rows that do not fit."""
    wrong = {}
    for i, (low, high) in enumerate(boxes):
        if places[i]:
            if -places[i] * mu[i] < 0:
                wrong[i] = 0
        elif low is not None and z[i] < low - TINY * scale[i]:
            wrong[i] = -1
        elif high is not None and z[i] > high + TINY * scale[i]:
            wrong[i] = 1
    return wrong


def pivoted(m, q, boxes, places):
    """Places that fit, from these by principal pivots: all misfits at once, later the first one alone, which ends for
    every P-matrix (K. G. Murty, Linear Algebra Appl. 7 (1974) 77). None if it does not."""
    places = list(places)
    for attempt in range(50 + 2 * 2 ** min(len(q), 8)):
        found = values_at(m, q, boxes, places)
        wrong = found and misfits(*found, boxes, places)
        if found is None:
            return None
        if not wrong:
            return found, places
        for i in sorted(wrong)[: None if attempt < 10 else 1]:
            places[i] = wrong[i]
    return None


def box_solutions(m, q, boxes, places=None):
    """All z = q + m mu, l <= z <= b, mu >= 0 only where z = l, mu <= 0 only where z = b: (z, mu, places) one by one.

    `boxes`: (lower, upper) of each row, None where there is no bound. `places`: 0 free, -1 at lower, 1 at upper; a guess
    of them is where pivoting starts, whose solution is the first one. Without a guess all are tried, and in a degenerate
    problem the largest set of rows at a bound comes first.
    """

    def snapped(z, mu, scale, places):
        for i, bounds in enumerate(boxes):
            for bound in bounds:
                if bound is not None and abs(z[i] - bound) <= TINY * scale[i]:
                    z[i] = bound
        return z, mu, places

    found = places is not None and pivoted(m, q, boxes, places)
    if found:
        yield snapped(*found[0], found[1])
    choices = [([-1] if low is not None else []) + ([1] if high is not None else []) + [0] for low, high in boxes]
    for places in sorted(product(*choices), key=lambda p: p.count(0)):
        found = values_at(m, q, boxes, places)
        if found and not misfits(*found, boxes, places):
            yield snapped(*found, places)
