# ranks: 1
"""Files as scipy, numpy, h5py, petsc4py, PetscBinaryIO, MATLAB, Octave, Julia and Fortran write them: what is read is, bit
for bit, what was written, or the file is refused. Matrices are not symmetric, so that a transposed one is another."""

import gzip
import io
import os
import subprocess
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np
import scipy.io
import scipy.sparse as sp

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

READER = Path(os.environ["SWEEPVI_BUILD"]) / "tests" / "matrix_program"


def random_matrix(seed, shape=(5, 4), density=0.6):
    """Dyadic numbers of few digits, so that a decimal text of 17 digits and float16 hold them exactly; every row has one."""
    rng = np.random.default_rng(seed)
    matrix = rng.integers(-64, 64, shape) / 8.0 * (rng.random(shape) < density)
    matrix[:, 0] += (np.abs(matrix).sum(axis=1) == 0) * 1.5
    return matrix


GENERAL = random_matrix(1)
SQUARE = random_matrix(2, (6, 6))
LOWER = np.tril(SQUARE)
SYMMETRIC = LOWER + np.tril(SQUARE, -1).T
SKEW = np.tril(SQUARE, -1) - np.tril(SQUARE, -1).T
WHOLE = np.rint(GENERAL)
VECTOR = np.array([1.5, 0.0, -2.25, 1e-300, 7.0])


class Files(unittest.TestCase):
    """Collects files with what they should be read as, and asks the reader for all of them at once."""

    def setUp(self):
        self.temporary = program.temporary_folder()
        self.folder = Path(self.temporary.name)
        self.questions, self.answers = [], []
        self.addCleanup(self.temporary.cleanup)

    def path(self, name):
        return self.folder / f"{len(self.questions)}_{name}"

    def expect(self, path, expected, dataset="", what=None):
        """`expected`: an array, or words of the refusal."""
        if what is None:
            what = "vector" if not isinstance(expected, str) and np.ndim(expected) == 1 else "matrix"
        self.questions.append(f"{what} {path} {dataset}".strip())
        self.answers.append(expected)

    def expect_bytes(self, content, expected, name="m", dataset="", what=None):
        path = self.path(name)
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        self.expect(path, expected, dataset, what)

    def tearDown(self):
        outcome = subprocess.run([READER], input="\n".join(self.questions) + "\n", capture_output=True, timeout=60,
                                 text=True)
        self.assertEqual(outcome.returncode, 0, outcome.stderr)
        lines = outcome.stdout.splitlines()
        self.assertEqual(len(lines), len(self.questions), outcome.stdout[-500:])
        for question, line, expected in zip(self.questions, lines, self.answers):
            with self.subTest(question=question):
                if isinstance(expected, str):
                    self.assertTrue(line.startswith("refused: "), line)
                    self.assertIn(expected, line)
                    self.assertTrue(line.isprintable(), ascii(line))
                    continue
                self.assertFalse(line.startswith("refused"), line)
                words = line.split()
                axes = np.ndim(expected)
                self.assertEqual(tuple(map(int, words[:axes])), np.shape(expected))
                np.testing.assert_array_equal(np.array(words[axes:], float), np.ravel(expected).astype(float))


def market(matrix, **options):
    text = io.BytesIO()
    scipy.io.mmwrite(text, matrix, precision=17, **options)
    return text.getvalue().decode()


class MatrixMarket(Files):
    def test_scipy(self):
        for matrix, options in (
            (sp.coo_matrix(GENERAL), {}),
            (GENERAL, {}),
            (sp.coo_matrix(SYMMETRIC), {"symmetry": "symmetric"}),
            (SYMMETRIC, {"symmetry": "symmetric"}),
            (sp.coo_matrix(SKEW), {"symmetry": "skew-symmetric"}),
            (SKEW, {"symmetry": "skew-symmetric"}),
            (sp.coo_matrix(WHOLE.astype(int)), {"field": "integer"}),
        ):
            text = market(matrix, **options)
            expected = matrix if isinstance(matrix, np.ndarray) else matrix.toarray()
            for form in (text, "\ufeff" + text, text.replace("\n", "\r\n"), "\n\n" + text, text.rstrip("\n"),
                         text.replace("\n", "\n\n  % a comment\n \n", 3), text + "\n% the end\n"):
                self.expect_bytes(form, expected, "m.mtx")
            self.expect_bytes(gzip.compress(text.encode()), expected, "m.mtx.gz")
            self.expect_bytes(gzip.compress(text[:40].encode()) + gzip.compress(text[40:].encode()), expected, "m")
        pattern = (GENERAL != 0).astype(float)
        self.expect_bytes(market(sp.coo_matrix(GENERAL), field="pattern"), pattern)
        self.expect_bytes(market(VECTOR.reshape(-1, 1)), VECTOR)
        self.expect_bytes(market(sp.coo_matrix(VECTOR)), VECTOR)
        self.expect_bytes(market(GENERAL + 1j), "'complex' is not supported")

    def test_fortran(self):
        head = "%%MatrixMarket matrix array real general\n"
        numbers = ["1.5D+00", "-0.25d1", " .5D0", "2.D0", "0.125-100", "-1.5+102", "1.0D-0300", "+3.0Q+01"]
        expected = [1.5, -2.5, 0.5, 2.0, 0.125e-100, -1.5e102, 1e-300, 30.0]
        self.expect_bytes(head + "8 1\n" + "\n".join(numbers) + "\n", np.array(expected))
        self.expect_bytes(head + "1 1\n1.0D-400\n", np.array([[0.0]]))
        for bad in ("1.0D+400", "******", "1.0D", "D5", "1.0E+2D3", "1-2", "1.0+-100", "1,5", "NaN", "0x10", "1.0D+ 2"):
            self.expect_bytes(head + f"1 1\n{bad}\n", "found '" if bad != "1.0D+ 2" else "refused")

    def test_triangles(self):
        upper = sp.coo_matrix(SYMMETRIC.T)
        keep = upper.row <= upper.col

        def text(symmetry, row, col, values, n=6):
            lines = [f"{i + 1} {j + 1} {v!r}" for i, j, v in zip(row, col, values)]
            return (f"%%MatrixMarket matrix coordinate real {symmetry}\n{n} {n} {len(lines)}\n" + "\n".join(lines) + "\n")

        row, col, values = upper.row[keep], upper.col[keep], upper.data[keep].tolist()
        self.expect_bytes(text("symmetric", row, col, values), SYMMETRIC)
        # One triangle, but each entry on whichever side of the diagonal it happened to be.
        swap = np.arange(len(row)) % 2 == 0
        self.expect_bytes(text("symmetric", np.where(swap, row, col), np.where(swap, col, row), values), SYMMETRIC)
        self.expect_bytes(text("symmetric", upper.row, upper.col, upper.data.tolist()), "given on both sides of the diagonal")
        skew = sp.coo_matrix(np.triu(SKEW))
        self.expect_bytes(text("skew-symmetric", skew.row, skew.col, skew.data.tolist()), SKEW)
        with_zeros = (np.append(skew.row, range(6)), np.append(skew.col, range(6)), skew.data.tolist() + [0, -0.0, 0, 0, 0, 0])
        self.expect_bytes(text("skew-symmetric", *with_zeros), SKEW)
        self.expect_bytes(text("skew-symmetric", [1, 2], [0, 2], [1.0, 1e-300]), "lies on the diagonal")
        values = [SKEW[i, j] for j in range(6) for i in range(j, 6)]  # the zeros of the diagonal among them
        head = "%%MatrixMarket matrix array real skew-symmetric\n6 6\n"
        self.expect_bytes(head + "\n".join(map(repr, values)) + "\n", SKEW)
        values[0] = 1.0
        self.expect_bytes(head + "\n".join(map(repr, values)) + "\n", "lies on the diagonal")
        self.expect_bytes(head + "\n".join(map(repr, values[1:])) + "\n", "below its diagonal")

    def test_bytes_of_files_are_not_printed(self):
        head = b"%%MatrixMarket matrix coordinate real general\n"
        self.expect_bytes(head + b"1 1 1\n1 1 \x1b[31m\x07\n", "found '\\x1b[31m\\x07'")
        self.expect_bytes(head + b"1 1 1\n1 1 \xff\xfe\n", "found '\\xff\\xfe'")
        self.expect_bytes(head + "1 1 1\n1 1 é\u0085\n".encode(), "found 'é\\u{85}'")
        self.expect_bytes("%%MatrixMarket matrix coordinate real general\n".encode("utf-16"), "UTF-16")
        self.expect_bytes(bytes(range(1, 200)), "no MatrixMarket file")
        self.expect_bytes(b"%%MatrixMarket matrix \0array real general\n", "\\x00array")

    def test_packed_and_broken(self):
        text = market(sp.coo_matrix(np.diag(np.arange(1.0, 2000.0)))).encode()
        packed = gzip.compress(text)
        self.expect_bytes(packed[:-200], "cut off or damaged")
        self.expect_bytes(packed[:-8] + bytes(8), "cut off or damaged")
        self.expect_bytes(packed[:2] + packed[:-2], "cut off or damaged")
        head = b"%%MatrixMarket matrix array real general\n1 1\n"
        self.expect_bytes(gzip.compress(head + b"1\n" * 10**7), "more values than the 1")
        # 80 MB of a line from 80 kB: refused before it is all in memory.
        self.expect_bytes(gzip.compress(b"%%MatrixMarket" + bytes(8 * 10**7), 1), ":1: the line has 64 MiB and more")


class NumPy(Files):
    def test_arrays(self):
        for order in "CF":
            for kind in ("<f8", ">f8", "<f4", ">f4", "<f2", ">f2", "<i8", ">i2", "i1", "<i4"):
                array = np.asarray(WHOLE if "i" in kind else GENERAL, dtype=kind, order=order)
                path = self.path("a.npy")
                np.save(path, array)
                self.expect(path, array.astype(float))
        for array in (WHOLE > 0, np.abs(WHOLE).astype("u1"), np.abs(WHOLE).astype(">u8"), WHOLE.T, GENERAL[::2, ::-1]):
            path = self.path("a.npy")
            np.save(path, array)
            self.expect(path, array)
        for vector in (VECTOR, VECTOR.reshape(-1, 1), VECTOR.reshape(1, -1), np.array([np.inf, -np.inf, 0])):
            path = self.path("a.npy")
            np.save(path, vector)
            self.expect(path, vector.ravel())
        for version in ((1, 0), (2, 0), (3, 0)):
            path = self.path("a")
            with path.open("wb") as file:
                np.lib.format.write_array(file, GENERAL, version=version)
            self.expect(path, GENERAL)
            self.expect_bytes(gzip.compress(path.read_bytes()), GENERAL, "a.npy.gz")

    def test_no_arrays_of_numbers(self):
        for array, words in ((GENERAL + 1j, "(complex)"), (np.array(["a", "b"]), "type 'U1'"),
                             (np.array([[None]]), "pickled"), (np.zeros(2, [("a", "f8")]), "structured"),
                             (VECTOR, "with two axes"), (np.zeros((0, 3)), "shape 0 x 3"),
                             (GENERAL.astype(np.longdouble), "at most 8 bytes"),
                             (np.array([[np.nan]]), "finite"), (np.array(["2020-01-01"], "M8[D]"), "type")):
            path = self.path("a.npy")
            np.save(path, array)
            self.expect(path, words)
        whole = io.BytesIO()
        np.save(whole, GENERAL)
        whole = whole.getvalue()
        self.expect_bytes(whole[:-1], "cut off")
        self.expect_bytes(whole + whole, "more than one array")
        self.expect_bytes(whole.replace(b"(5, 4)", b"(5, 5)"), "cut off")
        self.expect_bytes(whole[:30], "ends within the head")
        self.expect_bytes(whole.replace(b"'shape'", b"'sh\x1bpe'"), "makes no sense")
        self.expect_bytes(gzip.compress(whole[:-1]), "cut off")

    def test_archives(self):
        for save in (np.savez, np.savez_compressed):
            path = self.path("a.npz")
            save(path, GENERAL)
            self.expect(path, GENERAL)
            self.expect(path, GENERAL, "arr_0")
            path = self.path("b.npz")
            save(path, M=GENERAL, q=VECTOR, F=np.asfortranarray(GENERAL))
            for name in ("M", "/M", "F"):
                self.expect(path, GENERAL, name)
            self.expect(path, VECTOR, "q")
            self.expect(path, "holds several arrays, F, M, q")
            self.expect(path, "no array 'x' is in the file, which holds F, M, q", "x")
        with gzip.open(self.path("a.npz.gz"), "wb") as file:
            file.write(path.read_bytes())
        self.expect(file.name if hasattr(file, "name") else self.path("a.npz.gz"), "unpack it")

    def test_sparse(self):
        matrix = sp.csr_matrix(SQUARE)
        wide = sp.csr_matrix(random_matrix(5, (4, 9)))
        tall = sp.csr_matrix(random_matrix(6, (9, 4)))
        empty = sp.csr_matrix((3, 4))
        for form in (matrix, wide, tall, empty, matrix.astype(np.float32), matrix.astype(int), matrix > 0):
            for kind in ("csr", "csc", "coo", "bsr", "dia"):
                for compressed in (True, False):
                    path = self.path("s.npz")
                    sp.save_npz(path, form.asformat(kind), compressed=compressed)
                    self.expect(path, form.toarray())
        for shape in ((2, 3), (3, 1), (1, 2), (3, 3), (6, 6)):
            path = self.path("b.npz")
            sp.save_npz(path, sp.bsr_matrix(SQUARE, blocksize=shape))
            self.expect(path, SQUARE)
        # Unordered, given twice, 64-bit, sparse column as a vector, `format` as Python 2 left it.
        twice = sp.coo_matrix(([1.0, 2.0, 4.0], (np.array([1, 0, 1], np.int64), [2, 1, 2])), shape=(3, 3))
        path = self.path("t.npz")
        sp.save_npz(path, twice)
        self.expect(path, twice.toarray())
        path = self.path("v.npz")
        sp.save_npz(path, sp.csc_matrix(VECTOR.reshape(-1, 1)))
        self.expect(path, VECTOR)
        for text in ("csc", b"csc"):
            path = self.path("f.npz")
            csc = matrix.tocsc()
            np.savez(path, format=text, shape=csc.shape, data=csc.data, indices=csc.indices, indptr=csc.indptr,
                     _is_array=True)
            self.expect(path, SQUARE)
        csr = matrix
        parts = dict(format=b"csr", shape=csr.shape, data=csr.data, indices=csr.indices, indptr=csr.indptr)
        for change, words in ((dict(format=b"lil"), "format of the sparse matrix is 'lil'"), (dict(shape=(6, 6, 1)), "two axes"),
                              (dict(indptr=csr.indptr[:-1]), "indptr has length 6; expected rows + 1 = 7"),
                              (dict(indices=csr.indices + 1), "holds column 6"), (dict(indices=csr.indices * 1.0), "whole"),
                              (dict(data=csr.data + 1j), "(complex)"), (dict(shape=(7, 6)), "expected rows + 1 = 8"),
                              (dict(data=csr.data * np.nan), "finite"), (dict(format=np.int64(3)), "short text")):
            path = self.path("x.npz")
            np.savez(path, **{**parts, **change})
            self.expect(path, words)
        del parts["format"]  # by rows or by columns: nobody knows
        path = self.path("y.npz")
        np.savez(path, **parts)
        self.expect(path, "several arrays")

    def test_damaged_archives(self):
        path = self.path("a.npz")
        np.savez(path, SQUARE)
        whole = path.read_bytes()
        at = whole.index(SQUARE.tobytes())
        self.expect_bytes(whole[:at] + b"\1" + whole[at + 1:], "cannot be unpacked")
        self.expect_bytes(whole[: len(whole) // 2], "zip archive")
        self.expect_bytes(whole.replace(b"arr_0.npy", b"arr_0.txt"), "holds no NumPy array")
        path = self.path("bomb.npz")
        np.savez_compressed(path, np.zeros((3000, 3000)))
        self.expect(path, "refused", what="vector")
        np.savez_compressed(self.path("z.npz"), np.zeros((300, 300)))
        self.expect(self.path("z.npz"), np.zeros((300, 300)))


class Petsc(Files):
    def test_petsc4py(self):
        script = """
import sys
import petsc4py
petsc4py.init(["x"])
from petsc4py import PETSc
import numpy as np
folder = sys.argv[1]
comm = PETSc.COMM_SELF
G, S, v = (np.load(f"{folder}/{name}.npy") for name in "GSv")
def matrix(kind, values, block=1):
    A = PETSc.Mat().create(comm=comm)
    A.setSizes(values.shape, bsize=block)
    A.setType(kind)
    A.setUp()
    for i, j in zip(*np.nonzero(values)):
        A[i, j] = values[i, j]
    A.assemble()
    return A
def view(name, *objects, native=False):
    viewer = PETSc.Viewer().createBinary(f"{folder}/{name}", "w", comm=comm)
    if native:
        viewer.pushFormat(PETSc.Viewer.Format.NATIVE)
    for entity in objects:
        entity.view(viewer)
    viewer.destroy()
vector = PETSc.Vec().createWithArray(v, comm=comm)
view("aij", matrix("aij", G))
view("dense", matrix("dense", G))
view("native", matrix("dense", G), native=True)
view("baij", matrix("baij", S, 2))
view("vec", vector)
view("both", matrix("aij", G), vector)
view("twice", vector, vector)
view("set", PETSc.IS().createGeneral([3, 1, 2], comm=comm), matrix("aij", G))
view("column", matrix("aij", v.reshape(-1, 1)))
h5 = PETSc.Viewer().createHDF5(f"{folder}/vec.h5", "w", comm=comm)
vector.setName("x")
vector.view(h5)
h5.destroy()
"""
        for name, array in (("G", GENERAL), ("S", SQUARE), ("v", VECTOR)):
            np.save(self.folder / f"{name}.npy", array)
        subprocess.run([sys.executable, "-c", script, self.folder], check=True, timeout=60, env={**os.environ, **program.ENVIRONMENT})
        for name in ("aij", "dense", "native", "both", "set"):
            self.expect(self.folder / name, GENERAL)
        self.expect(self.folder / "baij", SQUARE)
        for name in ("vec", "both", "column"):
            self.expect(self.folder / name, VECTOR)
        self.expect(self.folder / "vec.h5", VECTOR, "x")
        self.expect(self.folder / "twice", "more than one vector", what="vector")
        self.expect(self.folder / "vec", "a matrix is expected here")
        self.expect(self.folder / "aij", "a vector is expected here", what="vector")
        self.expect(self.folder / "aij", "leave dataset out", "/A")
        whole = (self.folder / "aij").read_bytes()
        self.expect_bytes(gzip.compress(whole), GENERAL)
        self.expect_bytes(gzip.compress((self.folder / "both").read_bytes()), VECTOR)
        self.expect_bytes(whole[:-1], "cut off")
        self.expect_bytes(whole + b"\0", "cut off")
        lengths = np.frombuffer(whole, ">i4", 5, 16).copy()
        lengths[0] += 1
        self.expect_bytes(whole[:16] + lengths.tobytes() + whole[36:], "sum of the lengths")
        columns = np.frombuffer(whole, ">i4", 1, 36).copy() + 100
        self.expect_bytes(whole[:36] + columns.tobytes() + whole[40:], "list of columns holds column")
        huge = np.array([1211216, 2**31 - 1, 2**31 - 1, 2**31 - 1], ">i4").tobytes()
        self.expect_bytes(huge, "cut off")

    def test_petsc_binary_io(self):
        folder = [path for path in Path("/usr/share/petsc").glob("*/lib/petsc/bin") if (path / "PetscBinaryIO.py").exists()]
        if not folder:
            self.skipTest("no PetscBinaryIO.py")
        sys.path.insert(0, str(folder[-1]))
        import PetscBinaryIO

        csr = sp.csr_matrix(GENERAL)
        for indices in ("32bit", "64bit"):
            for precision in ("double", "single"):
                tool = PetscBinaryIO.PetscBinaryIO(precision=precision, indices=indices, complexscalars=False)
                vector = VECTOR if precision == "double" else VECTOR.astype(np.float32)
                path = self.path("both")
                tool.writeBinaryFile(str(path), [PetscBinaryIO.MatSparse(((5, 4), (csr.indptr, csr.indices, csr.data))), vector.view(PetscBinaryIO.Vec)])
                self.expect(path, GENERAL)
                self.expect(path, vector)
            tool = PetscBinaryIO.PetscBinaryIO(precision="double", indices=indices, complexscalars=True)
            path = self.path("complex")
            tool.writeBinaryFile(str(path), [(VECTOR + 1j).view(PetscBinaryIO.Vec)])
            self.expect(path, "complex scalars", what="vector")


class Hdf5(Files):
    def put(self, name, fill, expected, dataset="A", what=None, userblock=b"", **options):
        path = self.path(name + ".h5")
        with h5py.File(path, "w", userblock_size=512 if userblock else None, **options) as file:
            fill(file)
        if userblock:
            with path.open("r+b") as file:
                file.write(userblock)
        self.expect(path, expected, dataset, what)

    def test_dense(self):
        for data in (GENERAL, GENERAL.astype("f4"), GENERAL.astype(">f8"), GENERAL.astype("f2"), WHOLE.astype("i1"),
                     np.abs(WHOLE).astype(">u4"), WHOLE > 0, GENERAL.T):
            self.put("dense", lambda f: f.create_dataset("A", data=data), data)
            self.put("chunked", lambda f: f.create_dataset("A", data=data, chunks=(2, 3), compression="gzip", shuffle=True,
                                                           maxshape=(None, None)), data)
            self.put("latest", lambda f: f.create_dataset("A", data=data), data, libver="latest")

        def bits(file):  # as PyTables and HDF5.jl keep truth values
            space = h5py.h5s.create_simple(WHOLE.shape)
            h5py.h5d.create(file.id, b"A", h5py.h5t.STD_B8LE, space).write(
                h5py.h5s.ALL, h5py.h5s.ALL, (WHOLE > 0).astype("u1"), mtype=h5py.h5t.NATIVE_B8)

        self.put("bits", bits, WHOLE > 0)
        names = h5py.enum_dtype({"RED": 0, "GREEN": 5}, basetype="i1")
        self.put("enum", lambda f: f.create_dataset("A", data=np.zeros((2, 2), "i1"), dtype=names), "real numbers")
        self.put("truth", lambda f: f.create_dataset("A", data=VECTOR > 0), VECTOR > 0)
        self.put("complex", lambda f: f.create_dataset("A", data=GENERAL + 1j), "complex")
        self.put("petsc_complex", lambda f: f.create_dataset("A", data=np.ones((1, 2))).attrs.update(complex=1), "marked as complex",
                 what="vector")
        self.put("netcdf", lambda f: f.create_dataset("A", data=WHOLE).attrs.update(scale_factor=0.5), "packed as in netCDF")
        self.put("no_name", lambda f: f.create_dataset("A", data=GENERAL), "it holds /A", dataset="")

    def test_matlab(self):
        """-v7.3: axes exchanged, sparse matrices by columns; ir and data are left out where there is nothing."""

        def dense(data, kind, **attributes):
            def fill(file):
                made = file.create_dataset("A", data=np.ascontiguousarray(data.T))
                made.attrs["MATLAB_class"] = np.bytes_(kind)
                made.attrs.update(attributes)

            return fill

        block = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Tue Dec  1 03:00:00 2026 HDF5 schema 1.00 ."
        for data, kind in ((GENERAL, "double"), (GENERAL.astype("f4"), "single"), (WHOLE.astype("i4"), "int32"),
                           ((WHOLE > 0).astype("u1"), "logical")):
            self.put("matlab", dense(data, kind), data, userblock=block)
            self.put("matlab", dense(data, kind), data)
        self.put("vector", dense(VECTOR.reshape(-1, 1), "double"), VECTOR)
        self.put("vector", dense(VECTOR.reshape(1, -1), "double"), VECTOR.reshape(1, -1))
        self.put("block", lambda f: f.create_dataset("A", data=GENERAL.T), GENERAL, userblock=block)
        self.put("char", dense(np.ones((2, 2), "u2"), "char"), "class 'char'")
        self.put("char", dense(np.ones((1, 2), "u2"), "char"), "class 'char'", what="vector")
        self.put("empty", dense(np.zeros((1, 2), "u8"), "double", MATLAB_empty=np.uint8(1)), "empty", what="vector")
        self.put("noise", dense(np.ones((2, 2)), "dou\x1bble"), "\\x1b")

        def sparse(matrix, kind="double", mark=True):
            def fill(file):
                csc = sp.csc_matrix(matrix)
                group = file.create_group("A")
                group.attrs["MATLAB_class"] = np.bytes_(kind)
                if mark:
                    group.attrs["MATLAB_sparse"] = np.uint64(matrix.shape[0])
                group["jc"] = csc.indptr.astype("u8")
                if csc.nnz:
                    group["ir"], group["data"] = csc.indices.astype("u8"), csc.data

            return fill

        for matrix in (GENERAL, SQUARE, random_matrix(3, (2, 7)), np.zeros((3, 4))):
            self.put("sparse", sparse(matrix), matrix)
        self.put("sparse", sparse((WHOLE > 0).astype("u1"), "logical"), WHOLE > 0)
        self.put("sparse", sparse(VECTOR.reshape(-1, 1)), VECTOR)
        self.put("unmarked", sparse(SQUARE, mark=False), "no attribute MATLAB_sparse")
        path = self.path("old.mat")
        scipy.io.savemat(path, {"A": GENERAL})
        self.expect(path, "-v7.3")

    def test_julia(self):
        """JLD and JLD2 begin with a mark, and exchange axes; HDF5.jl's fields of a SparseMatrixCSC."""
        for mark in (b"HDF5-based Julia Data Format, version 0.1.1\0 (Julia 1.9.0 64-bit LE)\0",
                     b"Julia data file (HDF5), version 0.1.1\0"):
            self.put("jld", lambda f: f.create_dataset("A", data=GENERAL.T), GENERAL, userblock=mark)
        csc = sp.csc_matrix(SQUARE)

        def sparse(group, base=1, attributes=False, skip=""):
            values = dict(m=csc.shape[0], n=csc.shape[1], colptr=csc.indptr + base, rowval=csc.indices + base, nzval=csc.data)
            for name, value in values.items():
                if name == skip:
                    continue
                if attributes and name in "mn":
                    group.attrs[name] = value
                else:
                    group[name] = value

        self.put("csc", lambda f: sparse(f.create_group("A")), SQUARE)
        self.put("csc", lambda f: sparse(f.create_group("A"), attributes=True), SQUARE)
        self.put("csc", lambda f: sparse(f), SQUARE, "/")
        self.put("csc0", lambda f: sparse(f.create_group("A"), base=0), "goes from 0 to")
        self.put("no_m", lambda f: sparse(f.create_group("A"), skip="m"), "without m")

    def test_octave(self):
        """save -hdf5: axes exchanged, a group for each variable (checked against Octave 7.3)."""

        def variable(file, name, kind, value):
            group = file.create_group(name)
            group.attrs["OCTAVE_NEW_FORMAT"] = np.uint8(1)
            group["type"] = np.bytes_(kind + "\0")
            if value is not None:
                group["value"] = value
            return group

        for data, kind in ((GENERAL, "matrix"), (GENERAL.astype("f4"), "float matrix"), (WHOLE.astype("i2"), "int16 matrix"),
                           ((WHOLE > 0).astype("u1"), "bool matrix")):
            self.put("octave", lambda f: variable(f, "A", kind, data.T), data)
            self.put("octave", lambda f: variable(f, "A", kind, data.T), data, "A/value")
        self.put("octave", lambda f: variable(f, "A", "matrix", VECTOR.reshape(1, -1)), VECTOR)
        self.put("octave", lambda f: variable(f, "A", "complex matrix", GENERAL + 1j), "'complex matrix'")
        self.put("octave", lambda f: variable(f, "A", "range", np.arange(3.0)), "'range'", what="vector")

        def empty(file):
            variable(file, "A", "matrix", np.array([0, 3])).attrs["OCTAVE_EMPTY_MATRIX"] = np.uint8(1)

        self.put("octave", empty, "empty", what="vector")
        self.put("octave", empty, "empty", "A/value", what="vector")

        def sparse(file):
            csc = sp.csc_matrix(GENERAL)
            value = variable(file, "A", "sparse matrix", None).create_group("value")
            parts = dict(nr=5, nc=4, nz=csc.nnz, cidx=csc.indptr.reshape(-1, 1), ridx=csc.indices.reshape(-1, 1),
                         data=csc.data.reshape(-1, 1))
            for name, part in parts.items():
                value[name] = part

        self.put("octave", sparse, GENERAL)

    def test_marked_groups(self):
        def group(kind, shape="shape", mark=None, matrix=SQUARE, **attributes):
            def fill(file):
                made = file.create_group("A")
                stored = sp.csr_matrix(matrix).asformat(kind)
                for part in ("row", "col", "data") if kind == "coo" else ("indices", "indptr", "data"):
                    made[part] = getattr(stored, part)
                if shape == "dataset":
                    made["shape"] = matrix.shape
                else:
                    made.attrs[shape] = matrix.shape
                if mark == "dataset":
                    made["format"] = kind
                elif mark:
                    made.attrs[mark] = kind
                made.attrs.update(attributes)

            return fill

        for matrix in (SQUARE, GENERAL):
            self.put("plain", group("csr", matrix=matrix), matrix)
            for kind in ("csr", "csc", "coo"):
                self.put("format", group(kind, mark="format", matrix=matrix), matrix)
                self.put("format", group(kind, mark="dataset", matrix=matrix), matrix)
                self.put("format", group(kind, mark="dataset", shape="dataset", matrix=matrix), matrix)
                self.put("h5sparse", group(kind, "h5sparse_shape", mark="h5sparse_format", matrix=matrix), matrix)
                self.put("anndata", group(kind, matrix=matrix, **{"encoding-type": kind + "_matrix", "encoding-version": "0.1.0"}),
                         matrix)
                self.put("bytes", group(kind, matrix=matrix, format=np.bytes_(kind)), matrix)
                self.put("class", group(kind, matrix=matrix, **{"class": f"scipy.sparse.{kind}_matrix"}), matrix)
                self.put("capitals", group(kind, matrix=matrix, format=kind.upper() + "_array"), matrix)
        self.put("truth", group("csc", mark="format", matrix=SQUARE > 0), SQUARE > 0)
        self.put("both", group("csc", format="csc", h5sparse_format="csr"), "in two ways")
        self.put("unknown", group("csc", format="compressed columns"), "expected csr, csc or coo")
        self.put("list", group("csc", format=["csc"] * 2), "expected csr, csc or coo")
        self.put("noise", group("csc", format="c\x1bsc"), "\\x1b")
        self.put("10x", group("csc", shape="dataset"), "an attribute format")
        self.put("unmarked", group("csc", matrix=GENERAL), "unless the matrix is stored by columns")
        self.put("shapes", group("csr", h5sparse_shape=(6, 7)), "differ")


class Solved(unittest.TestCase):
    """The whole way: a scene or problem that names files, on one and on two ranks; judged by numpy."""

    def test_solve_and_run(self):
        matrix = np.array([[4, 0, 1.5, 0], [0, 3, 0, -1], [0.25, 0, 5, 0], [0, 2, 0, 6.0]])
        q = np.array([-1.0, 2.0, -3.0, 5.0])
        with program.temporary_folder() as name:
            folder = Path(name)
            sp.save_npz(folder / "M.npz", sp.csc_matrix(matrix))
            np.save(folder / "q.npy", q)
            (folder / "M.mtx.gz").write_bytes(gzip.compress(market(sp.coo_matrix(matrix)).encode()))
            csr = sp.csr_matrix(matrix)
            (folder / "M.petsc").write_bytes(
                b"".join(np.asarray(part, ">i4").tobytes() for part in ([1211216, 4, 4, csr.nnz], np.diff(csr.indptr), csr.indices))
                + csr.data.astype(">f8").tobytes() + np.array([1211214, 4], ">i4").tobytes() + q.astype(">f8").tobytes())
            with h5py.File(folder / "m.h5", "w") as file:
                file["M"] = matrix.T
                file["M"].attrs["MATLAB_class"] = np.bytes_("double")
                file["low"] = np.full(4, -np.inf)
            low = 'lower = {file = "m.h5", dataset = "low"}'
            for ranks, M, right in ((1, '"M.npz"', '"q.npy"'), (2, '{file = "M.petsc"}', '"M.petsc"'), (1, '"M.mtx.gz"', '"q.npy"'),
                                    (1, '{file = "m.h5", dataset = "M"}', '{file = "q.npy"}')):
                (folder / "p.toml").write_text(f"[problem]\nM = {M}\nq = {right}\n{low}\n")
                outcome = program.run("solve", "p.toml", "-o", "u.h5", "--force", cwd=folder, ranks=ranks)
                self.assertEqual(outcome.code, 0, outcome)
                with h5py.File(folder / "u.h5") as file:
                    # Rounding: the condition of this matrix is 3.
                    np.testing.assert_allclose(file["solution"][-1], np.linalg.solve(matrix, -q), rtol=0, atol=1e-14)
            # Implicit Euler, x' = A x: no constraint is met.
            np.save(folder / "A.npy", np.asfortranarray(-matrix))
            (folder / "s.toml").write_text('[time]\nend = 0.5\nstep = 0.1\n[model]\nkind = "linear"\nA = [[0]]\n'
                                           "B = [[0], [0], [0], [1]]\nC = [[0, 0, 0, 1]]\nw0 = [100]\nx0 = [1, 2, 3, 4]\n")
            outcome = program.run("run", "s.toml", "--set", "model.A=A.npy", cwd=folder)
            self.assertEqual(outcome.code, 0, outcome)
            state = np.array([1.0, 2.0, 3.0, 4.0])
            for _ in range(5):
                state = np.linalg.solve(np.eye(4) + 0.1 * matrix, state)
            with h5py.File(folder / "s.h5") as file:
                np.testing.assert_allclose(file["x"][-1], state, rtol=0, atol=1e-13)  # 5 steps, rounding


if __name__ == "__main__":
    unittest.main()
