"""Building blocks of the scenes."""

FALL = -1.0


def scene(model, end, step, output=None, **time):
    return {"time": {**time, "end": end, "step": step}, "model": model, **({"output": output} if output else {})}


def integrators(r, x0, push=FALL, **keys):
    """x^(r) = push + lambda, w = x."""
    A = [[float(j == i + 1) for j in range(r)] for i in range(r)]
    last = [0.0] * (r - 1)
    return {
        "kind": "linear", "A": A, "B": [[v] for v in last] + [[1.0]], "C": [[1.0] + last], "x0": list(x0),
        "f": [0.0] * (r - 1) + [push], **keys,
    }


def paper65(**keys):
    """AB (65)."""
    return {
        "kind": "linear",
        "A": [[0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [-1, -1, -1, 0, 1], [0, 0, 0, 0, 1], [1, 0, 0, -1, 0]],
        "B": [[0], [0], [1], [0], [0]],
        "C": [[1, 0, 0, 0, 0]],
        "x0": [1, 0, 0, 0, 0],
        **keys,
    }  # fmt: skip


def jerk_matrices(count, coupling, ring=False, base=0.2, spread=0.8):
    """The chain of `jerk` elements with its defaults, as a linear system."""
    n = 5 * count
    A = [[0.0] * n for _ in range(n)]
    for i in range(count):
        z1, z2, z3, xi1, xi2 = range(5 * i, 5 * i + 5)
        for row, column, value in ((z1, z2, 1), (z2, z3, 1), (z3, z1, -1), (z3, z2, -1), (z3, z3, -1), (z3, xi2, 1), (xi1, xi2, 1), (xi2, xi1, -1), (xi2, z1, 1)):
            A[row][column] += value
        for j in (i - 1, i + 1):
            if ring or 0 <= j < count:
                A[z3][5 * (j % count)] += coupling
            A[z3][z1] -= coupling
    golden = 0.6180339887498949
    x0 = [v for i in range(count) for v in (base + spread * ((i * golden) % 1.0), 0.0, 0.0, 0.0, 0.0)]
    at = lambda i, k: [float(c == 5 * i + k) for c in range(n)]
    B = [list(row) for row in zip(*[at(i, 2) for i in range(count)])]
    return {"A": A, "B": B, "C": [at(i, 0) for i in range(count)], "x0": x0, "f": [0.0] * n}


def markov(M, r, x0=1.0, push=FALL):
    """Chains of r integrators whose leading Markov matrix is M."""
    m = len(M)
    n = m * r
    A = [[0.0] * n for _ in range(n)]
    B = [[0.0] * m for _ in range(n)]
    C = [[0.0] * n for _ in range(m)]
    for a in range(m):
        for i in range(r - 1):
            A[a * r + i][a * r + i + 1] = 1.0
        B[a * r + r - 1] = [float(v) for v in M[a]]
        C[a][a * r] = 1.0
    start = [v for _ in range(m) for v in [x0] + [0.0] * (r - 1)]
    f = [v for _ in range(m) for v in [0.0] * (r - 1) + [push]]
    return {"kind": "linear", "A": A, "B": B, "C": C, "x0": start, "f": f}


def masses(H, q0, v0, f, M=None, K=None, **keys):
    """A lagrangian model; unit masses and no springs unless given."""
    n = len(q0)
    diagonal = lambda values: [[float(values[i]) if i == j else 0.0 for j in range(n)] for i in range(n)]
    return {
        "kind": "lagrangian", "M": diagonal(M or [1.0] * n), "K": K or diagonal([0.0] * n),
        "H": [[float(v) for v in row] for row in H], "q0": q0, "v0": v0, "f": f, **keys,
    }


def moreau_jean(model, end, step, theta=0.5, **time):
    return scene(model, end, step, scheme="moreau-jean", theta=theta, **time)
