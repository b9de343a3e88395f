# The order of /x: element by element or state by state, with all elements or some, on any number of ranks; what readers
# are told about it; and coupling matrices kept in files.
#
# ranks: 2
import numpy as np
from chain_runs import Verdict, homsp, jerk_chain, program, run, write_scene

COUNT = 6
TIME = homsp(2.0, 0.05)
CHOSEN = [1, 2, 5]
# Rounding of 40 steps; an element in the wrong place would be off by 1e-2.
TOLERANCE = 1e-12
NAMES = {"jerk": ["z1", "z2", "z3", "xi1", "xi2"], "flexible": ["q", "p", "q'", "p'"], "wall": ["q", "v"],
         "contact": ["q", "v"]}  # fmt: skip
ORDER = {"jerk": "element by element", "flexible": "element by element", "wall": "state by state",
         "contact": "state by state"}  # fmt: skip


def chain(element, **keys):
    return {"kind": "chain", "element": element, "count": COUNT, **({"e": 0} if element == "wall" else {}), **keys}


def by_element(element, x, count):
    """[rows, elements, states]"""
    if ORDER[element] == "state by state":
        return x.reshape(len(x), -1, count).transpose(0, 2, 1)
    return x.reshape(len(x), count, -1)


def constraint(element, q):
    """w of the positions [rows, elements]."""
    if element != "contact":
        return q
    return np.column_stack([q[:, :1], np.diff(q, axis=1) - 1.0])


def test_layout(folder, element, verdict):
    whole, _ = run(write_scene(folder, element, TIME, chain(element)))
    states = by_element(element, whole["x"][:], COUNT)
    attributes = whole["x"].attrs
    verdict.expect(
        list(attributes["names"]) == NAMES[element] and attributes["order"] == ORDER[element],
        f"{element}: names {list(attributes['names'])}, {attributes['order']}",
    )
    error = np.abs(constraint(element, states[:, :, 0]) - whole["w"][:]).max()
    verdict.expect(error <= TOLERANCE, f"{element}: /w is the constraint of the positions in /x up to {error:.1e}")
    for ranks in (1, 2):
        for name, output, kept in (("all", {}, list(range(COUNT))), ("some", {"blocks": CHOSEN}, CHOSEN)):
            file, _ = run(write_scene(folder, f"{element}_{name}", TIME, chain(element), output), ranks)
            found = by_element(element, file["x"][:], len(kept))
            error = max(np.abs(found - states[:, kept]).max(), np.abs(file["w"][:] - whole["w"][:, kept]).max())
            verdict.expect(error <= TOLERANCE, f"{element}, {name} elements, {ranks} ranks: differ by {error:.1e}")


def test_start(folder, verdict):
    """A run starts from x0 in the order of /x."""
    x0 = [0.5 + 0.125 * i for i in range(2 * COUNT)]
    for ranks in (1, 2):
        file, _ = run(write_scene(folder, "start", TIME, chain("wall", x0=x0)), ranks)
        verdict.expect(np.array_equal(file["x"][0], x0), f"wall, {ranks} ranks: /x starts with x0")


def test_matrix_file(folder, verdict):
    """A ring as a number, as rows and as a MatrixMarket file, read by rank 0 and dealt out."""
    ring = 0.5 * (np.eye(COUNT, k=1) + np.eye(COUNT, k=-1) + np.eye(COUNT, k=COUNT - 1) + np.eye(COUNT, k=1 - COUNT))
    with (folder / "ring.mtx").open("w") as file:  # the lower triangle of a symmetric matrix
        rows, columns = np.nonzero(np.tril(ring))
        file.write(f"%%MatrixMarket matrix coordinate real symmetric\n{COUNT} {COUNT} {len(rows)}\n")
        file.writelines(f"{i + 1} {j + 1} 0.5\n" for i, j in zip(rows, columns))
    expected, _ = run(write_scene(folder, "number", TIME, jerk_chain(COUNT, topology="ring")))
    for ranks in (1, 2):
        for name, coupling in (("file", "ring.mtx"), ("rows", ring.tolist())):
            file, _ = run(write_scene(folder, f"ring_{name}", TIME, jerk_chain(COUNT, coupling)), ranks)
            error = np.abs(file["x"][:] - expected["x"][:]).max()
            verdict.expect(error <= TOLERANCE, f"ring as {name}, {ranks} ranks: differs by {error:.1e}")


def main():
    verdict = Verdict()
    with program.temporary_folder() as name:
        folder = program.Path(name)
        for element in NAMES:
            test_layout(folder, element, verdict)
        test_start(folder, verdict)
        test_matrix_file(folder, verdict)
    verdict.exit()


main()
