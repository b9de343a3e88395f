"""Solutions of small linear models by hand: series between events, bisection for them, and the jumps as the papers define
them. Shares nothing with the program, whose scheme `hybrid` makes its jumps with the steps that are tested here."""

import math

import numpy as np

SPACING = 2e-3  # of rows [s]; rates are below 50
TERMS = 14  # 0.1^14 / 14! is 1e-25
NOISE = 1e-12  # what rounding makes of a 0


class Autonomous:
    """y' = F y + B lambda, 0 <= C y + D lambda _|_ lambda >= 0, restitution e, y = (x, 1, sine, cosine, ...): signals are
    states of their own."""

    def __init__(self, A, B, C, start, forces, offsets, e=0.0, D=None):
        signals = [entry for entry in [*forces, *offsets] if isinstance(entry, dict)]
        self.waves = sorted({(entry["frequency"], entry["phase"]) for entry in signals})
        self.states, self.constraints = np.shape(B)
        n, clock = self.states, 1 + 2 * len(self.waves)
        self.F, self.B = np.zeros((n + clock, n + clock)), np.zeros((n + clock, self.constraints))
        self.F[:n] = np.c_[A, [self.value(entry) for entry in forces]]
        self.B[:n] = B
        self.C = np.c_[C, [self.value(entry) for entry in offsets]]
        self.D = np.zeros((self.constraints,) * 2) if D is None else np.array(D, float)
        self.y = np.concatenate([start, [1.0]])
        for j, (frequency, phase) in enumerate(self.waves):
            sine = n + 1 + 2 * j
            self.F[sine, sine + 1], self.F[sine + 1, sine] = 2 * math.pi * frequency, -2 * math.pi * frequency
            self.y = np.concatenate([self.y, [math.sin(phase), math.cos(phase)]])
        self.e = e
        self.degrees = [self.degree(a) for a in range(self.constraints)]
        # z = C y, C F y, ... of each constraint, and the directions of span{B, F B, ...} that change one of them alone
        self.Z, self.K = [], []
        for a, r in enumerate(self.degrees):
            powers = [np.linalg.matrix_power(self.F, i) for i in range(r)]
            Z = np.array([self.C[a] @ power for power in powers]).reshape(r, len(self.F))
            span = np.array([power @ self.B[:, a] for power in powers]).reshape(r, len(self.F)).T
            self.Z.append(Z)
            self.K.append(span @ np.linalg.inv(Z @ span))

    def value(self, entry):
        row = np.zeros(1 + 2 * len(self.waves))
        row[0] = entry["offset"] if isinstance(entry, dict) else entry
        if isinstance(entry, dict):
            row[1 + 2 * self.waves.index((entry["frequency"], entry["phase"]))] = entry["amplitude"]
        return row

    def degree(self, a):
        if self.D[a].any():
            return 0
        row, r = self.C[a], 1
        while abs(row @ self.B[:, a]) < NOISE:
            row, r = row @ self.F, r + 1
        return r

    def mode(self, active):
        """y' = flow y, and what has to stay positive: lambda of the active, w of the others."""
        law, held = np.zeros_like(self.C), np.flatnonzero(active)
        if held.size:
            rows = np.array([self.Z[a][-1] @ self.F if self.degrees[a] else self.C[a] for a in held])
            matrix = np.array([self.Z[a][-1] @ self.B[:, held] if self.degrees[a] else self.D[a, held] for a in held])
            law[held] = -np.linalg.solve(matrix, rows)
        return self.F + self.B @ law, np.where(np.array(active)[:, None], law, self.C + self.D @ law)

    def meet(self, a, y):
        """What constraint a does at its wall: AB (28)-(29) for r > 2, Newton's law for r = 2. The state after it, and
        whether it stays."""
        z = self.Z[a] @ y
        after = np.maximum(z, 0.0)
        after[:1] = 0.0
        for i in range(2, len(z)):
            if z[1:i].max() > 0:  # levels above the first that leaves are free
                after[i] = z[i]
        if len(z) == 2:
            after[1] = -self.e * z[1] if z[1] < 0 else z[1]
        return y + self.K[a] @ (after - z), not after.any()

    def released(self, active, y):
        """Lets go, one by one, who would have to pull."""
        while True:
            pulls = self.mode(active)[1] @ y
            pulling = [a for a in range(self.constraints) if active[a] and pulls[a] < 0]
            if not pulling:
                return active
            active[min(pulling, key=lambda a: pulls[a])] = False


def follow(system, end):
    """Rows t, x, twice at events, and the number of events."""
    y, t, events, rows = system.y, 0.0, 0, []
    active = [False] * system.constraints
    for a, r in enumerate(system.degrees):
        if r == 0:
            active[a] = system.C[a] @ y < 0
        elif np.abs(system.Z[a] @ y).max() < NOISE:
            y, active[a] = system.meet(a, y)
    active = system.released(active, y)
    flow, signs = system.mode(active)
    rows.append([t, *y[: system.states]])
    while t < end - NOISE:
        step = min(SPACING, end - t)
        terms = [y]
        for k in range(1, TERMS):
            terms.append(flow @ terms[-1] / k)

        def at(tau):
            return sum(term * tau**k for k, term in enumerate(terms))

        late = at(step)
        broken = [a for a in range(system.constraints) if signs[a] @ late < -NOISE and signs[a] @ y >= -NOISE]
        if broken:
            below, above = 0.0, step
            while below < 0.5 * (below + above) < above:
                middle = 0.5 * (below + above)
                below, above = (below, middle) if (signs[broken] @ at(middle)).min() < 0 else (middle, above)
            late, step = at(above), above
            first = min(broken, key=lambda a: signs[a] @ late)
        y, t = late, t + step
        rows.append([t, *y[: system.states]])
        if broken:
            if active[first]:
                active[first] = False
            elif system.degrees[first]:
                y, active[first] = system.meet(first, y)
            else:
                active[first] = True
            active = system.released(active, y)
            flow, signs = system.mode(active)
            rows.append([t, *y[: system.states]])
            events += 1
    return rows, events


def of_model(model):
    """The models of the table, by their scenes."""
    if model["kind"] == "linear":
        m = len(model["C"])
        return Autonomous(model["A"], model["B"], model["C"], model["x0"], model["f"], [0.0] * m, D=model.get("D"))
    if model["kind"] == "lagrangian":
        n, inverse, H = len(model["M"]), np.linalg.inv(model["M"]), np.array(model["H"])
        assert np.array_equal(inverse, np.diag(np.diag(inverse)))
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-inverse @ model["K"], -inverse @ model["Cv"]]])
        forces = [0.0] * n + [scaled(force, inverse[i, i]) for i, force in enumerate(model["f"])]
        B, C = np.r_[np.zeros((n, len(H))), inverse @ H.T], np.c_[H, np.zeros_like(H)]
        return Autonomous(A, B, C, [*model["q0"], *model["v0"]], forces, [0.0] * len(H), model["e"])
    if model["kind"] == "sweeping":
        faces, offsets = list(model.get("G", [])), [scaled(g, -1.0) for g in model.get("g", [])]
        for sign, bounds in ((1.0, model.get("lower", [])), (-1.0, model.get("upper", []))):
            for i, bound in enumerate(bounds):
                if isinstance(bound, dict) or math.isfinite(bound):
                    faces.append(sign * np.eye(len(bounds))[i])
                    offsets.append(scaled(bound, -sign))
        faces = np.array(faces)
        return Autonomous(model["A"], faces.T, faces, model["u0"], model["f"], offsets)
    # Impact oscillators, between fixed ends where they are a chain.
    n = model.get("count", 1)
    springs = model.get("coupling", 0.0) * (np.eye(n, k=1) + np.eye(n, k=-1) - 2 * np.eye(n))
    A = np.block([[np.zeros((n, n)), np.eye(n)], [springs, np.zeros((n, n))]])
    start = model["x0"] if n > 1 else [model["x0"], model["v0"]]
    e = (1 - model["kappa"]) / (1 + model["kappa"])
    forces = [0.0] * n + [model["force"]] * n
    return Autonomous(A, np.eye(2 * n)[:, n:], np.eye(2 * n)[:n], start, forces, [0.0] * n, e)


def scaled(entry, factor):
    if not isinstance(entry, dict):
        return factor * entry
    return dict(entry, offset=factor * entry["offset"], amplitude=factor * entry["amplitude"])
