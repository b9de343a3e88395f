"""The scenes of examples/ with the runs their headers name, and the discrete equations their results must satisfy."""

import os
import re
import shlex
import sys
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

EXAMPLES = program.SOURCE / "examples"
REFERENCE = Path(__file__).resolve().parents[1] / "reference"


@dataclass
class Example:
    """One `# Run:` line of a scene: its words after `sweepvi run`, its ranks, and the `# Expect:` text below it."""

    scene: str
    words: list
    ranks: int
    expect: str


def examples():
    """Every run that a scene's header names, in order."""
    found = []
    for path in sorted(EXAMPLES.rglob("*.toml")):
        if {"studies", "scaling"} & set(path.relative_to(EXAMPLES).parts):  # solver settings; what tests/app/bench_test.py times
            continue
        name = str(path.relative_to(program.SOURCE))
        head = []
        for line in path.read_text().splitlines():
            if not line.startswith("#"):
                break
            head.append(line[1:].strip())
        runs = re.findall(r"Run:(.*?)Expect:(.*?)(?=Run:|$)", "\n".join(head), re.DOTALL)
        if not runs:
            raise AssertionError(f"{name}: the header has no '# Run:' with an '# Expect:' below it")
        for run, expect in runs:
            words = shlex.split(run)
            ranks = int(words[words.index("-n") + 1]) if words[0] == "mpirun" else 1
            words = words[words.index("sweepvi") + 1 :]
            if words[:2] != ["run", name]:
                raise AssertionError(f"{name}: '# Run: {run.strip()}' should run this scene")
            found.append(Example(name, words[1:], ranks, " ".join(expect.split())))
    return found


@dataclass
class Result:
    """What a run recorded."""

    h: float
    t: np.ndarray
    x: np.ndarray
    w: np.ndarray
    z: np.ndarray  # [row, constraint, level], or None
    mu: np.ndarray  # [row, constraint, level]
    level: np.ndarray
    events: np.ndarray
    summary: dict
    energy: np.ndarray = None  # mechanical scenes: kinetic, potential, dissipated
    work: np.ndarray = None  # and damping, forces, scheme

    def contacts(self):
        """Events in which a gap closes."""
        return self.events[(self.events["kind"] == 0) & (self.events["level"] == 1)]

    def impacts(self):
        """The same of bouncing masses: impulses of theirs are measures of level 2."""
        return self.events[(self.events["kind"] == 0) & (self.events["level"] == 2)]

    def lift_offs(self):
        return self.events[self.events["kind"] == 1]


def run(folder, example, *more, ranks=None, timeout=100):
    """Runs an example, with more words for the program, and reads its file."""
    name = f"run{os.urandom(4).hex()}"
    file, summary = Path(folder) / f"{name}.h5", Path(folder) / f"{name}.json"
    outcome = program.run(
        "run", *example.words, *more, "-o", file, "--summary", summary,
        ranks=ranks or example.ranks, cwd=program.SOURCE, timeout=timeout,
    )  # fmt: skip
    if outcome.code != 0:
        raise AssertionError(str(outcome))
    with h5py.File(file) as data:
        m = data["w"].shape[1]
        z = data["z"][:].reshape(len(data["t"]), m, -1) if "z" in data else None
        return Result(
            float(data.attrs["step"]), data["t"][:], data["x"][:], data["w"][:], z, data["mu"][:],
            data["level"][:], data["events"][:], program.read_json(summary),
            *(data[name][:] for name in ("energy", "work") if name in data),
        )  # fmt: skip


def laplacian(n, *more):
    """S of a chain (n) or a lattice (nx, ny; element i = ix + nx iy) with coupling 1 and fixed ends."""
    chain = np.eye(n, k=1) + np.eye(n, k=-1) - 2 * np.eye(n)
    return np.kron(np.eye(*more), chain) + np.kron(laplacian(*more), np.eye(n)) if more else chain


def jerk_matrix(S, a=(-1, -1, -1)):
    """A of jerk elements coupled by S, states element by element."""
    element = np.array([[0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [*a, 0, 1], [0, 0, 0, 0, 1], [1, 0, 0, -1, 0]])
    A = np.kron(np.eye(len(S)), element)
    A[2::5, ::5] += S
    return A


def audit_jerk(result, S=None, a=(-1, -1, -1), force=0.0):
    """Checks every recorded step against AB (32)-(45), read as conditions on z and mu alone; `force` like w.

    The step's problem has exactly one solution, so a z and mu that satisfy it are the scheme's, however found. Rounding
    is judged against the terms of each row, with the 1e-12 below which the program puts outputs on their bound.
    """
    count = result.w.shape[1]
    A, h = jerk_matrix(np.zeros((count, count)) if S is None else S, a), result.h
    force = np.broadcast_to(force, result.w.shape)
    x = result.x.reshape(len(result.t), count, 5)
    worst = 0.0
    for k in range(len(result.t) - 1):
        z, z_new, mu, level = result.z[k], result.z[k + 1], result.mu[k + 1], result.level[k + 1]
        rate = (A @ result.x[k + 1]).reshape(count, 5)
        size = (abs(A) @ abs(result.x[k + 1])).reshape(count, 5)
        rate[:, 2] += force[k + 1]
        size[:, 2] += abs(force).max()  # a sine is rounded relative to its amplitude
        defect = x[k + 1] - x[k] - h * rate
        terms = abs(x[k + 1]) + abs(x[k]) + h * size
        defect[:, :2] = z_new[:, :2] - z[:, :2] - h * z_new[:, 1:]
        terms[:, :2] = abs(z_new[:, :2]) + abs(z[:, :2]) + h * (abs(z_new[:, 1:]) + terms[:, 2:3])
        terms[:, :1] += h * terms[:, 1:2]
        defect[:, :3] -= mu
        worst = max(worst, (abs(defect) / np.maximum(terms, np.finfo(float).tiny)).max())

        closed = z <= 0
        rule = np.where(closed[:, 0], np.where(closed[:, 1], 3, 2), 1)
        assert (level == rule).all(), f"step {k + 1}: r* is not what z says"
        acts = np.arange(1, 4) <= level[:, None]
        assert (mu[~acts] == 0).all() and (mu >= 0).all(), f"step {k + 1}: measures"
        assert (z_new[acts] >= 0).all() and (mu * z_new == 0).all(), f"step {k + 1}: complementarity"
    assert worst < 1e-12, f"equations hold only to {worst:.2g} of their terms"


def audit_column(result, count, end):
    """Checks the closed form in the header of falling_column."""
    h, i = result.h, np.arange(count)
    landing = np.sqrt(2 * (0.1 + 0.05 * i))
    contacts = result.contacts()
    assert sorted(contacts["constraint"]) == list(i) and len(result.lift_offs()) == 0
    late = abs(contacts["t"] - landing[contacts["constraint"]]) / h
    assert late.max() <= 0.5 * (1 + 1e-6), f"a landing is {late.max():.3f} steps off"
    assert (result.w[-1] == 0).all() and (result.z[-1] == 0).all()
    # All that follows is of the size of the column's weight or length, which rounding is judged by.
    close = lambda found, wanted, size: np.testing.assert_allclose(found, wanted, atol=1e-12 * size)
    close(result.x[-1], [*i, *(0 * i)], count)
    close(result.mu[-1, :, 1], h * (count - i), h * count)
    close(result.mu[:, 0, 1].sum(), count * end, count * end)


def audit_mechanics(result, M, K, f, H, g0, e, theta=0.5, reach=1.0, tolerance=1e-12):
    """Checks every recorded step against AB (22)-(24) with the misprints corrected, and the energy balance."""
    h, n = result.h, len(M)
    q, v, mu, w = result.x[:, :n], result.x[:, n:], result.mu[:, :, 1], result.w
    dv, v_theta = np.diff(v, axis=0), theta * v[1:] + (1 - theta) * v[:-1]
    q_theta = theta * q[1:] + (1 - theta) * q[:-1]
    close = lambda found, wanted: np.testing.assert_allclose(found, wanted, atol=tolerance)
    close(np.diff(q, axis=0), h * v_theta)
    close(dv @ M.T + h * (q_theta @ K.T - f), mu[1:] @ H)
    close(w, q @ H.T + g0)
    old, new = v[:-1] @ H.T, v[1:] @ H.T
    acts = result.level[1:] == 2
    tested = w[:-1] + reach * h * old
    sure = abs(tested) > 1e-13  # where rounding does not decide
    assert (acts[sure] == (tested <= 0)[sure]).all(), "detection"
    assert (mu >= 0).all() and (mu[1:][~acts] == 0).all() and (result.mu[:, :, 0] == 0).all()
    natural = np.minimum(new + e * old, mu[1:])[acts]
    close(natural, 0)
    energy = result.energy.sum(axis=1) + result.work @ [1, -1, 1]
    np.testing.assert_allclose(energy, energy[0], atol=1e-14 * max(1, abs(energy[0])) * len(energy))
    close(result.energy[:, 0], 0.5 * np.einsum("ti,ij,tj->t", v, M, v))
    close(result.energy[:, 1], 0.5 * np.einsum("ti,ij,tj->t", q, K, q) - q @ f)
