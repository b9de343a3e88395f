# Lifted chains: with phi_i = sin(pi (i+1)/(N+1)), mu the eigenvalue of the chain's Laplacian that belongs to phi,
# a1 = -(1 - coupling mu) and initial data phi_i (1,0,0,0,0), element i of a jerk chain is phi_i times AB (65), and so is
# each step of the scheme: all N constraints switch together. Written as `chain`, and as `linear` in random order.
#
# ranks: 2
# timeout: 300
import numpy as np
from chain_runs import BLOCK_JACOBI, Verdict, homsp, jerk_chain, program, run, write_scene

COUNT = 1000
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


def lifted_entries():
    """A of the chain as (row, column, value)."""
    element = np.array(AB65["A"], dtype=float)
    element[2, 0] = A1 - 2.0 * COUPLING
    entries = [(5 * i + j, 5 * i + k, element[j, k]) for i in range(COUNT) for j, k in zip(*np.nonzero(element))]
    entries += [(5 * i + 2, 5 * (i + 1), COUPLING) for i in range(COUNT - 1)]
    entries += [(5 * i + 2, 5 * (i - 1), COUPLING) for i in range(1, COUNT)]
    return entries


def write_matrix(path, rows, columns, entries):
    with path.open("w") as file:
        file.write(f"%%MatrixMarket matrix coordinate real general\n{rows} {columns} {len(entries)}\n")
        file.writelines(f"{row + 1} {column + 1} {value:.17g}\n" for row, column, value in entries)


def write_shuffled(folder, step):
    """The lifted chain as a `linear` scene in random order; the scene and the new number of each state."""
    random = np.random.default_rng(65)
    state = random.permutation(5 * COUNT)
    constraint = random.permutation(COUNT)
    entries = [(state[row], state[column], value) for row, column, value in lifted_entries()]
    inputs = [(state[5 * i + 2], constraint[i], 1.0) for i in range(COUNT)]
    outputs = [(constraint[i], state[5 * i], 1.0) for i in range(COUNT)]
    for matrix in (entries, inputs, outputs):
        random.shuffle(matrix)
    write_matrix(folder / "A.mtx", 5 * COUNT, 5 * COUNT, entries)
    write_matrix(folder / "B.mtx", 5 * COUNT, COUNT, inputs)
    write_matrix(folder / "C.mtx", COUNT, 5 * COUNT, outputs)
    x0 = np.zeros(5 * COUNT)
    x0[state] = lifted_x0()
    model = {"kind": "linear", "A": "A.mtx", "B": "B.mtx", "C": "C.mtx", "x0": x0.tolist()}
    return write_scene(folder, "shuffled", homsp(END, step), model), state


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


def test_shuffled(folder, step, rank_counts, options, verdict):
    times, scalar, _ = scalar_run(folder, step)
    scene, state = write_shuffled(folder, step)
    for ranks in rank_counts:
        file, summary = run(scene, ranks, options)
        name = f"linear, shuffled, h = {step:g}, {ranks} ranks, {summary['seconds_stepping']:.1f} s"
        check_lifted(verdict, name, file["x"][:][:, state], file["t"][:], times, scalar)


def main():
    verdict = Verdict()
    with program.temporary_folder() as name:
        folder = program.Path(name)
        test_chain(folder, 1e-1, (1, 2, 3, 5), [], verdict)
        test_chain(folder, 2e-2, (1, 2, 3, 5), BLOCK_JACOBI, verdict)
        test_shuffled(folder, 1e-1, (1, 3), [], verdict)
    verdict.exit()


main()
