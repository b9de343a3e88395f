#!/usr/bin/python3
"""An elastic bar as sweepvi's matrices: make.py [masses = 200] [folder = here]. Copy it to bring a model of your own."""

import sys
from pathlib import Path

import numpy as np
from scipy.io import mmwrite
from scipy.sparse import coo_matrix, diags

N = int(sys.argv[1]) if len(sys.argv) > 1 else 200
folder = Path(sys.argv[2]) if len(sys.argv) > 2 else Path(__file__).parent
dx = 1 / N  # length, cross section, density and modulus are 1
mass = np.full(N, dx)
mass[0] = dx / 2  # the foot stands for half a cell
stiffness = np.full(N, 2 / dx)
stiffness[0] = 1 / dx  # the foot is free, the mass above the last one is fixed
spring = np.full(N - 1, -1 / dx)
mmwrite(folder / "M.mtx", diags(mass))
mmwrite(folder / "K.mtx", diags([stiffness, spring, spring], [0, 1, -1]))
mmwrite(folder / "H.mtx", coo_matrix(([1.0], ([0], [0])), shape=(1, N)))  # the foot stays above the floor
mmwrite(folder / "q0.mtx", (1 - dx * np.arange(N).reshape(-1, 1)) / 2)
mmwrite(folder / "v0.mtx", np.zeros((N, 1)))
