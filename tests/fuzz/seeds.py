#!/usr/bin/env python3
"""Where fuzzing starts: valid and broken inputs of every reader, as FOLDER/READER/NAME.

usage: seeds.py FOLDER
"""

import gzip
import io
import shutil
import sys
from pathlib import Path

import h5py
import numpy as np
import scipy.sparse as sp

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
    "fortran": "\ufeff%%MatrixMarket matrix array double general\n3 1\n1.5D+00\n.5d-3 % c\n1.5-103\n",
    "upper": "%%MatrixMarket matrix coordinate real symmetric\n3 3 4\n1 1 2\n1 2 -1\n3 2 2\n3 3 1\n",
    "both_triangles": "%%MatrixMarket matrix coordinate real symmetric\n2 2 2\n1 2 -1\n2 1 -1\n",
    "skew_zeros": "%%MatrixMarket matrix coordinate unsigned-integer skew-symmetric\n2 2 3\n1 1 0\n1 2 7\n2 2 0\n",
    "array_skew": "%%MatrixMarket matrix array real skew-symmetric\n2 2\n0\n1\n0\n",
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
    "columns_h5sparse": lambda f: group(f, "g", h5sparse_format="csc", h5sparse_shape=(3, 3)),
    "format_text": lambda f: (group(f, "g"), f.__setitem__("g/format", "csc")),
    "coordinates": lambda f: parts(f.create_group("g"), dict(row=[0, 2, 0], col=[0, 1, 0], data=[1.0, 2.0, 3.0]),
                                   dict(shape=(3, 3), format="coo")),
    "matlab": lambda f: f.create_dataset("A", data=DENSE).attrs.__setitem__("MATLAB_class", np.bytes_("double")),
    "matlab_sparse": lambda f: parts(f.create_group("g"), dict(jc=[0, 1, 3], ir=[0, 0, 2], data=[1.0, 2.0, 3.0]),
                                     dict(MATLAB_sparse=3)),
    "julia_sparse": lambda f: parts(f.create_group("g"), dict(m=3, n=2, colptr=[1, 2, 4], rowval=[1, 1, 3],
                                                              nzval=[1.0, 2.0, 3.0]), {}),
    "octave": lambda f: parts(f.create_group("A"), dict(type=np.bytes_("matrix"), value=DENSE), dict(OCTAVE_NEW_FORMAT=1)),
    "octave_sparse": lambda f: parts(f.create_group("A"), {
        "type": np.bytes_("sparse matrix"), "value/nr": 3, "value/nc": 2, "value/cidx": [[0], [1], [3]],
        "value/ridx": [[0], [0], [2]], "value/data": [[1.0], [2.0], [3.0]]}, dict(OCTAVE_NEW_FORMAT=1)),
    "truth": lambda f: f.create_dataset("A", data=DENSE > 0),
    "columns_fixed": lambda f: group(f, "g", **{"encoding-type": np.bytes_("csc_matrix")}),
    "format_in_words": lambda f: group(f, "g", h5sparse_format=["csc"] * 100),
    "link": lambda f: (f.create_dataset("B", data=DENSE), f.__setitem__("A", h5py.SoftLink("/B"))),
    "loop": lambda f: f.__setitem__("A", h5py.SoftLink("/A")),
    "other_file": lambda f: f.__setitem__("A", h5py.ExternalLink("m.h5", "A")),
    "type": lambda f: f.__setitem__("A", np.dtype("f8")),
    "compact": lambda f: compact(f),
}


def parts(group, datasets, attributes):
    for name, value in datasets.items():
        group[name] = value
    group.attrs.update(attributes)


def compact(file):
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_layout(h5py.h5d.COMPACT)
    space = h5py.h5s.create_simple((3, 3))
    h5py.h5d.create(file.id, b"A", h5py.h5t.IEEE_F64LE, space, properties).write(h5py.h5s.ALL, h5py.h5s.ALL, DENSE)


# What `sweepvi run` writes of a ball that falls on a wall, or parts of it; and what looks like it.
T = np.array([0.0, 0.5, 1.0, 1.5])
X = np.array([[1.0, 0.0], [0.75, -0.5], [0.25, -1.0], [0.0, 0.0]])
EVENT = np.dtype([("t", "f8"), ("constraint", "i8"), ("level", "i4"),
                  ("kind", h5py.enum_dtype({"impact": 0, "liftoff": 1}, basetype="i4")), ("impulse", "f8")])


def run(file, t=T, x=X, **other):
    """The least that is read; a keyword replaces a dataset, or an attribute where it is one of those."""
    content = {"format_version": 1, "status": "done", "t": t, "x": x, **other}
    for name, value in content.items():
        if name in ("format_version", "status"):
            file.attrs[name] = value
        elif isinstance(value, dict):
            file.create_dataset(name, **value)
        elif value is not None:
            file[name] = value


def whole_run(file):
    grows = dict(chunks=(8, 2), maxshape=(None, 2))
    run(file, t=dict(data=T, chunks=(8,), maxshape=(None,)), x=dict(data=X, **grows),
        element=np.array([3, 5]), mu=np.arange(8.0).reshape(4, 1, 2),
        events=np.array([(1.2, 0, 2, 0, 1.5), (1.3, 0, 1, 1, 0.0)], dtype=EVENT))
    file["x"].attrs["names"] = ["q", "v"]
    file["t"].make_scale("t")
    file["x"].dims[0].attach_scale(file["t"])


def claim(file, shape):
    """A /mu made of other datasets, the only kind that may claim any shape."""
    run(file)
    layout = h5py.VirtualLayout(shape=shape, dtype="f8")
    layout[0, 0, 0:1] = h5py.VirtualSource("m.h5", "v", shape=(1,))
    file.create_virtual_dataset("mu", layout, fillvalue=3.0)


RUN_FORMS = {
    "run": whole_run,
    "run_least": run,
    "run_gzip": lambda f: run(f, x=dict(data=X, chunks=(3, 1), compression="gzip", shuffle=True, fletcher32=True)),
    "run_float32": lambda f: run(f, t=T.astype(">f4"), x=X.astype("i2")),
    "run_one_row": lambda f: run(f, t=T[:1], x=X[:1], mu=np.zeros((1, 3, 4)), events=np.zeros(0, EVENT)),
    "run_no_rows": lambda f: run(f, t=T[:0], x=X[:0]),
    "run_backwards": lambda f: run(f, t=T[::-1]),
    "run_nan": lambda f: run(f, x=np.where(X == 0.75, np.nan, X), mu=np.full((4, 1, 1), np.inf)),
    "run_running": lambda f: run(f, status="running"),
    "run_status_fixed": lambda f: run(f, status=np.bytes_("stopped")),
    "run_status_list": lambda f: run(f, status=["done"] * 100),
    "run_version_list": lambda f: run(f, format_version=np.ones(100, dtype="i8")),
    "run_version_text": lambda f: run(f, format_version="1"),
    "run_version_2": lambda f: run(f, format_version=2),
    "run_no_version": lambda f: f.create_dataset("x", data=X),
    "run_short_x": lambda f: run(f, x=X[:2]),
    "run_no_columns": lambda f: run(f, x=X[:, :0]),
    "run_no_x": lambda f: run(f, x=None),
    "run_group_x": lambda f: run(f, **{"x": None, "x/y": X}),
    "run_events_numbers": lambda f: run(f, events=T),
    "run_events_float_kind": lambda f: run(f, events=np.zeros(2, [("t", "f4"), ("constraint", "i2"), ("level", "u1"),
                                                                  ("kind", "f4"), ("impulse", "i8")])),
    "run_mu_never_written": lambda f: run(f, mu=dict(shape=(4, 2, 3), dtype="f8", chunks=(1, 1, 1), fillvalue=2.0)),
    "run_elsewhere": lambda f: run(f, x=dict(shape=(4, 2), dtype="f8", external=[("m.h5", 0, 64)])),
    "run_no_width_in_64_bits": lambda f: claim(f, (4, 2**62, 4)),
    "run_width_beyond_64_bits": lambda f: claim(f, (4, 2**62 + 1, 4)),
    "run_endless_mu": lambda f: claim(f, (2**62, 1, 1)),
}

TABLE_FORMS = {
    "table": "t,q,v\n0,1,0\n0.5,0.75,-0.5\n0.5,0.75,+5e-1\n",
    "table_spaces": " t ,\tq\r\n\r\n0 , 1\r\n1e-3 ,2.5E+2 \r\n",
    "table_no_end": "t,q\n0,-1",
    "table_empty_name": "t,\n0,1\n",
    "table_no_rows": "t,q\n",
    "table_no_columns": "t\n0\n",
    "table_no_head": "0,1\n1,2\n",
    "table_nan": "t,q\n0,nan\n1,inf\n",
    "table_overflow": "t,q\n0,1e999\n",
    "table_underflow": "t,q\n0,1e-999\n",
    "table_backwards": "t,q\n1,0\n0,0\n",
    "table_short_line": "t,q,v\n0,1\n",
    "table_long_line": "t,q\n0,1,2\n",
    "table_no_number": "t,q\n0,0x1p3\n",
    "table_quotes": 't,"q, [m]"\n0,1\n',
    "table_nul": "t,q\n0,1\0\n",
    "table_marked": "\ufefft,q\n0,1\n",
}


def saved(save, *arguments, **named):
    file = io.BytesIO()
    save(file, *arguments, **named)
    return file.getvalue()


def head(version):
    return saved(lambda file: np.lib.format.write_array(file, DENSE, version=version))


def petsc(integers, *objects):
    """Lists of whole numbers are integers of the given type, arrays of reals scalars."""
    return b"".join(np.array(o, integers if isinstance(o, list) else ">f8").tobytes() for o in objects)


SPARSE = sp.csr_matrix(DENSE)
AIJ = ([1211216, 3, 3, 7], np.diff(SPARSE.indptr).tolist(), SPARSE.indices.tolist(), SPARSE.data)

# Files whose first bytes tell what they are.
DATA_FORMS = {
    "npy": saved(np.save, DENSE),
    "npy_fortran": saved(np.save, np.asfortranarray(DENSE, ">f4")),
    "npy_half": saved(np.save, DENSE.astype("f2")),
    "npy_truth": saved(np.save, DENSE > 0),
    "npy_integers": saved(np.save, np.arange(4, dtype=">i2")),
    "npy_2": head((2, 0)),
    "npy_complex": saved(np.save, DENSE + 1j),
    "npy_objects": saved(np.save, np.array([[None]])),
    "npz": saved(np.savez, DENSE),
    "npz_packed": saved(np.savez_compressed, A=DENSE, v=np.arange(3.0)),
    **{f"npz_{kind}": saved(sp.save_npz, SPARSE.asformat(kind)) for kind in ("csr", "csc", "coo", "bsr", "dia")},
    **{f"npz_{kind}_plain": saved(sp.save_npz, SPARSE.asformat(kind), compressed=False)
       for kind in ("csr", "csc", "coo", "bsr", "dia")},
    "petsc": petsc(">i4", *AIJ),
    "petsc_64": petsc(">i8", *AIJ),
    "petsc_dense": petsc(">i4", [1211216, 3, 3, -1], DENSE),
    "petsc_vector": petsc(">i4", [1211214, 3], np.arange(3.0)),
    "petsc_several": petsc(">i4", [1211218, 2, 5, 6], *AIJ, [1211214, 3], np.arange(3.0)),
    "petsc_complex": petsc(">i4", [1211214, 3], np.arange(6.0)),
    "market_gz": gzip.compress(MARKET_FORMS["general"].encode()),
    "npy_gz": gzip.compress(saved(np.save, DENSE)),
    "petsc_gz": gzip.compress(petsc(">i4", *AIJ)),
    "matlab_5": b"MATLAB 5.0 MAT-file, Platform: GLNXA64",
}


def texts(folder, forms):
    for name, text in forms.items():
        (folder / name).write_text(text)


def main():
    folders = {name: Path(sys.argv[1]) / name for name in ("scene", "problem", "matrix_market", "data", "hdf5", "recorded")}
    for folder in folders.values():
        folder.mkdir(parents=True, exist_ok=True)
    texts(folders["scene"], SCENE_FORMS)
    texts(folders["problem"], PROBLEM_FORMS)
    texts(folders["matrix_market"], MARKET_FORMS)
    for name, content in DATA_FORMS.items():
        (folders["data"] / name).write_bytes(content)
    for path in [*EXAMPLES.rglob("*.toml"), *(TESTS / "scenes/broken").glob("*.toml")]:
        reader = "problem" if "[problem]" in path.read_text(errors="replace") else "scene"
        shutil.copy(path, folders[reader] / f"{path.parent.name}_{path.stem}")
    for path in [*EXAMPLES.rglob("*.mtx"), *(TESTS / "scenes").rglob("*.mtx")]:
        if path.stat().st_size < 2000:
            shutil.copy(path, folders["matrix_market"] / f"{path.parent.name}_{path.stem}")
    texts(folders["recorded"], TABLE_FORMS)
    for reader, forms in (("hdf5", HDF5_FORMS), ("recorded", RUN_FORMS)):
        for name, fill in forms.items():
            for version in ("earliest", "latest"):
                with h5py.File(folders[reader] / f"{name}_{version}", "w", libver=(version, "latest")) as file:
                    fill(file)


if __name__ == "__main__":
    main()
