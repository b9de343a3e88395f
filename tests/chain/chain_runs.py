"""Scenes of chains and their runs, for the chain tests."""

import json
import os
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import h5py
import program
from program import Verdict

REFERENCE = Path(__file__).resolve().parents[1] / "reference"
# Solvers lighter than the default MUMPS. The certificate of each step is the same whichever is used.
PETSC_LU = ["-pc_factor_mat_solver_type", "petsc"]  # one rank only
BLOCK_JACOBI = (  # the coupling is weak, h^3: a few sweeps reach rounding
    "-ksp_type richardson -ksp_rtol 1e-14 -ksp_max_it 30 -pc_type bjacobi -sub_pc_type lu"
    " -sub_pc_factor_mat_ordering_type rcm"
).split()


def toml(value):
    """A Python value as TOML writes it."""
    if isinstance(value, str):
        return json.dumps(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(toml, value)) + "]"
    return repr(value)


def write_scene(folder, name, time, model, output=None):
    """Writes a scene of these tables; returns its path."""
    path = Path(folder) / f"{name}.toml"
    with path.open("w") as file:
        for table, keys in (("time", time), ("model", model), ("output", output or {})):
            file.write(f"[{table}]\n")
            file.writelines(f"{key} = {toml(value)}\n" for key, value in keys.items())
    return path


def jerk_chain(count, coupling=0.5, **keys):
    return {"kind": "chain", "element": "jerk", "count": count, "coupling": coupling, **keys}


def homsp(end, step):
    return {"scheme": "homsp", "end": end, "step": step}


def call(*words, ranks=1, timeout=600):
    """The program with these words, expected to exit 0; its standard output."""
    outcome = program.run(*words, ranks=ranks, timeout=timeout)
    if outcome.code != 0:
        raise AssertionError(str(outcome))
    return outcome.out


def run(scene, ranks=1, options=(), name=None, timeout=600):
    """`sweepvi run`: the recorded file, open, and the summary. Runs of a scene that stay open need names of their own."""
    file = scene.with_name(f"{name or scene.stem}_np{ranks}.h5")
    summary = file.with_suffix(".json")
    call("run", scene, "-o", file, "--force", "--summary", summary, *options, ranks=ranks, timeout=timeout)
    return h5py.File(file, "r"), program.read_json(summary)
