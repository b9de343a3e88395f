"""A square lattice of jerk elements against the same lattice with its elements shuffled, given by a coupling matrix."""

from pathlib import Path

import numpy as np
from chain_runs import Verdict, homsp, program, run, write_scene

COUPLING = 0.5


def neighbours(side):
    """Both directions of each coupling, element by element."""
    number = np.arange(side * side).reshape(side, side)
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:])]
    one_way = np.array([(a, b) for left, right in pairs for a, b in zip(left.ravel(), right.ravel())])
    return np.vstack([one_way, one_way[:, ::-1]])


def write_matrix(path, size, pairs):
    with path.open("w") as file:
        file.write(f"%%MatrixMarket matrix coordinate real general\n{size} {size} {len(pairs)}\n")
        file.writelines(f"{row + 1} {column + 1} {COUPLING}\n" for row, column in pairs)


def write_vector(path, values):
    with path.open("w") as file:
        file.write(f"%%MatrixMarket matrix array real general\n{len(values)} 1\n")
        file.writelines(f"{value!r}\n" for value in values.tolist())


def start(count):
    """z1 between 0.02 and 0.3 and falling at 3: within five steps of 0.02 most elements hit, one after the other."""
    x0 = np.zeros((count, 5))
    x0[:, 0] = 0.02 + 0.28 * np.modf(np.arange(count) * 0.6180339887498949)[0]
    x0[:, 1] = -3.0
    return x0


def compare(side, ranks, random_cut_share):
    count = side * side
    pairs = neighbours(side)
    missing = 4 - np.bincount(pairs[:, 0], minlength=count)
    place = np.random.default_rng(1).permutation(count)  # of each element in the shuffled scene
    verdict = Verdict()
    with program.temporary_folder() as name:
        folder = Path(name)
        x0 = start(count)
        shuffled_x0 = np.empty_like(x0)
        shuffled_x0[place] = x0
        a1 = np.empty(count)
        a1[place] = -1.0 - COUPLING * missing  # the matrix has no ends
        write_vector(folder / "x0.mtx", x0.ravel())
        write_vector(folder / "shuffled_x0.mtx", shuffled_x0.ravel())
        write_vector(folder / "a1.mtx", a1)
        write_matrix(folder / "coupling.mtx", count, place[pairs])
        jerk = {"kind": "chain", "element": "jerk", "count": count}
        lattice = {**jerk, "topology": "lattice", "shape": [side, side], "coupling": COUPLING, "x0": "x0.mtx"}
        shuffled = {**jerk, "coupling": "coupling.mtx", "a1": "a1.mtx", "x0": "shuffled_x0.mtx"}
        reference, summary = run(write_scene(folder, "lattice", homsp(0.1, 0.02), lattice))
        x = reference["/x"][-1].reshape(count, 5)
        active = reference["/solver/active"][-1]
        verdict.expect(
            active > count // 5 and summary["exit"] == 0, f"one rank: {active} of {count} elements in contact"
        )
        scene = write_scene(folder, "shuffled", homsp(0.1, 0.02), shuffled)
        for n in ranks:
            file, summary = run(scene, ranks=n, timeout=1500)
            # Rounding of another elimination order; states of order 3, and switching is the same.
            difference = np.abs(file["/x"][-1].reshape(count, 5)[place] - x).max()
            verdict.expect(
                difference <= 1e-10, f"{n} ranks, shuffled: differs by {difference:.1e} from one rank, in order"
            )
            random_cut = len(pairs) / 2 * (1 - 1 / n)
            share = summary["edge_cut"] / random_cut
            verdict.expect(
                share <= random_cut_share, f"{n} ranks: cuts {summary['edge_cut']} couplings, {share:.1%} of a random cut"
            )
    verdict.exit()
