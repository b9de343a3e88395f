"""Random coupled systems as `model` tables of scenes: 1 to 5 constraints of degrees 0 to 6, shared states and inputs, zero
dynamics that are pushed, too, dense coordinates, offsets, forcing, walls on two sides, initial data on or behind a wall.

All entries of A, B, C, D are binary fractions that mixing coordinates does not round: degrees are what they are.
"""

import itertools
import math
import random

import numpy as np

ENTRY = 64  # entries of A are multiples of 1/64
MOST_STATES = 14


class Redraw(Exception):
    """This draw is of no use."""


def is_p(M):
    """All principal minors are well above 0."""
    M = np.array(M, float)
    m = len(M)
    sets = itertools.chain.from_iterable(itertools.combinations(range(m), k) for k in range(1, m + 1))
    return all(np.linalg.det(M[np.ix_(s, s)]) > 0.05 for s in sets)


def degrees_of(draw):
    m = draw.choice([1, 2, 2, 3, 3, 4, 5])
    if draw.random() < 0.2:  # D stands beside degree 1 only
        return [0] + [draw.choice([0, 1]) for _ in range(m - 1)]
    while True:
        degrees = [draw.choice([1, 2, 2, 3, 3, 4, 5, 6]) for _ in range(m)]
        if sum(degrees) <= MOST_STATES - 2:
            return degrees


def unmixed(draw, degrees):
    """Chains of integrators, each ended by a combination of all states, and zero dynamics."""
    m, n = len(degrees), sum(degrees) + draw.choice([0, 1, 2] if 0 not in degrees else [1, 2, 3])
    fraction = lambda size: round(draw.uniform(-size, size) * ENTRY) / ENTRY
    entries = lambda: [draw.choice([0.0, fraction(1.5)]) for _ in range(n)]
    A, B, C, D = np.zeros((n, n)), np.zeros((n, m)), np.zeros((m, n)), np.zeros((m, m))
    first = 0
    share = lambda a: [draw.choice([0.5, 1.0, 1.0, 2.0]) if b == a else draw.choice([0.0, 0.0, 0.25, -0.375]) for b in range(m)]
    for a, r in enumerate(degrees):
        if r == 0:
            D[a], C[a] = share(a), entries()
            continue
        for i in range(first, first + r - 1):
            A[i, i + 1] = 1.0
        A[first + r - 1], B[first + r - 1], C[a, first] = entries(), share(a), 1.0
        first += r
    for i in range(first, n):
        A[i] = entries()
        A[i, i] -= 0.5
        B[i] = [draw.choice([0.0, 0.0, 0.5, -0.5]) for _ in range(m)]
    if not C.any(axis=1).all() or not is_p([D[a] if r == 0 else (C @ np.linalg.matrix_power(A, r - 1) @ B)[a] for a, r in enumerate(degrees)]):
        raise Redraw
    return A, B, C, D


def twins(draw, A, B, C, D):
    """Two of the same, which see each other through the last rows of their chains or not at all: all happens to both at once."""
    n = len(A)
    pushed = [i for i in range(n) if B[i].any()]
    link = np.zeros((n, n))
    if draw.random() < 0.5:
        for i in pushed:
            link[i, draw.randrange(n)] = draw.choice([0.25, -0.25, 0.5])
    double = lambda X: np.kron(np.eye(2), X)
    return double(A) + np.kron([[0.0, 1.0], [1.0, 0.0]], link), double(B), double(C), double(D)


def coordinates(draw, n):
    """A dense matrix and its inverse, both exact."""
    upper, lower = np.eye(n), np.eye(n)
    for i in range(n):
        upper[i, i + 1 :] = [draw.choice([0.0, 0.0, 0.5, -0.25]) for _ in range(i + 1, n)]
        lower[i, :i] = [draw.choice([0.0, 0.0, 0.0, 0.5]) for _ in range(i)]
    mixed = upper @ lower
    back = np.round(np.linalg.inv(mixed) * 2.0**26) / 2.0**26
    if not (mixed @ back == np.eye(n)).all():
        raise Redraw
    return mixed, back


def exact_product(*matrices):
    """The product of binary fractions; Redraw if it does not fit into doubles."""
    scale = 2.0**40
    total = np.array([[int(v * 2**40) for v in row] for row in matrices[0]], dtype=object)
    for matrix in matrices[1:]:
        total = total.dot(np.array([[int(v * 2**40) for v in row] for row in matrix], dtype=object))
        if any(v % 2**40 for v in total.ravel()):
            raise Redraw
        total //= 2**40
    result = np.array([[float(v) for v in row] for row in total]) / scale
    if not (np.array([[int(v * 2**40) for v in row] for row in result], dtype=object) == total).all():
        raise Redraw
    return result


def attempt(draw):
    degrees = degrees_of(draw)
    A, B, C, D = unmixed(draw, degrees)
    twin = 2 * len(degrees) <= 5 and 2 * len(A) <= MOST_STATES and draw.random() < 0.25
    if twin:
        A, B, C, D = twins(draw, A, B, C, D)
    n, m = len(A), len(C)
    half = n // 2 if twin else n
    degrees = degrees * (2 if twin else 1)
    both = lambda values: values[:half] * 2 if twin else values
    walls = lambda values: values[: m // 2] * 2 if twin else values
    dyadic = lambda low, high: round(draw.uniform(low, high) * ENTRY) / ENTRY
    wave = lambda push: {"offset": draw.uniform(-2.5, -0.5) if push else draw.uniform(-0.5, 0.5), "amplitude": draw.choice([0.0, draw.uniform(0, 2)]), "frequency": draw.uniform(0.05, 0.7), "phase": draw.uniform(0, 6)}  # fmt: skip
    w0 = walls([draw.choice([0.0, dyadic(-0.5, 0.5)]) for _ in range(m)])
    wmax = walls([draw.choice([math.inf, math.inf, dyadic(0.4, 1.5)]) for _ in range(m)])
    kinds = walls([draw.choice(["inside"] * 9 + ["on", "behind"]) for _ in range(m)])
    start = both([dyadic(-0.5, 0.5) for _ in range(n)])
    first = 0
    for a, r in enumerate(degrees):
        if r:
            room = min(wmax[a], 1.5)
            inside = round((0.2 + 0.6 * draw.random()) * room * ENTRY) / ENTRY if not twin or a < m // 2 else start[first - half] + w0[a]
            value = {"inside": inside, "on": 0.0, "behind": -0.25}[kinds[a]]
            start[first] = value - w0[a]
        first += r
        if twin and a == m // 2 - 1:
            first = half
    f = both([wave(B[i].any()) for i in range(n)])
    if draw.random() < 0.75 and not all(r == 0 for r in degrees):
        mixed, back = (np.kron(np.eye(n // half), M) for M in coordinates(draw, half))
        A, B, C = exact_product(mixed, A, back), exact_product(mixed, B), exact_product(C, back)
        start = exact_product(mixed, [[v] for v in start]).ravel().tolist()
    scene = {"kind": "linear", "A": A.tolist(), "B": B.tolist(), "C": C.tolist(), "x0": list(start), "f": f, "w0": w0, "wmax": wmax}
    if 0 in degrees:
        scene["D"] = D.tolist()
    return scene, degrees


def random_model(seed):
    """(table `model`, degrees) of this seed."""
    draw = random.Random(seed)
    while True:
        try:
            return attempt(draw)
        except Redraw:
            continue


def random_masses(seed, full=False):
    """Table `model` of kind lagrangian: 1 to 4 coordinates, 1 to 4 gaps, some opposite ones, restitution of all kinds; `full`:
    mass matrices that are not diagonal."""
    draw = random.Random(f"masses {seed}")
    n = draw.choice([1, 2, 2, 3, 4])
    part = lambda size: round(draw.uniform(-size, size) * ENTRY) / ENTRY
    square = lambda size: np.array([[part(size) for _ in range(n)] for _ in range(n)])
    L = np.tril(square(0.5), -1) * full + np.diag([draw.choice([0.5, 1.0, 2.0]) for _ in range(n)])
    G, S = square(1.0), square(0.5)
    K = draw.choice([0.0, 1.0, 4.0]) * (G @ G.T)
    Cv = draw.choice([0.0, 0.0, 0.25]) * (S @ S.T + draw.choice([0.0, 1.0]) * (S - S.T))
    rows, g0, e = [], [], []
    q0 = [part(0.5) for _ in range(n)]
    for _ in range(draw.randint(1, n)):
        row = [draw.choice([0.0, 1.0, -1.0, 0.5]) for _ in range(n)]
        if not any(row) or np.linalg.matrix_rank(np.array([*rows, row])) <= len(rows):
            continue
        rows.append(row)
    for row in list(rows):
        gap = round(draw.uniform(0.1, 0.6) * ENTRY) / ENTRY
        g0.append(gap - float(np.dot(row, q0)))
        e.append(draw.choice([0.0, 0.0, 0.5, 0.8, 1.0]))
    for row, offset in list(zip(rows, g0)):
        if draw.random() < 0.3:  # the wall on the other side
            rows.append([-v for v in row])
            g0.append(round(draw.uniform(0.8, 1.5) * ENTRY) / ENTRY - offset)
            e.append(draw.choice([0.0, 0.5, 1.0]))
    wave = lambda: {"offset": draw.uniform(-2, 1), "amplitude": draw.choice([0.0, draw.uniform(0, 2)]), "frequency": draw.uniform(0.05, 0.7), "phase": draw.uniform(0, 6)}  # fmt: skip
    if not rows:
        return random_masses(f"{seed} again", full)
    return {
        "kind": "lagrangian", "M": (L @ L.T).tolist(), "K": K.tolist(), "Cv": Cv.tolist(), "H": rows, "g0": g0, "e": e,
        "q0": q0, "v0": [part(1.0) for _ in range(n)], "f": [wave() for _ in range(n)],
    }  # fmt: skip
