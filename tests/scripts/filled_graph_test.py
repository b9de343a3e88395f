# timeout: 120
"""Distances of filled-in graphs, AB (66)-(69): closed forms, brute force, and example (65) against its exact solution."""

import json
import sys
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program
from program import Verdict

sys.path.insert(0, str(program.SOURCE / "scripts"))
import exact
from filled_graph import FilledGraph, excess, hausdorff

REFERENCE = Path(__file__).resolve().parents[1] / "reference" / "order65.json"


def test_a_late_jump(verdict):
    """Steps at 1 and at 1.25: their filled graphs are 0.25 apart, though the functions differ by 10 in between."""
    early = FilledGraph([0, 1, 1, 3], [0, 0, 10, 10])
    late = FilledGraph([0, 1.25, 1.25, 3], [0, 0, 10, 10])
    expect_close(verdict, "late jump", hausdorff(early, late, 1e-9), 0.25, 1e-9)


def test_the_farthest_point_inside_a_segment(verdict):
    """A line below a step of height 3: (8, 0) is max(3, 1) from the step's foot (5, 1), and 3 from the step above."""
    line = FilledGraph([0, 10], [0, 0])
    step = FilledGraph([0, 5, 5, 10], [1, 1, 3, 3])
    expect_close(verdict, "step over line", excess(step, line, 1e-3), 3.0, 1e-9)
    expect_close(verdict, "line under step", excess(line, step, 1e-3), 3.0, 1e-9)
    expect_close(verdict, "the part of the line under the foot", excess(FilledGraph([0, 5], [0, 0]), step, 1e-3), 1.0, 1e-9)
    expect_close(verdict, "line near the foot", excess(FilledGraph([0, 7], [0, 0]), step, 1e-3), 2.0, 1e-9)


def dense(graph, count):
    points = [(graph.t[k] + q * (graph.t[k + 1] - graph.t[k]), graph.x[k] + q * (graph.x[k + 1] - graph.x[k]))
              for k in range(len(graph.t) - 1) for q in np.linspace(0, 1, count)]
    return np.array([p[0] for p in points]), np.array([p[1] for p in points])


def test_random_graphs(verdict):
    """All points of a fine sampling, each against all of the other's: both errors are below the spacing."""
    rng = np.random.default_rng(1)
    for _ in range(20):
        graphs = []
        for _ in range(2):
            t = np.sort(rng.uniform(0, 3, 8))
            t[4] = t[3]  # a jump
            graphs.append(FilledGraph(t, rng.normal(size=(8, 2))))
        (t1, x1), (t2, x2) = dense(graphs[0], 120), dense(graphs[1], 120)
        apart = np.maximum(np.abs(t1[:, None] - t2), np.linalg.norm(x1[:, None] - x2, axis=2))
        brute = max(apart.min(axis=1).max(), apart.min(axis=0).max())
        spacing = max(np.linalg.norm(np.diff(g.x, axis=0), axis=1).max() for g in graphs) / 119
        found = hausdorff(*graphs, 1e-4)
        verdict.expect(abs(found - brute) <= spacing, f"random graphs: {found}, by brute force {brute} +- {spacing}")


def test_example65(folder, verdict):
    """The reference's distances come from an independent program; rtol: its own sampling, 1e-6 of the distance."""
    true = FilledGraph(*exact.example65())
    for known in json.loads(REFERENCE.read_text()):
        if known["h"] < 5e-3:
            continue
        path = folder / "run.h5"
        program.run("run", program.SOURCE / "examples/paper65/scene.toml", "--set", f"time.step={known['h']!r}",
                    "-o", path, "--force")
        with h5py.File(path) as file:
            run = FilledGraph(file["t"][...], file["x"][...])
        expect_close(verdict, f"h = {known['h']}", hausdorff(run, true, 1e-6), known["haus"], 1e-6)
        expect_close(verdict, f"h = {known['h']}, z", hausdorff(outputs(run), outputs(true), 1e-6), known["haus_z"], 1e-6)


def outputs(graph):
    return FilledGraph(graph.t, graph.x[:, :3])


def expect_close(verdict, what, found, expected, rtol):
    verdict.expect(abs(found - expected) <= rtol * expected, f"{what}: {found}, expected {expected} to {rtol}")


def main():
    verdict = Verdict()
    test_a_late_jump(verdict)
    test_the_farthest_point_inside_a_segment(verdict)
    test_random_graphs(verdict)
    with program.temporary_folder() as folder:
        test_example65(Path(folder), verdict)
    verdict.exit()


main()
