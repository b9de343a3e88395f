"""Box VIs in exact integer arithmetic: whether there is a solution, and whether there is one near a point.

Find l <= u <= b with F = M u + q, F_i >= 0 where u_i = l_i, F_i <= 0 where u_i = b_i, F_i = 0 between. A search over the places
of all unknowns; the linear inequalities that remain at each branch are decided by the dual simplex method with least indices
(R. G. Bland, Math. Oper. Res. 2 (1977) 103), on integers with a common denominator (J. Edmonds), so that nothing is rounded.
"""

import math
from fractions import Fraction


class Dictionary:
    """basic = b + A nonbasic, all variables >= 0; `den` divides all numbers. A variable that is fixed at 0 leaves for good."""

    def __init__(self, names, columns, rows):
        """rows: [b, a_1, ...] of `names`, rational; each basic variable is taken in a unit that makes its row one of integers."""
        self.den = 1
        self.rows = [[int(v * math.lcm(*(w.denominator for w in row))) for v in row] for row in rows]
        self.basic, self.columns = list(names), list(columns)

    def copy(self):
        other = object.__new__(Dictionary)
        other.den, other.rows = self.den, [row[:] for row in self.rows]
        other.basic, other.columns = self.basic[:], self.columns[:]
        return other

    def pivot(self, i, j):
        """basic i and nonbasic j (from 1) change places."""
        pivot, row = self.rows[i][j], self.rows[i]
        sign = 1 if pivot > 0 else -1
        for k, other in enumerate(self.rows):
            if k != i:
                factor = other[j]
                self.rows[k] = [sign * (v * pivot - factor * r) // self.den for v, r in zip(other, row)]
                self.rows[k][j] = sign * factor
        new = [-sign * v for v in row]
        new[j] = sign * self.den
        self.rows[i] = new
        self.den = sign * pivot
        self.basic[i], self.columns[j - 1] = self.columns[j - 1], self.basic[i]

    def feasible(self):
        """Makes all basic variables >= 0; False if that cannot be."""
        while True:
            wrong = [k for k, row in enumerate(self.rows) if row[0] < 0]
            if not wrong:
                return True
            i = min(wrong, key=lambda k: self.basic[k])
            choices = [j for j in range(1, len(self.columns) + 1) if self.rows[i][j] > 0]
            if not choices:
                return False
            self.pivot(i, min(choices, key=lambda j: self.columns[j - 1]))

    def fix(self, name):
        """That variable is 0 from now on; False if it cannot be."""
        if name in self.basic:
            i = self.basic.index(name)
            choices = [j for j in range(1, len(self.columns) + 1) if self.rows[i][j]]
            if not choices:
                if self.rows[i][0]:
                    return False
                del self.rows[i], self.basic[i]
                return True
            self.pivot(i, choices[0])
        j = self.columns.index(name)
        for row in self.rows:
            del row[j + 1]
        del self.columns[j]
        return self.feasible()


def solvable(M, q, lower, upper, near=None, within=0):
    """Whether the box VI has a solution; with `near`, one with |u_i - near_i| <= within. Numbers are taken for what they are."""
    n = len(q)
    M, q = [[Fraction(v) for v in row] for row in M], [Fraction(v) for v in q]
    low, high, places = [], [], []
    for i in range(n):
        box = [None if math.isinf(v) else Fraction(v) for v in (lower[i], upper[i])]
        allowed = ["between"]
        part = list(box)
        if near is not None:
            around = Fraction(near[i]) - Fraction(within), Fraction(near[i]) + Fraction(within)
            part = [around[0] if box[0] is None else max(box[0], around[0]), around[1] if box[1] is None else min(box[1], around[1])]
        for k, place in enumerate(("lower", "upper")):
            if box[k] is not None and part[k] == box[k]:
                allowed.insert(k, place)
        low.append(part[0])
        high.append(part[1])
        places.append(allowed)
    # u_i = low + x_i, or high - x_i, or x_i - y_i where it has no bound; n_i: the part of F_i below 0.
    columns, shift, terms = [], [], []  # (kind, i); u_i = shift + sum of (column, factor)
    for i in range(n):
        if low[i] is not None:
            shift.append(low[i])
            terms.append([(("x", i), 1)])
        elif high[i] is not None:
            shift.append(high[i])
            terms.append([(("y", i), -1)])
        else:
            shift.append(Fraction(0))
            terms.append([(("x", i), 1), (("y", i), -1)])
        columns += [name for name, _ in terms[i]]
    columns += [("n", i) for i in range(n)]
    at = {name: k + 1 for k, name in enumerate(columns)}
    names, rows = [], []
    for i in range(n):  # p_i = F_i + n_i
        row = [q[i] + sum(m * s for m, s in zip(M[i], shift))] + [Fraction(0)] * len(columns)
        for j in range(n):
            for name, factor in terms[j]:
                row[at[name]] += M[i][j] * factor
        row[at["n", i]] += 1
        names.append(("p", i))
        rows.append(row)
        if low[i] is not None and high[i] is not None:  # the distance from the other bound
            row = [high[i] - low[i]] + [Fraction(0)] * len(columns)
            row[at["x", i]] = Fraction(-1)
            names.append(("y", i))
            rows.append(row)
    return search(Dictionary(names, columns, rows), places, 0)


FIXED = {"between": ("p", "n"), "lower": ("x", "n"), "upper": ("y", "p")}  # what is 0 at such a place


def search(dictionary, places, i):
    if i == 0 and not dictionary.feasible():
        return False
    if i == len(places):
        return True
    for place in places[i]:
        branch = dictionary.copy()
        if all(branch.fix((kind, i)) for kind in FIXED[place]) and search(branch, places, i + 1):
            return True
    return False
