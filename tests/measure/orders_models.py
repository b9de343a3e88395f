"""Small models for the tests of orders, and what they do in closed form."""

import math

import numpy as np


def signal(offset, amplitude, frequency, phase=0.0):
    return {"offset": offset, "amplitude": amplitude, "frequency": frequency, "phase": phase}


def toml(value):
    """A Python value as TOML writes it, in one line."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(toml, value)) + "]"
    return f'"{value}"' if isinstance(value, str) else repr(value)


def scene_text(time, model):
    tables = (("time", time), ("model", model))
    return "".join(f"[{name}]\n" + "".join(f"{key} = {toml(value)}\n" for key, value in keys.items()) for name, keys in tables)


# ---------------------------------------------------------------- linear systems

FEEDBACK = {1: [1], 2: [1, 1], 3: [1, 1, 1], 4: [1, 4, 6, 4]}  # characteristic polynomials of stable outputs


def outputs(degrees, oscillator, weight=0.0):
    """z_1' = z_2, ..., z_r' = -feedback + lambda for each degree, the last rows with `weight` times the first output of
    the next constraint; with an `oscillator`, xi'' = -xi + z_1, which the first constraint feels."""
    starts = np.concatenate([[0], np.cumsum(degrees)])
    n = starts[-1] + 2 * oscillator
    A, B, C = np.zeros((n, n)), np.zeros((n, len(degrees))), np.zeros((len(degrees), n))
    for a, r in enumerate(degrees):
        first, last = starts[a], starts[a] + r - 1
        A[range(first, last), range(first + 1, last + 1)] = 1
        A[last, first : last + 1] -= FEEDBACK[r]
        if weight:
            A[last, starts[(a + 1) % len(degrees)]] += weight
        B[last, a] = C[a, first] = 1
    if oscillator:
        A[n - 2, n - 1], A[n - 1, n - 2], A[n - 1, 0], A[degrees[0] - 1, n - 1] = 1, -1, 1, 1
    return A, B, C


def linear(degrees, x0, forces, oscillator=True, weight=0.0):
    """One force for each constraint, where its lambda is."""
    A, B, C = outputs(degrees, oscillator, weight)
    f = [0.0] * len(A)
    for a, force in enumerate(forces):
        f[int(np.argmax(B[:, a]))] = force
    return {"kind": "linear", "A": A.tolist(), "B": B.tolist(), "C": C.tolist(), "x0": [float(x) for x in x0], "f": f}


# ---------------------------------------------------------------- bouncing masses


def bounce(stiffness, gravity, e, x, v, end):
    """x'' = -stiffness x - gravity, x >= 0, x'+ = -e x'- at 0: the state at the end, and how often it bounced."""
    omega, rest, t, bounces = math.sqrt(stiffness), -gravity / stiffness, 0.0, 0
    while True:
        # x(tau) = rest + radius cos(omega tau + phase), at 0 again where the cosine is -rest/radius, falling
        radius, phase = math.hypot(x - rest, v / omega), math.atan2(-v / omega, x - rest)
        flight = (math.acos(-rest / radius) - phase) / omega
        angle = omega * min(flight, end - t) + phase
        x, v = rest + radius * math.cos(angle), -omega * radius * math.sin(angle)
        if t + flight >= end:
            return [x, v], bounces
        t, x, v, bounces = t + flight, 0.0, -e * v, bounces + 1


def masses(e, force, q0, shared=False):
    """Two masses on springs, each before a wall; `shared`: the second before the first."""
    return {
        "kind": "lagrangian", "M": [[1.0, 0.0], [0.0, 2.0]], "K": [[3.0, -1.0], [-1.0, 2.0]], "Cv": [[0.2, 0.0], [0.0, 0.1]],
        "H": [[1.0, 0.0], [-1.0 if shared else 0.0, 1.0]], "q0": q0, "v0": [0.0, 0.0], "e": e,
        "f": [force, signal(-0.5, 1.0, 0.3)],
    }  # fmt: skip


# ---------------------------------------------------------------- moving sets


def slide(offset, amplitude, frequency, u, end):
    """-u' in N_{[g(t), oo)}(u) + u: u decays as exp(-t) and is pushed along by g while g' > -g. The end, and how often it
    met or left the bound."""
    omega, t, events = 2 * math.pi * frequency, 0.0, 0

    def g(time):
        return offset + amplitude * math.sin(omega * time)

    def surplus(time):  # what the bound pushes with: g' + g
        return g(time) + amplitude * omega * math.cos(omega * time)

    def first_zero(of, begin):
        """The first change of sign after `begin`, or the end."""
        step = 1e-3
        at = begin + step
        while at < end and of(at) > 0:
            at += step
        below, above = at - step, at
        while below < 0.5 * (below + above) < above:
            middle = 0.5 * (below + above)
            below, above = (middle, above) if of(middle) > 0 else (below, middle)
        return above

    while True:
        start, height = t, u
        t = first_zero(lambda time: height * math.exp(start - time) - g(time), t)
        if t >= end:
            return [height * math.exp(start - end)], events
        t = first_zero(surplus, t)
        events += 2
        if t >= end:
            return [g(end)], events - 1
        u = g(t)


# ---------------------------------------------------------------- Zhuravlev and Ivanov's coordinates


def twist(kappa, gains, bodies, forces, end):
    """A plant, or a plant and its reference, under a twisting controller: HO (3), (8) for constant forces. While no sign
    changes, velocities are linear in time and positions quadratic. x, x_ref, x', x_ref' at the end, and the number of
    changes.
    @param bodies  (x, x') of each, above the wall, moving"""
    mu1, mu2 = gains
    n = len(bodies)
    s = np.array([x for x, _ in bodies])
    v = np.array([speed / (1 - kappa * math.copysign(1.0, speed)) for _, speed in bodies])
    matrix = np.vstack([np.eye(2 * n), np.eye(2 * n)[[0, 2]] - np.eye(2 * n)[[1, 3]]]) if n == 2 else np.eye(2)
    sign = np.sign(matrix @ np.concatenate([s, v]))
    t, changes = 0.0, 0
    while True:
        R = 1 - kappa * sign[:n] * sign[n : 2 * n]
        a = sign[:n] * forces / R
        if n == 2:
            a[0] = a[1] - mu1 * sign[4] - mu2 * sign[5]
        else:
            a[0] -= (mu1 * sign[0] + mu2 * sign[1]) / R[0]
        parabolas = matrix @ np.array([[*s, *v], [*(R * v), *a], [*(R * a / 2), *np.zeros(n)]]).T
        zeros = [
            (root.real, j)
            for j, (c, b, q) in enumerate(parabolas)
            for root in np.roots(np.trim_zeros([q, b, c], "f"))
            if abs(root.imag) < 1e-12 and root.real > 1e-12
        ]
        tau, which = min(zeros)
        tau = min(tau, end - t)
        s, v, t = s + R * v * tau + R * a * tau**2 / 2, v + a * tau, t + tau
        if t >= end:
            return [*np.abs(s), *(R * v * sign[:n])], changes
        sign[which] = -sign[which]
        changes += 1


def tracked_flight(kappa, gains, bodies, force, end):
    """Plant and reference going up, the plant above and faster, until a sign changes: HO (8) where only the reference's
    force is left, a signal, under constant control."""
    (x, speed), (x_ref, speed_ref) = bodies
    R, omega, phase = 1 - kappa, 2 * math.pi * force["frequency"], force["phase"]
    offset, swing = force["offset"], force["amplitude"] / omega
    once = offset * end + swing * (math.cos(phase) - math.cos(omega * end + phase))
    twice = offset * end**2 / 2 + swing * (end * math.cos(phase) - (math.sin(omega * end + phase) - math.sin(phase)) / omega)
    control = -sum(gains)
    return [
        x + speed * end + twice + R * control * end**2 / 2, x_ref + speed_ref * end + twice,
        speed + once + R * control * end, speed_ref + once,
    ]  # fmt: skip
