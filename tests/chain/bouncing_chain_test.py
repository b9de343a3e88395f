# Chains that bounce (moreau-jean), and `kind = "lagrangian"` solved as a first-order system (homsp), run as scenes.
#
# ranks: 3
# timeout: 240
import sys
from pathlib import Path

import numpy as np
from chain_runs import Verdict, homsp, program, run, write_scene

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))
import gallery

COUNT, STEPS, H = 100, 200, 1e-2
TIME = {"scheme": "moreau-jean", "end": STEPS * H, "step": H, "theta": 0.5}


def result_of(file, summary):
    fields = ("t", "x", "w", "mu", "level", "events", "energy", "work")
    t, x, w, mu, level, events, energy, work = (file[name][:] for name in fields)
    return gallery.Result(float(file.attrs["step"]), t, x, w, None, mu, level, events, summary, energy, work)


def bounce(folder, name, model, K, f, H, g0, e, verdict, tolerance):
    """Every step of the run, on 1, 2 and 3 ranks, against the scheme's equations and balances."""
    scene = write_scene(folder, name, TIME, {"kind": "chain", "count": COUNT, **model})
    runs = []
    for ranks in (1, 2, 3):
        file, summary = run(scene, ranks)
        result = result_of(file, summary)
        try:
            gallery.audit_mechanics(result, np.eye(COUNT), K, f, H, g0, e, tolerance=tolerance)
            complaint = ""
        except AssertionError as error:
            complaint = str(error)
        impacts = len(result.impacts())
        verdict.expect(complaint == "" and impacts > 50, f"{name}, {ranks} ranks: {impacts} impacts {complaint}")
        names = file["x"].attrs["names"].tolist(), file["x"].attrs["order"]
        verdict.expect(names == (["q", "v"], "state by state"), f"{name}: names of /x {names}")
        runs.append(result)
    for other in runs[1:]:
        # Rounding differs, and impacts amplify it, but no impact moves by a step.
        difference = abs(other.x - runs[0].x).max()
        verdict.expect(difference <= 1e-11, f"{name}: ranks differ by {difference:.1e}")
    part = write_scene(folder, name + "_part", TIME, {"kind": "chain", "count": COUNT, **model}, {"blocks": [3, 50]})
    file, _ = run(part, 2)
    same = np.array_equal(file["element"][:], [3, 50])
    difference = abs(file["x"][:] - runs[0].x[:, [3, 50, COUNT + 3, COUNT + 50]]).max()
    verdict.expect(same and difference <= 1e-11, f"{name}: two elements alone, {difference:.1e} off")


def first_order_form(folder, verdict):
    """A wall chain without restitution is one system, whether told as elements or by its matrices."""
    n, mass, force = 12, 2.0, -0.5
    S = gallery.laplacian(n)
    q0 = 0.1 + 0.05 * np.sin(6 * np.pi * np.arange(n) / n)
    chain = {"kind": "chain", "element": "wall", "count": n, "mass": mass, "damping": 0.3, "e": 0.0}
    given = {
        "kind": "lagrangian", "M": (mass * np.eye(n)).tolist(), "K": (-S).tolist(), "Cv": (0.3 * np.eye(n)).tolist(),
        "H": np.eye(n).tolist(), "f": [force] * n, "q0": q0.tolist(), "v0": [0.0] * n,
    }  # fmt: skip
    for scheme in (homsp(2.0, H), {**TIME, "theta": 1.0}):
        runs = []
        for kind, model in (("chain", chain), ("lagrangian", given)):
            file, _ = run(write_scene(folder, f"{kind}_{scheme['scheme']}", scheme, model), 2)
            runs.append(file)
        difference = max(abs(runs[0][name][:] - runs[1][name][:]).max() for name in ("x", "w", "mu"))
        touched = (runs[0]["w"][:] <= 0).any(axis=0).all()
        verdict.expect(touched and difference <= 1e-12, f"two ways to say it, {scheme['scheme']}: {difference:.1e}")


if __name__ == "__main__":
    verdict = Verdict()
    with program.temporary_folder() as folder:
        one = np.eye(COUNT)
        wall = -gallery.laplacian(COUNT)
        bounce(folder, "wall", {"element": "wall", "e": 0.7}, wall, np.full(COUNT, -0.5), one, 0.0, 0.7, verdict, 1e-12)
        offsets = np.r_[0.0, np.full(COUNT - 1, -1.0)]
        # Heights are up to 105, with the rounding of such numbers.
        bounce(folder, "contact", {"element": "contact", "e": 0.5}, 0 * one, -np.ones(COUNT), one - np.eye(COUNT, k=-1),
               offsets, 0.5, verdict, 1e-11)  # fmt: skip
        first_order_form(folder, verdict)
    verdict.exit()
