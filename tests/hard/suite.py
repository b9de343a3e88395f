"""What a hard case is, how one is run, and how it is judged."""

import json
import math
import re
import sys
from dataclasses import dataclass, field
from pathlib import Path

import h5py
import numpy as np

TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(TESTS / "app"), str(TESTS / "reference")]
import program
from scheme_steps import Homsp, MoreauJean

# Both SNESVI types by themselves start from the last state; the ladder below them stays.
SOLVERS = {
    "default": [],
    "reduced space": ["-sweepvi_predictor", "none", "-snes_type", "vinewtonrsls"],
    "semismooth": ["-sweepvi_predictor", "none", "-snes_type", "vinewtonssls"],
}
CERTIFICATE = 1e-10  # -sweepvi_certificate_rtol


@dataclass
class Case:
    """One scene or problem, what is right for it, and who says so."""

    group: str
    name: str
    scene: dict  # tables of the scene; a table "problem" makes it one for `sweepvi solve`
    right: str  # what is right, for the table
    judge: object = None  # Run -> [(what, value, limit)]
    code: int = 0
    says: str = ""  # the error must match this, if code is not 0
    options: tuple = ()
    ranks: tuple = (1, 2)
    solvers: tuple = tuple(SOLVERS)
    quick: bool = False
    timeout: float = 60
    files: dict = field(default_factory=dict)  # further files of the scene, name to text


class Run:
    """What came of a case on so many ranks with such a solver."""

    def __init__(self, case, ranks, solver, folder):
        self.case, self.ranks, self.solver = case, ranks, solver
        folder = Path(folder)
        scene, out, summary = folder / "case.toml", folder / "case.h5", folder / "case.json"
        scene.write_text("".join(table(name, keys) for name, keys in case.scene.items()))
        for name, text in case.files.items():
            (folder / name).write_text(text)
        verb = "solve" if "problem" in case.scene else "run"
        self.outcome = program.run(
            verb, scene, "-o", out, "--summary", summary, *SOLVERS[solver], *case.options,
            ranks=ranks, cwd=folder, timeout=case.timeout,
        )
        self.code, self.error = self.outcome.code, self.outcome.err.strip()
        self.summary = json.loads(summary.read_text()) if summary.exists() else {}
        self.data = {}
        if out.exists():
            with h5py.File(out, "r") as file:
                file.visititems(lambda name, item: self.data.update({name: item[()]}) if isinstance(item, h5py.Dataset) else None)

    def __getitem__(self, name):
        return self.data[name]

    @property
    def model(self):
        return self.case.scene["model"]

    @property
    def time(self):
        return self.case.scene["time"]

    @property
    def h(self):
        start, end = self.time.get("start", 0.0), self.time["end"]
        return (end - start) / max(1, round((end - start) / self.time["step"]))

    def verdicts(self):
        """[(what, value, limit)]: right where value <= limit."""
        if self.code != self.case.code:
            return [(f"exit {self.code}, not {self.case.code}: {self.error[-400:]}", math.inf, 0)]
        if self.code:
            named = re.search(self.case.says, self.error) and self.case.says
            return [] if named else [(f"does not say {self.case.says!r}: {self.error[-400:]}", math.inf, 0)]
        return [("certificate", self.summary["max_residual"], CERTIFICATE), *self.case.judge(self)]


def toml(value):
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(v)}" for key, v in value.items()) + "}"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(float(value)) if isinstance(value, (float, np.floating)) else str(value)


def table(name, keys):
    return f"[{name}]\n" + "".join(f"{key} = {toml(value)}\n" for key, value in keys.items())


# ---------------------------------------------------------------- judges


def floats(rows):
    return np.array([[float(v) for v in row] for row in rows])


def worst(found, exact):
    """The largest error of each column over the largest value of that column in the exact run (or 1e-300)."""
    scale = np.maximum(np.abs(exact).max(axis=0), 1e-300)
    return float((np.abs(found - exact) / scale).max()) if exact.size else 0.0


def worst_of_all(found, exact):
    """The largest error over the largest value."""
    return float(np.abs(found - exact).max() / max(np.abs(exact).max(), 1e-300))


def rows_of(run):
    """Numbers of the steps whose end is recorded."""
    steps = round((run.time["end"] - run.time.get("start", 0.0)) / run.h)
    every = run.case.scene.get("output", {}).get("every", 1)
    return sorted({*range(0, steps + 1, every), steps})


def exact_homsp(limit=1e-10, state_limit=None, matrices=None, without=()):
    """The same steps in 60 digits: outputs, measures, states, and r* in every step."""
    known = []  # the exact run, once for all runs of the case

    def solve(run):
        m = {**run.model, **(matrices or {})}
        exact = Homsp(m["A"], m["B"], m["C"], m["x0"], run.h, m.get("f"), m.get("w0"), m.get("wmax"), run.time.get("start", 0))
        keep = rows_of(run)
        x, z, mu, level = [exact.x], [exact.z], [[0] * len(exact.z)], []
        total = [0] * len(exact.z)
        for step in range(1, keep[-1] + 1):
            exact.step()
            total = [a + b for a, b in zip(total, exact.measures())]
            if step in keep:
                x.append(exact.x)
                z.append(exact.z)
                mu.append(total)
                level.append(list(exact.level))
                total = [0] * len(exact.z)
        return floats(x), floats(z), floats(mu), np.array(level), exact.degree

    def judge(run):
        if not known:
            known.append(solve(run))
        x, z, mu, level, degree = known[0]
        measures = np.concatenate([run["mu"][:, a, :r] for a, r in enumerate(degree)], axis=1)
        found = [
            ("z", worst(run["z"], z), limit),
            ("mu", worst(measures, mu), limit),
            ("x", worst_of_all(run["x"], x), state_limit or limit),
            ("steps with another r*", float((run["level"][1:] != level).sum()), 0),
        ]
        return [entry for entry in found if entry[0] not in without]

    return judge


def exact_moreau_jean(limit=1e-10, impulses=True):
    """The same steps in 60 digits: coordinates, velocities, gaps and (where they are unique) impulses."""
    known = []

    def solve(run):
        m, t = run.model, run.time
        exact = MoreauJean(
            m["M"], m["K"], m["H"], m["q0"], m["v0"], run.h, m.get("Cv"), m.get("f"), m.get("g0"), m.get("e", 0),
            t.get("theta", 1), t.get("detection", "predicted"),
        )
        x, w, p = [exact.q + exact.v], [exact.gap], [[0] * len(exact.H)]
        for _ in range(rows_of(run)[-1]):
            exact.step()
            x.append(exact.q + exact.v)
            w.append(exact.gap)
            p.append(exact.impulse)
        return floats(x), floats(w), floats(p)

    def judge(run):
        if not known:
            known.append(solve(run))
        x, w, p = known[0]
        found = [("x", worst_of_all(run["x"], x), limit), ("w", worst_of_all(run["w"], w), limit)]
        return found + ([("mu", worst_of_all(run["mu"][:, :, 1], p), limit)] if impulses else [])

    return judge


def complementary(solution=None, limit=1e-12):
    """|min(u, M u + q)| over |q|, and the solution where it is known."""

    def judge(run):
        M, q = np.array(run.case.scene["problem"]["M"], float), np.array(run.case.scene["problem"]["q"], float)
        u = run["solution"].ravel()
        scale = max(np.abs(q).max(), 1e-300)
        found = [("min(u, F)", float(np.abs(np.minimum(u, M @ u + q)).max() / scale), limit)]
        if solution is not None:
            known = np.array(solution, float)
            found.append(("u", float(np.abs(u - known).max() / max(np.abs(known).max(), 1e-300)), limit))
        return found

    return judge
