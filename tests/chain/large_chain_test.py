# Large chains need no more than they must: five unknowns an element, a Jacobian as sparse as the model, one cut coupling
# between two ranks, and the same results whatever the solver and the number of ranks.
# LARGE elements here, in large_chain_full_test.py ten times as many.
#
# ranks: 2
# timeout: 300
import numpy as np
from chain_runs import BLOCK_JACOBI, PETSC_LU, Verdict, homsp, jerk_chain, program, run, write_scene

SMALL = (100, 1000, 10000)
LARGE = 10000
# 4 s in 10 steps: many elements meet their wall. (At small steps nothing happens in so few.)
STEPS, STEP = 10, 0.4
# Elements differ by what two solvers round in 10 steps. An element that switched differently would be off by 1e-2.
TOLERANCE = 1e-13


def jacobian_nonzeros(count):
    """Of an element: 5 on the diagonal, z2, z3 above it, z1, z2, xi2 in the third row, xi2, z1 below; 2 neighbours, which
    the elements at the ends have one of."""
    return (5 + 2 + 3 + 1 + 1 + 1 + 2) * count - 2


def check_sizes(verdict, count, summary):
    unknowns, nonzeros = summary["unknowns"], summary["jacobian_nonzeros"]
    verdict.expect(
        unknowns == 5 * count and summary["constraints"] == count and nonzeros == jacobian_nonzeros(count),
        f"N = {count}: {unknowns} unknowns, {nonzeros} nonzeros, {nonzeros / unknowns:.4f} per unknown",
    )


def test_sizes(folder, verdict):
    for count in SMALL:
        _, summary = run(write_scene(folder, f"N{count}", homsp(STEP, STEP), jerk_chain(count)))
        check_sizes(verdict, count, summary)


def describe(name, summary):
    keys = "seconds_setup", "seconds_stepping", "seconds_total"
    times = ", ".join(f"{key[8:]} {summary[key]:.2f} s" for key in keys)
    memory = f"{summary['peak_rss_bytes'] / 1e6:.0f} MB a rank"
    return f"{name}: {times}, {summary['matmults_per_step']:.0f} MatMults a step, {memory}"


def check_same(verdict, name, file, expected):
    """The same states up to rounding and the same active sets."""
    states = np.abs(file["x"][:] - expected["x"][:]).max()
    levels = np.count_nonzero(file["level"][:] != expected["level"][:])
    scale = np.abs(expected["x"][:]).max()
    verdict.expect(
        states <= TOLERANCE * scale and levels == 0,
        f"{name}: states differ by {states / scale:.1e} of the largest, levels in {levels} places",
    )


def test_large(folder, verdict, count):
    scene = write_scene(folder, "large", homsp(STEPS * STEP, STEP), jerk_chain(count))
    rcm = PETSC_LU + ["-pc_factor_mat_ordering_type", "rcm"]
    expected, summary = run(scene, 1, rcm)
    print(describe("        1 rank, PETSc LU", summary))
    check_sizes(verdict, count, summary)
    verdict.expect(expected["/solver/active"][-1] > count // 100, f"{expected['/solver/active'][-1]} elements in contact")

    cases = (("1 rank, block Jacobi", 1, BLOCK_JACOBI), ("2 ranks, block Jacobi", 2, BLOCK_JACOBI),
             ("1 rank, MUMPS", 1, []), ("2 ranks, MUMPS", 2, []))  # fmt: skip
    for name, ranks, options in cases:
        try:
            file, summary = run(scene, ranks, options, name.replace(" ", "_"))
        except AssertionError as failure:
            verdict.expect(False, f"{name}: {failure}")
            continue
        print(describe(f"        {name}", summary))
        check_same(verdict, name, file, expected)
        # A chain falls apart into two when one coupling is cut; METIS may leave a few more.
        verdict.expect(summary["edge_cut"] <= (3 if ranks == 2 else 0), f"{name}: edge cut {summary['edge_cut']}")
        check_sizes(verdict, count, summary)


def main(count):
    verdict = Verdict()
    with program.temporary_folder() as name:
        test_sizes(program.Path(name), verdict)
        test_large(program.Path(name), verdict, count)
    verdict.exit()


if __name__ == "__main__":
    main(LARGE)
