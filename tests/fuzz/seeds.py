#!/usr/bin/env python3
"""Where fuzzing starts: valid and broken inputs of every reader, as FOLDER/READER/NAME.

usage: seeds.py FOLDER
"""

import shutil
import sys
from pathlib import Path

import h5py
import numpy as np

TESTS = Path(__file__).resolve().parents[1]
EXAMPLES = TESTS.parent / "examples"
DENSE = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])

# Every form that a matrix, a vector and a signal have, beside the files that readers.hpp puts there.
SCENE_FORMS = {
    "files": """[time]
end = 1
step = 0.1
scheme = "moreau-jean"
[model]
kind = "lagrangian"
M = "m.mtx"
K = {file = "m.h5", dataset = "/A"}
H = [[1, 0, 0]]
q0 = "v.mtx"
v0 = [0.0, 1e-3, -inf]
f = [{offset = 1, amplitude = 2, frequency = 3, phase = 4}, 0, 1]
""",
    "chain_weights": """[time]
end = 1
step = 0.1
[model]
kind = "chain"
element = "jerk"
count = 3
coupling = "m.mtx"
a1 = "v.mtx"
force = [0, {amplitude = 1, frequency = 2}, 3]
[output]
every = 2
blocks = [0, 2]
checkpoint = 0
[petsc]
options = "-snes_max_it 7"
""",
    "overrides": """#set time.step=1e-2
#set model.kind=chain
#set output={file = "a.h5"}
#set title=no quotes
[time]
end = 1
step = 0.1
[model]
element = "wall"
count = 12
topology = "lattice"
shape = [3, 4]
""",
    "toml": '''title = """two
lines \\u00e9"""
[time]
start = 1979-05-27T07:32:00Z
end = 0x10
step = 1_000.5e-3
[model]
"kind" = 'chain'
a.b.c = {d = [1, [2, {e = true}]]}
[[petsc]]
options = 'C:\\new'
''',
}

PROBLEM_FORMS = {
    "rows": """[problem]
M = [[2.0, 1.0], [1.0, 2.0]]
q = [-5.0, 6.0]
lower = [0.0, -inf]
upper = inf
u0 = [0, 0]
""",
    "files": """[problem]
M = "m.mtx"
q = "v.mtx"
lower = -1
upper = {file = "m.h5", dataset = "v"}
""",
}

MARKET_FORMS = {
    "general": "%%MatrixMarket matrix coordinate real general\n% text\n\n2 3 3\n1 1 1.5\n2 3 -2e-3\n2 3 +1\n",
    "symmetric": "%%MatrixMarket matrix coordinate real symmetric\n3 3 3\n1 1 2\n2 1 -1\n3 3 2\n",
    "skew": "%%MatrixMarket matrix coordinate real skew-symmetric\n2 2 1\n2 1 1e308\n",
    "pattern": "%%MatrixMarket matrix coordinate pattern general\n2 2 2\n1 2\n2 1\n",
    "integer": "%%MatrixMarket MATRIX coordinate integer general\r\n2 1 1\r\n2 1 7\r\n",
    "array": "%%MatrixMarket matrix array real general\n2 2\n1 2\n3\n1e-400\n",
    "array_symmetric": "%%MatrixMarket matrix array real symmetric\n2 2\n1\n2\n3\n",
    "wide": "%%MatrixMarket matrix coordinate real general\n1 2147483647 1\n1 2147483647 1\n",
}


def group(file, name, **attributes):
    made = file if name == "/" else file.create_group(name)
    made["data"] = np.array([1.0, 2.0, 3.0])
    made["indices"] = np.array([0, 2, 0])
    made["indptr"] = np.array([0, 2, 2, 3])
    made.attrs["shape"] = np.array([3, 3])
    for key, value in attributes.items():
        made.attrs[key] = value


HDF5_FORMS = {
    "dense": lambda f: f.create_dataset("A", data=DENSE),
    "float32_big_endian": lambda f: f.create_dataset("A", data=DENSE.astype(">f4")),
    "integer": lambda f: f.create_dataset("A", data=DENSE.astype("i2")),
    "gzip": lambda f: f.create_dataset("A", data=DENSE, chunks=(2, 2), compression="gzip", shuffle=True,
                                       fletcher32=True, maxshape=(None, 3)),
    "never_written": lambda f: f.create_dataset("A", shape=(3, 3), dtype="f8", chunks=(2, 2), fillvalue=7.0),
    "vector": lambda f: f.create_dataset("A", data=np.arange(4.0)),
    "scalar": lambda f: f.create_dataset("A", data=1.0),
    "text": lambda f: f.create_dataset("A", data="words"),
    "complex": lambda f: f.create_dataset("A", data=DENSE + 1j),
    "sparse": lambda f: group(f, "g"),
    "sparse_root": lambda f: group(f, "/"),
    "columns": lambda f: group(f, "g", h5sparse_format="csc"),
    "columns_fixed": lambda f: group(f, "g", **{"encoding-type": np.bytes_("csc_matrix")}),
    "link": lambda f: (f.create_dataset("B", data=DENSE), f.__setitem__("A", h5py.SoftLink("/B"))),
    "loop": lambda f: f.__setitem__("A", h5py.SoftLink("/A")),
    "other_file": lambda f: f.__setitem__("A", h5py.ExternalLink("m.h5", "A")),
    "type": lambda f: f.__setitem__("A", np.dtype("f8")),
    "compact": lambda f: compact(f),
}


def compact(file):
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_layout(h5py.h5d.COMPACT)
    space = h5py.h5s.create_simple((3, 3))
    h5py.h5d.create(file.id, b"A", h5py.h5t.IEEE_F64LE, space, properties).write(h5py.h5s.ALL, h5py.h5s.ALL, DENSE)


def texts(folder, forms):
    for name, text in forms.items():
        (folder / name).write_text(text)


def main():
    folders = {name: Path(sys.argv[1]) / name for name in ("scene", "problem", "matrix_market", "hdf5")}
    for folder in folders.values():
        folder.mkdir(parents=True, exist_ok=True)
    texts(folders["scene"], SCENE_FORMS)
    texts(folders["problem"], PROBLEM_FORMS)
    texts(folders["matrix_market"], MARKET_FORMS)
    for path in [*EXAMPLES.rglob("*.toml"), *(TESTS / "scenes/broken").glob("*.toml")]:
        reader = "problem" if "[problem]" in path.read_text(errors="replace") else "scene"
        shutil.copy(path, folders[reader] / f"{path.parent.name}_{path.stem}")
    for path in [*EXAMPLES.rglob("*.mtx"), *(TESTS / "scenes").rglob("*.mtx")]:
        if path.stat().st_size < 2000:
            shutil.copy(path, folders["matrix_market"] / f"{path.parent.name}_{path.stem}")
    for name, fill in HDF5_FORMS.items():
        for version in ("earliest", "latest"):
            with h5py.File(folders["hdf5"] / f"{name}_{version}", "w", libver=(version, "latest")) as file:
                fill(file)


if __name__ == "__main__":
    main()
