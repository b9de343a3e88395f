"""The schemes in 60 digits, written from the formulas alone: what a run of the program is judged by.

Each step's complementarity problem is solved by active sets: those of the last step first, then pivots from them, then all.
"""

from decimals import ZERO, Decimal, Signal, box_solutions, dot, exact, identity, solve, times
from linear_system import LinearSystem


class Homsp:
    """AB (32)-(45) for several constraints, as README.md has it; x, z, mu, level are those at the end of the last step.

    (I - h A) x = x_k + phi + sum d_{a,i} mu_{a,i};  degree 0: 0 <= C_a x + D_a mu/h + w0 <= wmax, mu the measures of lambda.
    """

    def __init__(self, A, B, C, x0, h, f=None, w0=None, wmax=None, start=0, D=None):
        self.system = system = LinearSystem(A, B, C, x0, f, w0, wmax, D)
        self.x, self.h, self.degree, self.t = system.x0, Decimal(h), system.degree, Decimal(start)
        n = len(system.A)
        self.inverse = solve([[e - self.h * a for e, a in zip(*pair)] for pair in zip(identity(n), system.A)], identity(n))
        self.direct = [a for a, r in enumerate(self.degree) if r == 0]
        # Rows and directions of all unknown measures: outputs, then constraints of degree 0.
        self.rows = system.rows + [system.C[a] for a in self.direct]
        self.directions = system.directions + [system.pushes[a] for a in self.direct]
        answers = [times(self.inverse, d) for d in self.directions]
        self.M = [[dot(row, answer) for answer in answers] for row in self.rows]
        if self.direct:
            of = [a for a, r in enumerate(self.degree) for _ in range(r)] + self.direct
            top = [q + 1 == system.first[of[q] + 1] if q < len(system.rows) else True for q in range(len(of))]
            unit = system.unit + [Decimal(1)] * len(self.direct)
            for i, a in enumerate(self.direct):
                row = self.M[len(system.rows) + i]
                for q, b in enumerate(of):
                    if top[q]:  # lambda_b = mu / unit / h
                        row[q] += system.D[a][b] / (unit[q] * self.h)
        self.lower_levels = [q for a, r in enumerate(self.degree) for q in range(system.first[a], system.first[a] + r - 1)]
        self.z = system.outputs(self.t, self.x)
        self.mu = [ZERO] * len(system.rows)
        self.level = [0] * len(self.degree)
        self.places = [0] * len(self.rows)
        self.step_number, self.start = 0, Decimal(start)

    def increment(self, old_g, g):
        """phi, which stands for h f: C_a A^(i-1) phi = h g_{i+1} - (g_i - old g_i) below the highest level."""
        system = self.system
        phi = [self.h * s.at(self.t) for s in system.f]
        if any(s.amplitude for s in system.f) and self.lower_levels:
            image = times(system.rows, phi)
            defect = [[self.h * g[q + 1] - (g[q] - old_g[q]) - image[q]] for q in self.lower_levels]
            c = solve([[system.cross[i][j] for j in self.lower_levels] for i in self.lower_levels], defect)
            for (value,), q in zip(c, self.lower_levels):
                phi = [p + value * d for p, d in zip(phi, system.directions[q])]
        return phi

    def step(self):
        system = self.system
        old_g = system.forcing(self.t)
        self.step_number += 1
        self.t = self.start + self.step_number * self.h
        g = system.forcing(self.t)
        boxes, self.level = system.boxes(self.z)
        boxes += [(ZERO, system.wmax[a]) for a in self.direct]
        used = [q for q, box in enumerate(boxes) if box != (None, None)]
        free = times(self.inverse, [x + p for x, p in zip(self.x, self.increment(old_g, g))])
        q = [v + w for v, w in zip(times(self.rows, free), g + [system.w0[a] for a in self.direct])]
        places = [place if place != -1 or boxes[i][0] is not None else 0 for i, place in enumerate(self.places)]
        places = [place if place != 1 or boxes[i][1] is not None else 0 for i, place in enumerate(places)]
        found = next(
            box_solutions(
                [[self.M[i][j] for j in used] for i in used], [q[i] for i in used], [boxes[i] for i in used], [places[i] for i in used]
            ),
            None,
        )
        if found is None:
            raise ArithmeticError(f"step {self.step_number} has no solution")
        mu = [ZERO] * len(self.rows)
        self.places = [0] * len(self.rows)
        for place, value, where in zip(used, found[1], found[2]):
            mu[place], self.places[place] = value, where
        pushed = [sum((d[i] * v for d, v in zip(self.directions, mu) if v), ZERO) for i in range(len(self.x))]
        self.x = [v + w for v, w in zip(free, times(self.inverse, pushed))]
        self.z = [v + w for v, w in zip(times(system.rows, self.x), g)]
        for place, value in zip(used, found[0]):
            if place < len(self.z):
                self.z[place] = value
        self.w = [self.z[system.first[a]] if r else None for a, r in enumerate(self.degree)]
        for place, value in zip(used, found[0]):
            if place >= len(self.z):
                self.w[self.direct[place - len(self.z)]] = value
        self.mu, self.direct_mu = mu[: len(self.z)], mu[len(self.z) :]
        return self

    def measures(self):
        """As /mu has them: the highest level in units of lambda."""
        return [value / unit for value, unit in zip(self.mu, self.system.unit)]


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
        self.inverse = solve(J, identity(n))
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
