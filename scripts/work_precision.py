"""Work-precision pictures: what errors cost, from the table that 'sweepvi study --csv' writes."""

import csv

import numpy as np
from drawing import COLOURS, MUTED, plt

ERRORS = {"final": "final error, 2-norm", "hausdorff": "Hausdorff distance of the filled graphs"}
WORK = {"seconds": "seconds of stepping, median; bars: least to most", "steps": "steps (hybrid: Taylor series and time steps)"}
MARKERS = "osD^vP*X"


def read_study(path):
    """{name: {column: numbers}} of what was done, in the table's order; names are schemes, with settings if there are
    several. Raises ValueError if it is another table."""
    with open(path, newline="") as file:
        rows = list(csv.DictReader(file))
    columns = [*ERRORS, *WORK, "seconds_min", "seconds_max"]
    missing = {"scheme", "setting", "status", *columns} - set(rows[0] if rows else ())
    if missing:
        raise ValueError(f"it has no rows with {', '.join(sorted(missing))}")
    several = len({row["setting"] for row in rows}) > 1
    series = {}
    for row in rows:
        name = row["scheme"] + (f", {row['setting']}" if several else "")
        if row["status"] == "done":
            series.setdefault(name, []).append([float(row[column]) for column in columns])
    if not series:
        raise ValueError("every run in it failed")
    return {name: dict(zip(columns, np.array(numbers).T)) for name, numbers in series.items()}


def draw(ax, series, error, work):
    for i, (name, column) in enumerate(series.items()):
        shown = column[error] > 0  # a logarithm shows no 0
        x, y = column[work][shown], column[error][shown]
        colour = COLOURS[i % len(COLOURS)]
        label = name + (f" ({np.count_nonzero(~shown)} of error 0)" if not shown.all() else "")
        ax.plot(x, y, color=colour, marker=MARKERS[i // len(COLOURS) % len(MARKERS)], markersize=4, label=label)
        if work == "seconds":
            ax.hlines(y, column["seconds_min"][shown], column["seconds_max"][shown], color=colour, linewidth=2.5, alpha=0.4)
    ax.set_xscale("log")
    ax.set_yscale("log")


def work_precision_figure(series, title):
    """Each error against each measure of work."""
    figure, axes = plt.subplots(len(ERRORS), len(WORK), figsize=(10, 7.5), sharex="col", constrained_layout=True)
    figure.suptitle(title, x=0.01, ha="left", fontsize=12, fontweight="bold")
    for line, error in zip(axes, ERRORS):
        for ax, work in zip(line, WORK):
            draw(ax, series, error, work)
        line[0].set_ylabel(ERRORS[error])
    for ax, work in zip(axes[-1], WORK):
        ax.set_xlabel(WORK[work], color=MUTED)
    axes[0][-1].legend()
    return figure
