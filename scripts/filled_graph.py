"""Filled-in graphs of functions of time and their Hausdorff distance, Acary & Brogliato, eq. (66)-(69).

A graph is a polyline (t, x) in R^(1+n) whose times do not decrease; a jump is two vertices with the same time, and the
segment between them fills it in. Points are d((t, x), (s, y)) = max(|t - s|, |x - y|_2) apart.
"""

import numpy as np


class FilledGraph:
    """The polyline through (t[k], x[k]); t [K], x [K, n]."""

    def __init__(self, t, x):
        self.t = np.asarray(t, dtype=float)
        self.x = np.asarray(x, dtype=float).reshape(len(self.t), -1)
        if np.any(np.diff(self.t) < 0):
            raise ValueError("the times of a graph decrease")

    def at(self, t):
        """Points of the graph at times t: the last one where it jumps."""
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        length = self.t[k + 1] - self.t[k]
        part = np.clip(np.divide(t - self.t[k], length, out=np.ones_like(length), where=length > 0), 0.0, 1.0)
        return self.x[k] + part[:, None] * (self.x[k + 1] - self.x[k])


def distances_to_segments(t, x, graph, first, last):
    """Distance of the point (t, x) from each of the segments first <= k < last of `graph`: exact.

    On a segment both |t - s| and |x - y| are convex, so their maximum is least where one of them is and the other is
    smaller, or where they are equal, or at an end.
    """
    a = graph.t[first:last] - t
    b = np.diff(graph.t[first : last + 1])
    u = graph.x[first:last] - x
    v = np.diff(graph.x[first : last + 1], axis=0)
    uu, uv, vv = (u * u).sum(1), (u * v).sum(1), (v * v).sum(1)

    def ratio(numerator, denominator):
        return np.divide(numerator, denominator, out=np.zeros_like(denominator), where=denominator != 0.0)

    # (a + b q)^2 = uu + 2 uv q + vv q^2
    alpha, beta, gamma = b * b - vv, a * b - uv, a * a - uu
    root = np.sqrt(np.maximum(beta * beta - alpha * gamma, 0.0))
    large = -beta - np.where(beta >= 0.0, root, -root)  # the root that does not cancel
    best = np.full(len(a), np.inf)
    for q in (np.zeros_like(a), np.ones_like(a), -ratio(a, b), -ratio(uv, vv), ratio(large, alpha), ratio(gamma, large)):
        q = np.clip(q, 0.0, 1.0)
        best = np.minimum(best, np.maximum(np.abs(a + b * q), np.linalg.norm(u + q[:, None] * v, axis=1)))
    return best


def nearest(t, x, graph, bound):
    """Distance of the point (t, x) from `graph`, which is at most `bound`, and the nearest segment."""
    first = max(np.searchsorted(graph.t, t - bound, side="left") - 1, 0)  # others are farther in time
    last = min(np.searchsorted(graph.t, t + bound, side="right"), len(graph.t) - 1)
    first = min(first, len(graph.t) - 2)
    distances = distances_to_segments(t, x, graph, first, max(last, first + 1))
    k = int(np.argmin(distances))
    return distances[k], first + k


def excess(f, g, rtol=1e-4):
    """e(f, g) of (68): how far points of f are from g, to a relative error of rtol.

    Pieces of f that cannot exceed the largest distance found so far are dropped, the others halved. With ends d1 and d2
    from g, a piece of length L is nowhere farther than (d1 + d2 + L) / 2; and nowhere farther than its ends are from any
    one segment of g, because the distance from a convex set is convex.
    """
    bounds = np.linalg.norm(g.at(f.t) - f.x, axis=1)  # at the same time
    length = np.maximum(np.diff(f.t), np.linalg.norm(np.diff(f.x, axis=0), axis=1))
    exact = np.full(len(f.t), np.nan)
    best = 0.0

    def vertex(k):
        nonlocal best
        if np.isnan(exact[k]):
            exact[k] = nearest(f.t[k], f.x[k], g, bounds[k])[0]
            best = max(best, exact[k])
        return exact[k]

    for k in np.argsort(-bounds):
        if bounds[k] <= best:
            break
        vertex(k)
    upper = (bounds[:-1] + bounds[1:] + length) / 2.0
    for k in np.argsort(-upper):
        if upper[k] <= best * (1.0 + rtol):
            break

        def point(q, k=k):
            return f.t[k] + q * (f.t[k + 1] - f.t[k]), f.x[k] + q * (f.x[k + 1] - f.x[k])

        pieces = [(0.0, vertex(k), 1.0, vertex(k + 1))]
        while pieces:
            q1, d1, q2, d2 = pieces.pop()
            if (d1 + d2 + (q2 - q1) * length[k]) / 2.0 <= best * (1.0 + rtol):
                continue
            q = (q1 + q2) / 2.0
            d, segment = nearest(*point(q), g, min(d1, d2) + (q2 - q1) / 2.0 * length[k])
            best = max(best, d)
            ends = [distances_to_segments(*point(end), g, segment, segment + 1)[0] for end in (q1, q2)]
            if max(ends) > best * (1.0 + rtol):
                pieces += [(q1, d1, q, d), (q, d, q2, d2)]
    return best


def hausdorff(f, g, rtol=1e-4):
    """h*(f, g) of (69), to a relative error of rtol."""
    return max(excess(f, g, rtol), excess(g, f, rtol))
