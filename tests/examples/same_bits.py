"""Runs that must leave the same bits: what to compare, and scenes cut down so that they can be run often."""

import tomllib

import gallery
import h5py
import numpy as np
import program

STEPS = 150


def contents(path):
    """Every dataset of a file but the times that a run took, as bytes, by name."""
    with h5py.File(path) as file:
        names = []
        file.visititems(lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None)
        return {name: np.ascontiguousarray(file[name][()]).tobytes() for name in names if name != "solver/seconds"}


def differences(one, other):
    """Names of the datasets that are not the same to the bit."""
    one, other = contents(one), contents(other)
    return sorted(name for name in one.keys() | other.keys() if one.get(name) != other.get(name))


def short(scene):
    """Settings that make few steps of a scene's whole time, and a small system of a large one."""
    data = tomllib.loads((program.SOURCE / scene).read_text())
    time, model = data["time"], data["model"]
    span = time["end"] - time.get("start", 0.0)
    words = ["--set", f"time.step={max(time['step'], span / STEPS)}"]
    if model.get("count", 0) > 200 and model.get("topology") != "lattice":
        words += ["--set", "model.count=200"]
    return words


def scenes():
    return sorted({example.scene for example in gallery.examples()})


def two_runs_differ_in(scene, ranks, *words):
    """Names of the datasets that two runs of a scene, cut down, do not leave alike."""
    with program.temporary_folder() as folder:
        paths = [f"{folder}/{name}.h5" for name in ("one", "two")]
        for path in paths:
            outcome = program.run(
                "run", program.SOURCE / scene, "-o", path, *short(scene), *words, ranks=ranks, timeout=600
            )
            assert outcome.code == 0, outcome
        return differences(*paths)
