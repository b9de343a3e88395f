# Lifted chains: with phi_i = sin(pi (i+1)/(N+1)), mu the eigenvalue of the chain's Laplacian that belongs to phi,
# a1 = -(1 - coupling mu) and initial data phi_i (1,0,0,0,0), element i of a jerk chain is phi_i times AB (65), and so is
# each step of the scheme: all N constraints switch together. Written as `chain`, as `linear` in random order, and with
# each element in coordinates of its own.
#
# ranks: 2
# timeout: 300
import numpy as np
from chain_runs import BLOCK_JACOBI, Verdict, homsp, jerk_chain, program, run, write_scene

COUNT = 300
COUPLING = 0.5
END = 10.0
# Both runs round differently; nothing amplifies that but the switching, which is the same. 500 steps of a system whose
# states are of order 1 leave 1e-13; 1e-10 is lost as soon as one element switches in another step.
TOLERANCE = 1e-10

PHI = np.sin(np.pi * np.arange(1, COUNT + 1) / (COUNT + 1))
A1 = -(1.0 - COUPLING * 4.0 * np.sin(np.pi / (2 * (COUNT + 1))) ** 2)
AB65 = {
    "kind": "linear",
    "A": [[0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [-1, -1, -1, 0, 1], [0, 0, 0, 0, 1], [1, 0, 0, -1, 0]],
    "B": [[0], [0], [1], [0], [0]],
    "C": [[1, 0, 0, 0, 0]],
    "x0": [1, 0, 0, 0, 0],
}


def lifted_x0():
    return np.outer(PHI, [1.0, 0.0, 0.0, 0.0, 0.0]).ravel()


def lifted_blocks():
    """A of the chain as (element, element, 5 x 5 block)."""
    element = np.array(AB65["A"], dtype=float)
    element[2, 0] = A1 - 2.0 * COUPLING
    neighbour = np.zeros((5, 5))
    neighbour[2, 0] = COUPLING
    for i in range(COUNT):
        yield i, i, element
        if i > 0:
            yield i, i - 1, neighbour
        if i < COUNT - 1:
            yield i, i + 1, neighbour


def write_matrix(path, rows, columns, entries):
    with path.open("w") as file:
        file.write(f"%%MatrixMarket matrix coordinate real general\n{rows} {columns} {len(entries)}\n")
        file.writelines(f"{row + 1} {column + 1} {value:.17g}\n" for row, column, value in entries)


def write_linear(folder, name, step, turns, random):
    """The lifted chain as a `linear` scene: element i in the coordinates turns[i] (z1 z2 z3 xi1 xi2)', states and
    constraints in random order. Returns the scene and the new number of each state."""
    state = random.permutation(5 * COUNT).reshape(COUNT, 5)
    constraint = random.permutation(COUNT)
    entries = []
    for i, j, block in lifted_blocks():
        block = turns[i] @ block @ turns[j].T
        entries += [(state[i, a], state[j, b], block[a, b]) for a, b in zip(*np.nonzero(block))]
    inputs = [(state[i, a], constraint[i], turns[i][a, 2]) for i in range(COUNT) for a in np.flatnonzero(turns[i][:, 2])]
    outputs = [(constraint[i], state[i, a], turns[i][a, 0]) for i in range(COUNT) for a in np.flatnonzero(turns[i][:, 0])]
    for matrix in (entries, inputs, outputs):
        random.shuffle(matrix)
    write_matrix(folder / f"{name}_A.mtx", 5 * COUNT, 5 * COUNT, entries)
    write_matrix(folder / f"{name}_B.mtx", 5 * COUNT, COUNT, inputs)
    write_matrix(folder / f"{name}_C.mtx", COUNT, 5 * COUNT, outputs)
    x0 = np.zeros(5 * COUNT)
    x0[state] = np.einsum("iab,ib->ia", turns, lifted_x0().reshape(COUNT, 5))
    model = {"kind": "linear", **{key: f"{name}_{key}.mtx" for key in "ABC"}, "x0": x0.tolist()}
    return write_scene(folder, name, homsp(END, step), model), state


def scalar_run(folder, step):
    file, _ = run(write_scene(folder, "scalar", homsp(END, step), AB65))
    return file["t"][:], file["x"][:], file["events"]["level"].tolist()


def check_scalar(verdict, levels, step):
    """Impact (levels 1 and 2), contact and lift-off happen, or the test says nothing."""
    verdict.expect(levels == [1, 2, 3, 3], f"h = {step:g}: AB (65) meets the wall, stays and leaves")


def worst_deviation(states, scalar):
    """The worst over time, element and state of |x_i / phi_i - scalar|, relative to the largest of that state."""
    deviation = np.abs(states / PHI[:, None] - scalar[:, None, :]) / np.abs(scalar).max(axis=0)
    return deviation.max(), np.unravel_index(deviation.argmax(), deviation.shape)


def check_lifted(verdict, name, states, times, scalar_times, scalar):
    same_times = np.array_equal(times, scalar_times)
    worst, (row, element, state) = worst_deviation(states.reshape(len(times), COUNT, 5), scalar)
    verdict.expect(
        same_times and worst <= TOLERANCE,
        f"{name}: worst {worst:.2e} at t = {times[row]:g}, element {element}, state {state}",
    )


def test_chain(folder, step, rank_counts, options, verdict):
    times, scalar, levels = scalar_run(folder, step)
    check_scalar(verdict, levels, step)
    scene = write_scene(
        folder, "lifted", homsp(END, step), jerk_chain(COUNT, COUPLING, a1=float(A1), x0=lifted_x0().tolist())
    )
    for ranks in rank_counts:
        file, summary = run(scene, ranks, options)
        name = f"chain, h = {step:g}, {ranks} ranks, {summary['seconds_stepping']:.1f} s"
        check_lifted(verdict, name, file["x"][:], file["t"][:], times, scalar)


def test_linear(folder, name, step, turns, rank_counts, verdict):
    times, scalar, _ = scalar_run(folder, step)
    scene, state = write_linear(folder, name, step, turns, np.random.default_rng(65))
    for ranks in rank_counts:
        file, summary = run(scene, ranks)
        states = np.einsum("iba,tib->tia", turns, file["x"][:][:, state])
        label = f"linear, {name}, h = {step:g}, {ranks} ranks, {summary['unknowns']} unknowns"
        check_lifted(verdict, f"{label}, {summary['seconds_stepping']:.1f} s", states, file["t"][:], times, scalar)


def random_rotations():
    return np.linalg.qr(np.random.default_rng(7).standard_normal((COUNT, 5, 5)))[0]


def main():
    verdict = Verdict()
    with program.temporary_folder() as name:
        folder = program.Path(name)
        test_chain(folder, 1e-1, (1, 2, 5), [], verdict)
        test_chain(folder, 2e-2, (1, 3), BLOCK_JACOBI, verdict)
        unturned = np.broadcast_to(np.eye(5), (COUNT, 5, 5))
        test_linear(folder, "shuffled", 1e-1, unturned, (1, 3), verdict)
        # Outputs are no longer states: multipliers are unknowns of their own.
        test_linear(folder, "turned", 1e-1, random_rotations(), (1, 3), verdict)
    verdict.exit()


main()
