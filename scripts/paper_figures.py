"""Draws the figures of the two papers, and some more, from scenes of examples/, with the exact solution where there is one.

usage: paper_figures.py PROGRAM FOLDER [NAME ...]    PROGRAM: sweepvi; all figures unless NAMEs are given
"""

import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np
from drawing import COLOURS, MUTED, STYLE, plt

import exact
from filled_graph import FilledGraph, hausdorff

ROOT = Path(__file__).resolve().parents[1]
COMPUTED = {"color": COLOURS[0], "linewidth": 1.0}
EXACT = {"color": COLOURS[1], "linewidth": 0.8, "linestyle": (0, (4, 2)), "label": "exact"}
FIGURES = {}


def figure(draw):
    """Registers a function: its name is the figure's file."""
    FIGURES[draw.__name__] = draw
    return draw


class Runs:
    """Results of scenes, each computed once."""

    def __init__(self, program, folder):
        self.program, self.folder, self.results = program, folder, {}

    def __call__(self, scene, *settings):
        key = (scene, *settings)
        if key not in self.results:
            path = Path(self.folder) / f"run{len(self.results)}.h5"
            words = [word for setting in settings for word in ("--set", setting)]
            subprocess.run([self.program, "run", ROOT / "examples" / scene, *words, "-o", path],
                           check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            with h5py.File(path) as file:
                self.results[key] = {name: file[name][...] for name in file if isinstance(file[name], h5py.Dataset)}
            path.unlink()
        return self.results[key]


def panels(rows, columns, size):
    fig, axes = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    return fig, axes.ravel()


def finish(ax, xlabel, ylabel, title=""):
    ax.set_xlabel(xlabel)
    ax.set_ylabel(ylabel)
    ax.set_title(title, loc="left")
    if ax.get_legend_handles_labels()[0]:
        ax.legend()


# ---------------------------------------------------------------- Acary & Brogliato

@figure
def ab_figure1(runs):
    """Bouncing ball: position, velocity, impulse, energy."""
    run = runs("ball/scene.toml")
    t, (q, v) = run["t"], run["x"].T
    t_exact, q_exact, v_exact, _ = exact.bouncing_ball(1.0, 0.0, 10.0, 0.8, t[-1])
    fig, ax = panels(2, 2, (7.2, 4.8))
    ax[0].plot(t, q, **COMPUTED, label="h = 5e-3")
    ax[0].plot(t_exact, q_exact, **EXACT)
    finish(ax[0], "time (s)", "position (m)", "(a)")
    ax[1].plot(t, v, **COMPUTED, label="h = 5e-3")
    ax[1].plot(t_exact, v_exact, **EXACT)
    finish(ax[1], "time (s)", "velocity (m/s)", "(b)")
    impulse = run["mu"][:, 0, -1]
    ax[2].vlines(t[impulse > 0], 0.0, impulse[impulse > 0], **COMPUTED, label="h = 5e-3")
    hits = np.flatnonzero((np.diff(t_exact) == 0.0) & (np.diff(v_exact) > 0.0))
    ax[2].plot(t_exact[hits], v_exact[hits + 1] - v_exact[hits], "o", markersize=3, markerfacecolor="none",
               color=COLOURS[1], label="exact")
    finish(ax[2], "time (s)", "impulse (N s)", "(c)")
    kinetic, potential, dissipated = run["energy"].T
    ax[3].plot(t, kinetic + potential, color=COLOURS[0], label="total")
    ax[3].plot(t, kinetic, color=COLOURS[1], label="kinetic")
    ax[3].plot(t, potential, color=COLOURS[2], label="potential")
    ax[3].plot(t, kinetic + potential + dissipated, color=MUTED, linestyle=(0, (1, 1.5)), label="total + dissipated")
    finish(ax[3], "time (s)", "energy (J)", "(d)")
    return fig


@figure
def ab_figure2(runs):
    """Trajectories of z and xi of example (65), h = 1e-1."""
    run = runs("paper65/scene.toml", "time.step=1e-1")
    t, x = exact.example65()
    fig, ax = panels(5, 1, (6.4, 7.2))
    for k, name in enumerate(("z_1", "z_2", "z_3", r"\xi_1", r"\xi_2")):
        ax[k].plot(run["t"], run["x"][:, k], ".-", markersize=2.5, **COMPUTED, label="h = 1e-1")
        ax[k].plot(t, x[:, k], **EXACT)
        finish(ax[k], "time (s)" if k == 4 else "", f"${name}$")
    for part in ax[1:]:
        part.get_legend().remove()
    return fig


@figure
def ab_figure3(runs):
    """Empirical order on example (65): Hausdorff distance of filled-in graphs, AB (66)-(69)."""
    def graph(step):
        run = runs("paper65/scene.toml", f"time.step={step}")
        return FilledGraph(run["t"], run["x"])

    true, fine = FilledGraph(*exact.example65()), graph("1e-5")
    steps = np.array([1e-1, 3e-2, 1e-2, 3e-3, 1e-3, 3e-4, 1e-4])
    graphs = [graph(repr(step)) for step in steps]
    to_true = np.array([hausdorff(g, true) for g in graphs])
    to_fine = np.array([hausdorff(g, fine) for g in graphs])
    for row in zip(steps, to_true, to_fine):
        print("  h = {:g}: distance {:.4g} from the exact solution, {:.4g} from the run at h = 1e-5".format(*row))
    print(f"  h = 1e-5 itself is {hausdorff(fine, true):.3g} from the exact solution")
    fig, ax = panels(1, 1, (4.6, 3.6))
    ax[0].loglog(steps, to_true, "o-", **COMPUTED, markersize=4, label="from the exact solution")
    ax[0].loglog(steps, to_fine, "x", color=COLOURS[1], markersize=5, label="from a run at h = 1e-5, as in the paper")
    ax[0].loglog(steps, to_true[-1] * steps / steps[-1], color=MUTED, linewidth=0.6, label="slope 1")
    finish(ax[0], "step h (s)", "Hausdorff distance")
    return fig


# ---------------------------------------------------------------- Huber & Oza

def ball(runs):
    """The ball of HO section II: run, and exact t, s, v, x, x'."""
    run = runs("zi_ball/scene.toml")
    kappa, gravity = 0.41, 9.81
    t, x, velocity, hits = exact.bouncing_ball(1.0, 6.0, gravity, (1.0 - kappa) / (1.0 + kappa), run["t"][-1])
    side = np.where(hits % 2 == 0, 1.0, -1.0)  # s changes its sign at each impact
    v = side * velocity / (1.0 - kappa * np.sign(velocity))
    return run, (t, side * x, v, x, velocity)


@figure
def ho_figure1(runs):
    """The ball in the (s, v) plane."""
    run, (_, s, v, _, _) = ball(runs)
    fig, ax = panels(1, 1, (4.6, 3.6))
    ax[0].plot(*run["z"].T, **COMPUTED, label="h = 1e-3")
    ax[0].plot(s, v, **EXACT)
    finish(ax[0], "s", "v")
    return fig


@figure
def ho_figure2(runs):
    """s and v against time."""
    run, (t, s, v, _, _) = ball(runs)
    fig, ax = panels(1, 1, (6.4, 3.2))
    for k, (name, true) in enumerate((("s", s), ("v", v))):
        ax[0].plot(run["t"], run["z"][:, k], color=COLOURS[3 * k], label=name)
        ax[0].plot(t, true, **{**EXACT, "label": "exact" if k else None})
    finish(ax[0], "time (s)", "s, v")
    return fig


@figure
def ho_figure3(runs):
    """The signs, lambda_s and lambda_v."""
    run, (t, s, v, _, _) = ball(runs)
    fig, ax = panels(2, 1, (6.4, 3.6))
    for k, (name, true) in enumerate((("s", s), ("v", v))):
        ax[k].step(run["t"][1:], run["lambda"].reshape(len(run["t"]), -1)[1:, k], where="pre", **COMPUTED,
                   label="h = 1e-3")
        moving = t < t[-2] if t[-1] > t[-2] else t <= t[-1]  # at rest the signs are not those of s and v
        ax[k].plot(t[moving], np.sign(true[moving]), **EXACT)
        finish(ax[k], "time (s)" if k else "", f"$\\lambda_{name}$")
    return fig


@figure
def ho_figure4(runs):
    """Position and velocity of the ball."""
    run, (t, _, _, x, velocity) = ball(runs)
    fig, ax = panels(2, 1, (6.4, 4.2))
    for k, (label, true) in enumerate((("position (m)", x), ("velocity (m/s)", velocity))):
        ax[k].plot(run["t"], run["x"][:, k], **COMPUTED, label="h = 1e-3")
        ax[k].plot(t, true, **EXACT)
        finish(ax[k], "time (s)" if k else "", label)
    return fig


@figure
def ho_figure5(runs):
    """The regulator (3) in the (s, v) plane, without external force."""
    run = runs("zi_regulator/scene.toml")
    _, s, v = exact.regulator(*run["z"][0], 0.5, 30.0, 17.0, run["t"][-1])
    fig, ax = panels(1, 1, (4.6, 3.6))
    ax[0].plot(*run["z"].T, **COMPUTED, label="h = 1e-3")
    ax[0].plot(s, v, **EXACT)
    finish(ax[0], "s", "v")
    return fig


def tracking(runs, columns, label):
    run = runs("zi_tracking/scene.toml")
    fig, ax = panels(1, 1, (6.4, 3.2))
    for k, (column, name) in enumerate(zip(columns, ("controlled", "reference"))):
        ax[0].plot(run["t"], run["x"][:, column], color=COLOURS[k], linestyle="-" if k == 0 else (0, (4, 2)), label=name)
    finish(ax[0], "time (s)", label)
    return fig


@figure
def ho_figure6(runs):
    """Positions of the controlled and the reference system."""
    return tracking(runs, (0, 1), "position (m)")


@figure
def ho_figure7(runs):
    """Velocities of the controlled and the reference system."""
    return tracking(runs, (2, 3), "velocity (m/s)")


@figure
def ho_figure8(runs):
    """The control input."""
    run = runs("zi_tracking/scene.toml")
    fig, ax = panels(1, 1, (6.4, 3.2))
    ax[0].step(run["t"][1:], run["u"].ravel()[1:], where="pre", **COMPUTED)
    finish(ax[0], "time (s)", "control u (N)")
    return fig


# ---------------------------------------------------------------- beyond the papers

@figure
def hysteresis(runs):
    """Loops of the play and the stop operator over the input y = 2 sin(2 pi t)."""
    fig, ax = panels(1, 2, (7.2, 3.2))
    for part, scene, title in ((ax[0], "play_operator/scene.toml", "play"), (ax[1], "stop_operator/scene.toml", "stop")):
        run = runs(scene)
        part.plot(2.0 * np.sin(2.0 * np.pi * run["t"]), run["x"][:, 0], **COMPUTED)
        finish(part, "input y", "u", title)
    return fig


@figure
def moving_polygon(runs):
    """The path of a point that a hexagon pushes around, and the hexagon every half second."""
    run = runs("moving_polygon/scene.toml")
    fig, ax = panels(1, 1, (4.6, 4.2))
    corners = 0.5 / np.cos(np.pi / 6) * np.exp(1j * (np.pi / 3 * np.arange(7) + np.pi / 6))
    for k, t in enumerate((2.0, 2.25, 2.5, 2.75)):
        outline = corners + 2.0 * np.exp(2j * np.pi * t)
        ax[0].plot(outline.real, outline.imag, color=MUTED, linewidth=0.7, label=None if k else "the hexagon, each 0.25 s")
    ax[0].plot(*run["x"].T, **COMPUTED, label="the point")
    at = np.searchsorted(run["t"], (2.0, 2.25, 2.5, 2.75))
    ax[0].plot(*run["x"][at].T, "o", color=COLOURS[1], markersize=4, label="the point, each 0.25 s")
    ax[0].set_aspect("equal")
    finish(ax[0], "$u_1$", "$u_2$")
    return fig


@figure
def elastic_bar(runs):
    """The foot of the elastic bar, and the force that the floor takes."""
    run = runs("elastic_bar/scene.toml")
    t, h = run["t"], run["t"][1]
    fig, ax = panels(2, 1, (6.4, 4.2))
    phase = t % 3.0
    ax[0].plot(t, run["w"][:, 0], **COMPUTED, label="200 masses")
    ax[0].plot(t, np.maximum(0.0, np.maximum(1.0 - phase, phase - 2.0)) / 2.0, **EXACT)
    finish(ax[0], "", "foot above the floor")
    ax[1].plot(t, run["mu"][:, 0, -1] / h, **COMPUTED, label="200 masses, impulse / h")
    ax[1].plot(t, np.where((phase > 1.0) & (phase < 2.0), 0.5, 0.0), **EXACT)
    finish(ax[1], "time (s)", "contact force")
    return fig


def main(program, folder, *names):
    unknown = [name for name in names if name not in FIGURES]
    if unknown:
        sys.exit(f"figures: there is no figure {', '.join(unknown)}; known: {', '.join(FIGURES)}")
    plt.rcParams.update(STYLE)
    Path(folder).mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as scratch:
        runs = Runs(str(Path(program).resolve()), scratch)
        for name in names or FIGURES:
            path = Path(folder) / f"{name}.png"
            print(path, flush=True)
            fig = FIGURES[name](runs)
            fig.savefig(path, dpi=130, metadata={"Software": None})
            plt.close(fig)


if __name__ == "__main__":
    if len(sys.argv) < 3:
        sys.exit(__doc__)
    main(*sys.argv[1:])
