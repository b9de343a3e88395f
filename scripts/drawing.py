"""How our figures look: colours and matplotlib's settings, for scripts that draw into files."""

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402  (the backend comes first)

COLOURS = ["#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000"]  # Okabe & Ito
MUTED = "#666666"
STYLE = {
    "font.family": "DejaVu Sans", "font.size": 8.5, "axes.titlesize": 9, "axes.labelsize": 8.5, "legend.fontsize": 7.5,
    "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": "#888888", "axes.linewidth": 0.6,
    "axes.grid": True, "grid.color": "#e6e6e6", "grid.linewidth": 0.5, "axes.axisbelow": True,
    "xtick.color": "#444444", "ytick.color": "#444444", "xtick.major.width": 0.6, "ytick.major.width": 0.6,
    "lines.linewidth": 0.9, "legend.frameon": False, "legend.handlelength": 1.4, "axes.formatter.limits": (-3, 4),
    "axes.formatter.use_mathtext": True, "agg.path.chunksize": 20000,
}
