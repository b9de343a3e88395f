"""A working directory of its own for each test of the program from outside, and the scenes that several run."""

import sys
import unittest
from pathlib import Path

import h5py

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program

BALL = """title = "falling ball"
[time]
end = 2.0                  # s; the ball lands at sqrt(2) s
step = 0.1
[model]
kind = "linear"            # q'' = -1 + lambda, w = q, plastic
A = [[0, 1], [0, 0]]
B = [[0], [1]]
C = [[1, 0]]
f = [0, -1]
x0 = [1, 0]
"""

CHAIN = """title = "short chain"
[time]
end = 6.0
step = 0.02
[model]
kind = "chain"
element = "jerk"
count = 5
coupling = 0.5
"""

ONE_STATE = """[time]
end = 1.0
step = 0.1
[model]
kind = "linear"
A = [[0]]
B = [[1]]
C = [[1]]
f = [-2]
x0 = [1]
"""

# The wall y' = 1 pushes x towards the wall at 1.05; from step 11, t = 1.1 s, nothing fits between them.

DATASETS = set(
    "t x w mu level events solver/iterations solver/seconds solver/residual solver/active".split()
)
ATTRIBUTES = set(
    "format_version title scene options sweepvi_version git_hash petsc_version mumps_version hdf5_version mpi_version"
    " ranks host scheme step started finished status".split()
)


def read_file(path):
    """Every dataset as an array, and the root attributes."""
    arrays = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: arrays.update({name: item[()]} if isinstance(item, h5py.Dataset) else {}))
        return arrays, dict(file.attrs)


class InFolder(unittest.TestCase):
    """A working directory of its own for each test, with the scene in it."""

    def setUp(self):
        folder = program.temporary_folder()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def write(self, text, name="scene.toml"):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return name

    def sweepvi(self, *words, code=0, **how):
        how.setdefault("env", {})
        how["env"].setdefault("HOME", str(self.folder))  # no rc file but ours
        outcome = program.run(*words, cwd=self.folder, **how)
        self.assertEqual(outcome.code, code, outcome)
        self.assertNotIn("PETSC ERROR", outcome.err, outcome)
        return outcome

    def simulate(self, text, *words, name="run", code=0, **how):
        """Runs the scene; gives what the file, its root attributes and the summary say."""
        scene = self.write(text)
        files = ["-o", f"{name}.h5", "--summary", f"{name}.json", "--force"]
        self.sweepvi("run", scene, *files, *words, code=code, **how)
        arrays, attributes = read_file(self.folder / f"{name}.h5")
        return arrays, attributes, program.read_json(self.folder / f"{name}.json")

    def files(self):
        return sorted(program.content(self.folder))
