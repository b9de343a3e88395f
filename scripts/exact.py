"""Exact solutions of the papers' examples, event by event, for figures to be drawn beside what was computed."""

import numpy as np

# Acary & Brogliato, eq. (65): when z_1 reaches its wall, and when the multiplier vanishes.
IMPACT_65, LIFTOFF_65 = 4.345147830371428265, 6.199615848871525286
A_65 = np.array([[0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [-1, -1, -1, 0, 1], [0, 0, 0, 0, 1], [1, 0, 0, -1, 0]], dtype=float)


def exponential(a):
    """exp(a): Taylor series of a / 2^n with |a| / 2^n <= 1/16, to rounding after 12 terms."""
    n = max(0, int(np.ceil(np.log2(max(np.abs(a).sum(1).max(), 1e-30)))) + 4)
    term = result = np.eye(len(a))
    for k in range(1, 13):
        term = term @ a / (k * 2.0**n)
        result = result + term
    for _ in range(n):
        result = result @ result
    return result


def linear_piece(a, x0, t0, t1, spacing):
    """x' = a x from (t0, x0), at times up to `spacing` apart."""
    count = int(np.ceil((t1 - t0) / spacing))
    t = np.linspace(t0, t1, count + 1)
    step = exponential(a * (t1 - t0) / count)
    x = [np.asarray(x0, dtype=float)]
    for _ in range(count):
        x.append(step @ x[-1])
    return t, np.array(x)


def example65(spacing=1e-3):
    """AB (65) on [0, 10] as a filled-in graph: t and x; at the impact there are two points of the same time."""
    held = A_65.copy()
    held[2] = 0.0  # lambda keeps z_1 = z_2 = z_3 = 0
    t1, x1 = linear_piece(A_65, [1, 0, 0, 0, 0], 0.0, IMPACT_65, spacing)
    after = np.concatenate([np.zeros(3), x1[-1, 3:]])
    t2, x2 = linear_piece(held, after, IMPACT_65, LIFTOFF_65, spacing)
    t3, x3 = linear_piece(A_65, np.concatenate([np.zeros(3), x2[-1, 3:]]), LIFTOFF_65, 10.0, spacing)
    return np.concatenate([t1, t2, t3]), np.concatenate([x1, x2, x3])


def bouncing_ball(x0, v0, gravity, e, end, spacing=1e-3):
    """A ball on the floor x = 0: t, x, x', and how often it has hit the floor; each impact is there twice."""
    t, x, v, hits = [], [], [], []
    start, count = 0.0, 0
    while start < end:
        speed_down = np.sqrt(v0 * v0 + 2.0 * gravity * x0)
        flight = (v0 + speed_down) / gravity
        if flight < 1e-9:  # what is left of the accumulation
            break
        stop = min(start + flight, end)
        s = np.linspace(0.0, stop - start, max(2, int((stop - start) / spacing) + 2))
        t.append(start + s)
        x.append(np.maximum(x0 + s * (v0 - 0.5 * gravity * s), 0.0))
        v.append(v0 - gravity * s)
        hits.append(np.full(len(s), count))
        start, x0, v0, count = start + flight, 0.0, e * speed_down, count + 1
    if start < end:
        t.append(np.array([start, end]))
        x.append(np.zeros(2))
        v.append(np.zeros(2))
        hits.append(np.full(2, count))
    return tuple(np.concatenate(part) for part in (t, x, v, hits))


def regulator(s, v, kappa, mu1, mu2, end, spacing=1e-3):
    """Huber & Oza, eq. (3) with F = 0: t, s, v. Between two sign changes v' is constant and s' = R v."""
    t_all, s_all, v_all = [], [], []
    t = 0.0
    side, way = np.sign(s), np.sign(v)  # both vary continuously, one changes sign at each event
    while t < end and np.sqrt(abs(s)) + abs(v) > 1e-9:
        r = 1.0 - kappa * side * way
        rate = -(mu1 * side + mu2 * way) / r
        # v + rate q = 0, and s + r (v q + rate q^2 / 2) = 0
        events = [-v / rate] if -v / rate > 1e-14 else []
        roots = np.roots([0.5 * r * rate, r * v, s])
        events += [q.real for q in roots if abs(q.imag) < 1e-14 and q.real > 1e-12]
        q_end = min(events)
        q = np.linspace(0.0, min(q_end, end - t), max(2, int(q_end / spacing) + 2))
        t_all.append(t + q)
        s_all.append(s + r * (v * q + 0.5 * rate * q * q))
        v_all.append(v + rate * q)
        stopped = q_end == -v / rate
        t, s, v = t + q_end, 0.0 if not stopped else s_all[-1][-1], 0.0 if stopped else v_all[-1][-1]
        if stopped:
            way = -side  # back towards s = 0
        else:
            side = way
    if t < end:
        t_all.append(np.array([t, end]))
        s_all.append(np.zeros(2))
        v_all.append(np.zeros(2))
    return np.concatenate(t_all), np.concatenate(s_all), np.concatenate(v_all)
