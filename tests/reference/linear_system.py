"""Linear complementarity systems in 60 digits: degrees, outputs, directions of measures, the level rule.

    x' = A x + B lambda + f(t),   w = C x + D lambda + w0,   0 <= w <= wmax

Written from the formulas of README.md, "Many constraints", alone.
"""

from copy import copy
from math import factorial

from decimals import INFINITY, ONE, TINY, ZERO, Combined, Decimal, Signal, dot, exact, identity, solve, times


class LinearSystem:
    """`degree`: r_a; `first`: number of the output z_{a,1}; `rows`: C_a A^(i-1) of all outputs; `directions`: d_{a,i} of
    all outputs, as rows; `markov`: M; constraints of degree 0 have no outputs."""

    def __init__(self, A, B, C, x0, f=None, w0=None, wmax=None, D=None):
        self.A, self.B, self.C, self.x0 = exact(A), exact(B), exact(C), exact(x0)
        n, m = len(self.A), len(self.C)
        self.D = exact(D or [[0] * m] * m)
        self.f = [s if isinstance(s, (Signal, Combined)) else Signal(s) for s in (f or [0] * n)]
        self.w0 = exact(w0 or [0] * m)
        self.wmax = [None if w is None or Decimal(w) == INFINITY else Decimal(w) for w in (wmax or [None] * m)]
        self.pushes = [list(column) for column in zip(*self.B)]  # B_a
        self.rows, self.first, self.degree, self.directions, self.markov = [], [0], [], [], []
        for a in range(m):
            levels, leading = self.levels_of(a)
            self.degree.append(len(levels))
            self.first.append(self.first[-1] + len(levels))
            self.rows += levels
            self.directions += self.directions_of(a, levels)
            self.markov.append(leading)
        self.cross = times(self.rows, [list(v) for v in zip(*self.directions)]) if self.rows else []
        # Measures of the highest level are those of lambda_a.
        self.unit = [ONE] * len(self.rows)
        for a, r in enumerate(self.degree):
            if r:
                self.unit[self.first[a + 1] - 1] = self.markov[a][a]

    def levels_of(self, a):
        """C_a A^(i-1) for i = 1 ... r, and C_a A^(r-1) B (D_a where r = 0)."""
        if any(self.D[a]):
            return [], self.D[a]
        row, size, levels = self.C[a], [abs(v) for v in self.C[a]], []
        for _ in self.A:
            levels.append(row)
            reach = times([row], self.B)[0]
            terms = times([size], [[abs(v) for v in row] for row in self.B])[0]
            if any(abs(v) > TINY * t for v, t in zip(reach, terms)):
                return levels, reach
            row = times([row], self.A)[0]
            size = [sum(s * abs(v) for s, v in zip(size, column)) for column in zip(*self.A)]
        raise ValueError(f"constraint {a} has no relative degree")

    def directions_of(self, a, levels):
        """d_{a,i} in span{B_a, A B_a, ...}: z_{a,j}(d_{a,i}) = delta_ij."""
        krylov = [self.pushes[a]]
        for _ in levels[1:]:
            krylov.append(times(self.A, krylov[-1]))
        gram = [[dot(level, k) for k in krylov] for level in levels]
        gamma = solve(gram, identity(len(levels)))
        if gamma is None:
            raise ValueError(f"constraint {a} does not reach itself")
        return [[sum(g[i] * k[j] for g, k in zip(gamma, krylov)) for j in range(len(self.A))] for i in range(len(levels))]

    def forcing(self, t):
        """g of each output: w0 on level 1, sum_p C_a A^(i-2-p) f^(p) on level i."""
        known = [s.derivatives(t, max(self.degree + [1])) for s in self.f]
        g = []
        for a, r in enumerate(self.degree):
            for i in range(1, r + 1):
                value = self.w0[a] if i == 1 else ZERO
                for p in range(i - 1):
                    value += dot(self.rows[self.first[a] + i - 2 - p], [values[p] for values in known])
                g.append(value)
        return g

    def taylor_forcing(self, t, count):
        """(f^(k)/k!, and of z_{a,r}' - C_a A^(r-1) x' the same for each a with r >= 1), k < count."""
        known = [s.derivatives(t, count + max(self.degree + [1])) for s in self.f]
        f = [[values[k] / factorial(k) for values in known] for k in range(count)]
        above = []
        for k in range(count):
            row = []
            for a, r in enumerate(self.degree):
                levels = self.rows[self.first[a] : self.first[a + 1]]
                value = sum((dot(levels[r - 2 - p], [v[k + p + 1] for v in known]) for p in range(r - 1)), ZERO)
                row.append(value / factorial(k))
            above.append(row)
        return f, above

    def outputs(self, t, x):
        return [dot(row, x) + g for row, g in zip(self.rows, self.forcing(t))]

    def of(self, a, values):
        """Those of constraint a."""
        return values[self.first[a] : self.first[a + 1]]

    def side(self, a, z):
        """-1 at (or beyond) the lower wall, 1 at the upper one, 0 between."""
        value = z[self.first[a]]
        return -1 if value <= 0 else 1 if self.wmax[a] is not None and value >= self.wmax[a] else 0

    def boxes(self, z):
        """Level rule: ([(lower, upper)] of all outputs, r* of all constraints) for a step from outputs z."""
        boxes, level = [], []
        for a, r in enumerate(self.degree):
            if r == 0:
                level.append(0)
                continue
            own, side = self.of(a, z), self.side(a, z)
            star = 1
            if side:
                while star < r and (star == 1 or -side * own[star - 1] <= 0):
                    star += 1
            level.append(star)
            boxes.append((ZERO, self.wmax[a]))
            boxes += [(None, None) if i > star else (ZERO, None) if side < 0 else (None, ZERO) for i in range(2, r + 1)]
        return boxes, level

    def perturbed(self, push):
        """The same with a constant force in addition, on each state."""
        other = copy(self)
        other.f = [Combined([ONE, ONE], [signal, Signal(p)]) for signal, p in zip(self.f, push)]
        return other


def masses(M, K, H, q0, v0, Cv=None, f=None, g0=None):
    """Keywords of a LinearSystem with states q, v: M q'' + Cv q' + K q = f + H' lambda, w = H q + g0."""
    n = len(q0)
    inverse = solve(exact(M), identity(n))
    zero = [[ZERO] * n for _ in range(n)]
    stiff, damped = times(inverse, exact(K)), times(inverse, exact(Cv)) if Cv else zero
    A = [[*row, *one] for row, one in zip(zero, identity(n))] + [[-v for v in [*a, *b]] for a, b in zip(stiff, damped)]
    push = times(inverse, exact([list(column) for column in zip(*H)]))
    force = [Signal(s) for s in (f or [0] * n)]
    return {
        "A": A, "B": [[ZERO] * len(H) for _ in range(n)] + push,
        "C": [[*row, *[0] * n] for row in H], "x0": [*q0, *v0], "f": [Signal(0)] * n + [Combined(row, force) for row in inverse], "w0": g0,
    }  # fmt: skip
