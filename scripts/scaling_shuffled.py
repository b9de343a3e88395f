"""A chain and a lattice in their natural numbering, and shuffled. See scripts/scaling, which calls this."""

import argparse
import json
import os
import subprocess
import tempfile
from pathlib import Path

import numpy as np

COUPLING = 0.5
SCENE = """
[time]
scheme = "homsp"
end    = 10.0
step   = 1e-2
[model]
kind     = "chain"
element  = "jerk"
count    = {count}
coupling = "{name}.mtx"
a1       = "{name}_a1.mtx"
a2       = -2.0
a3       = -6.0
base     = 0.0
spread   = 0.0
force    = {{offset = -2.0, amplitude = 4.0, frequency = 1.0, phase_spread = {spread}}}
"""
GOLDEN = 0.6180339887498949  # turns of phase from one number to the next: no order of the elements is special


def neighbours(graph, side):
    """Both directions of each coupling, and how many neighbours an inner element has."""
    number = np.arange(side * side).reshape(side, side)
    if graph == "chain":
        ends = [(number.ravel()[:-1], number.ravel()[1:])]
    else:
        ends = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    one_way = np.vstack([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in ends])
    return np.vstack([one_way, one_way[:, ::-1]]), 2 * len(ends)


def write_vector(path, values):
    with path.open("w") as file:
        file.write(f"%%MatrixMarket matrix array real general\n{values.size} 1\n")
        file.writelines(f"{value!r}\n" for value in values.ravel().tolist())


def write_scene(folder, name, count, pairs, full, place):
    """Element i of the graph becomes number place[i] of the scene."""
    with (folder / f"{name}.mtx").open("w") as file:
        file.write(f"%%MatrixMarket matrix coordinate real general\n{count} {count} {len(pairs)}\n")
        file.writelines(f"{row + 1} {column + 1} {COUPLING}\n" for row, column in place[pairs])
    a1 = np.empty(count)
    a1[place] = -1.0 - COUPLING * (full - np.bincount(pairs[:, 0], minlength=count))  # the matrix has no ends
    write_vector(folder / f"{name}_a1.mtx", a1)
    (folder / f"{name}.toml").write_text(SCENE.format(count=count, name=name, spread=2.0 * np.pi * GOLDEN * count))
    return folder / f"{name}.toml"


def bench(scene, ranks, given):
    summary = scene.with_suffix(".json")
    words = ["bench", scene, "--warmup", given.warmup, "--count", given.count, "--summary", summary]
    subprocess.run(["mpirun", "--oversubscribe", "-n", *map(str, [ranks, os.environ["SWEEPVI"], *words])], check=True, stdout=subprocess.DEVNULL)
    return json.loads(summary.read_text())


def main():
    parser = argparse.ArgumentParser(prog="scripts/scaling shuffled", description="A jerk chain and lattice in natural numbering, and shuffled.")
    parser.add_argument("side", nargs="?", type=int, default=300, help="side^2 elements (default: %(default)s)")
    parser.add_argument("--ranks", default="1,2", help="default: %(default)s")
    parser.add_argument("--warmup", type=int, default=30, help="default: %(default)s")
    parser.add_argument("--count", type=int, default=60, help="default: %(default)s")
    given = parser.parse_args()
    count = given.side**2
    numberings = {"natural": np.arange(count), "shuffled": np.random.default_rng(1).permutation(count)}
    print(f"{count} jerk elements, steps {given.warmup + 1} to {given.warmup + given.count}: seconds per step, median (least)\n")
    print("| graph | ranks | natural | shuffled | ratio of medians (least) | couplings cut | contacts changed per step |")
    print("|---|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as name:
        for graph in ("chain", "lattice"):
            pairs, full = neighbours(graph, given.side)
            scenes = {key: write_scene(Path(name), f"{graph}_{key}", count, pairs, full, place) for key, place in numberings.items()}
            for ranks in map(int, given.ranks.split(",")):
                found = {key: bench(scene, ranks, given) for key, scene in scenes.items()}
                times = [f"{one['seconds_per_step']:.3g} ({one['seconds_least']:.3g})" for one in found.values()]
                ratio, least = (found["shuffled"][key] / found["natural"][key] for key in ("seconds_per_step", "seconds_least"))
                cuts = ", ".join(str(one["edge_cut"]) for one in found.values())
                changes = ", ".join(f"{one['contact_changes']:.4g}" for one in found.values())
                print(f"| {graph} | {ranks} | {' | '.join(times)} | {ratio:.2f} ({least:.2f}) | {cuts} | {changes} |", flush=True)


if __name__ == "__main__":
    main()
