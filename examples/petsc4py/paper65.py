#!/usr/bin/python3
"""Acary & Brogliato's example (65) with petsc4py alone: what TS and SNESVI do by themselves, and where they go wrong.

Three integrators behind a wall with two-dimensional zero dynamics; lambda acts on the third (relative degree 3):

    z1' = z2,  z2' = z3,  z3' = -z1 - z2 - z3 + xi2 + lambda,  xi1' = xi2,  xi2' = z1 - xi2,   0 <= z1  _|_  lambda >= 0

from (1, 0, 0, 0, 0) at 0 s to 10 s. Source: V. Acary, B. Brogliato, Numerical time integration of higher order
dynamical systems with state constraints, AB (65). TS writes a step as F = E u' - G u, and SNESVI makes row i of F
complementary to u_i where that is bounded. So backward Euler with bounds on z_1..z_r* is the higher order sweeping
process, AB (32)-(45), if r* follows its level rule: 1 where z_1 > 0, 2 where z_1 <= 0 < z_2, 3 where both are <= 0.
The traps are what else one would write. Prints tables of errors and times; PETSc calls nearly all of it converged.

Run: examples/petsc4py/paper65.py --sweepvi build/release/sweepvi        (packages python3-petsc4py, python3-h5py)
"""

import argparse
import json
import subprocess
import tempfile
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from petsc4py import PETSc

SCENE = Path(__file__).resolve().parents[1] / "paper65" / "scene.toml"
A = np.array([[0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [-1, -1, -1, 0, 1], [0, 0, 0, 0, 1], [1, 0, 0, -1, 0]], dtype=float)
END = 10.0  # s
EXACT = [2.038074313834594676, 0.453192855214661465, -1.056047929937494749, 2.615870338795054074, 0.624221522682221825]
REASONS = {value: name for name, value in vars(PETSc.SNES.ConvergedReason).items() if name.isupper() and value}


@dataclass(frozen=True)
class Variant:
    bounded: str = "levels"  # z_1..z_r*; or only "z1"; or "lambda", a sixth unknown with 0 <= lambda _|_ z1 >= 0
    held: bool = True  # put what a step holds at the wall exactly there: the next r* must not read its rounding
    snes: str = "vinewtonrsls"
    ts: str = "beuler"
    infinity: float = PETSc.INFINITY  # the bound of those that have none
    unit: float = 1.0  # of z and xi; the system is homogeneous and its solution scales with them


RIGHT, SEMISMOOTH = Variant(), Variant(snes="vinewtonssls")
TRAPS = {
    "bound on z_1 alone": Variant("z1"),
    "lambda an unknown, semismooth": Variant("lambda", snes="vinewtonssls"),
    "lambda an unknown, reduced space": Variant("lambda"),
    "levels, semismooth, 1e30 for infinity": Variant(snes="vinewtonssls", infinity=1e30),
    "levels, `theta` as it comes (1/2)": Variant(ts="theta"),
    "levels, `cn`, semismooth": Variant(ts="cn", snes="vinewtonssls"),
    "levels, `cn`, reduced space": Variant(ts="cn"),
    "levels, unit 1e-6": Variant(unit=1e-6),
    "levels, unit 1e-6, semismooth": Variant(unit=1e-6, snes="vinewtonssls"),
    "levels, no mask of what is held": Variant(held=False),
}


@dataclass
class Run:
    x: np.ndarray  # [steps + 1, 5] in the variant's unit, up to the step that failed
    seconds: float
    verdict: Counter  # SNES's reasons, step by step

    def error(self, steps):
        return np.linalg.norm(self.x[-1] - EXACT) if len(self.x) == steps + 1 else np.nan


def sparse(rows):
    matrix = PETSc.Mat().createAIJ(rows.shape, nnz=len(rows), comm=PETSc.COMM_SELF)
    for i, j in zip(*np.nonzero(abs(rows) + np.eye(len(rows)))):  # the diagonal is filled in by jacobian()
        matrix[i, j] = rows[i, j]
    matrix.assemble()
    return matrix


def march(variant, steps):
    h, n = END / steps, 6 if variant.bounded == "lambda" else 5
    mass, rows = np.ones(n), np.zeros((n, n))
    rows[:5, :5] = A
    if n == 6:  # z3' = .. + lambda, and the row of lambda is z1
        mass[5], rows[2, 5], rows[5, 0] = 0, 1, -1
    G, J = sparse(rows), sparse(rows)
    u = G.createVecLeft()
    work, E, lower, upper = (u.duplicate() for _ in range(4))
    E.array[:] = mass
    diagonal = -G.getDiagonal()
    u.array[0] = variant.unit

    def residual(ts, t, u, rate, F):
        G.mult(u, F)
        work.pointwiseMult(E, rate)
        F.aypx(-1, work)

    def jacobian(ts, t, u, rate, shift, J, P):  # anew each time: the semismooth solver overwrites it
        G.copy(P, PETSc.Mat.Structure.SAME_NONZERO_PATTERN)
        P.scale(-1)
        work.waxpy(shift, E, diagonal)
        P.setDiagonal(work)

    ts = PETSc.TS().create(PETSc.COMM_SELF)
    ts.setIFunction(residual, u.duplicate())
    ts.setIJacobian(jacobian, J)
    ts.setType(variant.ts)
    ts.setTimeStep(h)
    ts.setMaxSteps(steps)
    ts.setMaxTime(2 * END)  # steps are counted: time is a sum of them
    ts.setExactFinalTime(PETSc.TS.ExactFinalTime.STEPOVER)
    snes = ts.getSNES()
    snes.setType(variant.snes)
    snes.ksp.setType("preonly")
    snes.ksp.pc.setType("lu")
    snes.ksp.pc.setFactorOrdering("natural")  # others meet zero pivots with lambda
    ts.setFromOptions()
    upper.set(variant.infinity)

    def bound(components):
        lower.set(-variant.infinity)
        lower.array[components] = 0
        snes.setVariableBounds(lower, upper)

    x, verdict = np.zeros((steps + 1, n)), Counter()
    x[0] = u.array
    level = 1

    def before(ts):
        nonlocal level
        closed = u.array_r[:2] <= 0
        level = 1 if not closed[0] else 3 if closed[1] else 2
        bound(slice(level))

    def after(ts):
        if variant.bounded == "levels" and variant.held:
            z = u.array
            terms = abs(x[ts.step_number - 1]) + h * (abs(A) @ abs(z))  # of the rows, to judge rounding by
            z[:level][abs(z[:level]) <= 1e-12 * terms[:level]] = 0
        x[ts.step_number] = u.array_r
        verdict[REASONS[snes.reason]] += 1

    if variant.bounded == "levels":
        ts.setPreStep(before)
    else:
        bound([0 if n == 5 else 5])
    ts.setPostStep(after)
    started = perf_counter()
    try:
        ts.solve(u)
    except PETSc.Error:  # TS stops here, aloud
        if ts.reason >= 0:
            raise
        verdict[REASONS[snes.reason]] += 1
    return Run(x[: ts.step_number + 1, :5] / variant.unit, perf_counter() - started, verdict)


def sweepvi(program, steps, *options):
    """States and seconds of stepping of `sweepvi run` on the same scene."""
    import h5py

    with tempfile.TemporaryDirectory() as folder:
        file, summary = Path(folder) / "run.h5", Path(folder) / "run.json"
        words = ["--set", f"time.step={END / steps!r}", "-o", file, "--summary", summary, *options]
        subprocess.run([program, "run", SCENE, *words], check=True, capture_output=True)
        with h5py.File(file) as data:
            return data["x"][:], json.loads(summary.read_text())["seconds_stepping"]


def table(head, rows):
    print("\n| " + " | ".join(head) + " |\n|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)


def right(counts, program, repeats):
    for steps in counts:
        runs = [
            min((march(variant, steps) for _ in range(repeats)), key=lambda run: run.seconds)
            for variant in (RIGHT, SEMISMOOTH)
        ]
        row = [f"{END / steps:.0e}", f"{steps}", f"{runs[0].error(steps):.3g}"]
        seconds = [run.seconds for run in runs]
        if program:
            for options in ((), ("-pc_factor_mat_solver_type", "petsc")):
                ours = min((sweepvi(program, steps, *options) for _ in range(repeats)), key=lambda run: run[1])
                seconds.append(ours[1])
            row += [f"{abs(run.x - ours[0]).max():.1g}" for run in runs]
        yield row + [f"{s:.3g} ({s / steps * 1e6:.0f})" for s in seconds]


def said(verdict):
    return ", ".join(f"{reason} {count}" for reason, count in verdict.items())


def traps(counts):
    for name, variant in TRAPS.items():
        runs = [march(variant, steps) for steps in counts]
        errors = [
            f"{run.error(steps):.3g}" if len(run.x) > steps else f"stops at {(len(run.x) - 1) * END / steps:.3g} s"
            for run, steps in zip(runs, counts)
        ]
        yield [name, *errors, said(sum((run.verdict for run in runs), Counter()))]


def residue(counts):
    """Without the mask: how many of these numbers of steps give other states, which no contact, SNES's reasons."""
    changed, missed, verdict = 0, [], Counter()
    for steps in counts:
        masked, plain = march(RIGHT, steps), march(Variant(held=False), steps)
        changed += abs(masked.x - plain.x).max() > 1e-6
        if not (plain.x[:, :3] == 0).all(axis=1).any():
            missed.append((steps, plain.error(steps), masked.error(steps)))
        verdict += plain.verdict
    return changed, missed, verdict


def main():
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--steps", default="1e-1,1e-2,1e-3,1e-4", help="step sizes [s] (default %(default)s)")
    parser.add_argument("--sweepvi", metavar="PROGRAM", help="run this beside it")
    parser.add_argument("--repeats", type=int, default=3, help="the fastest of so many is shown (default %(default)s)")
    options = parser.parse_args()
    counts = [round(END / float(h)) for h in options.steps.split(",")]

    head = ["h", "steps", "final error", "reduced space", "semismooth"]
    if options.sweepvi:
        head[3:3] = ["states off sweepvi's by", "semismooth by"]
        head += ["sweepvi", "sweepvi, PETSc's LU"]
    print("Levels and mask by hand; seconds of stepping (microseconds per step)")
    table(head, right(counts, options.sweepvi, options.repeats))
    print("\nFinal errors of what else one may write")
    table(["", *(f"{END / steps:.0e}" for steps in counts), "PETSc says"], traps(counts))
    some = range(100, 1000, 9)
    changed, missed, verdict = residue(some)
    print(f"\nNo mask, {len(some)} step sizes from 10/100 to 10/1000: {changed} give other states,", end=" ")
    print(f"{len(missed)} miss the contact altogether.\nPETSc says {said(verdict)}. The last of them:")
    for steps, error, masked in missed[-1:]:
        print(f"h = 10/{steps}, error {error:.3g} instead of {masked:.3g}")


if __name__ == "__main__":
    main()
