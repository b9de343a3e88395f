# Memory is spread over the ranks: a chain of 10^6 elements, 3 steps, all states recorded, needs on each of two ranks at
# most 0.65 of what it needs on one. Takes 5 GB of memory and 0.8 GB of disk.
#
# ranks: 2
# labels: long no-sanitize
# timeout: 600
import numpy as np
from chain_runs import BLOCK_JACOBI, Verdict, homsp, jerk_chain, program, run, write_scene

COUNT = 1000000
STEPS = 3
# One half is what can be shared at best; the rest is for the graph, which rank 0 sees whole, and what both ranks hold.
LARGEST_RATIO = 0.65
# The factors of block Jacobi live on their own ranks, so that the program's own memory shows; MUMPS's analysis does not
# share (and overflows the stack on deep elimination trees).
OPTIONS = BLOCK_JACOBI


def test_memory(folder, verdict):
    scene = write_scene(folder, "million", homsp(STEPS * 1e-2, 1e-2), jerk_chain(COUNT), {"every": 1})
    peaks, last = [], []
    for ranks in (1, 2):
        file, summary = run(scene, ranks, OPTIONS)
        peaks.append(summary["peak_rss_bytes"])
        last.append(file["x"][-1])
        verdict.expect(
            summary["steps"] == STEPS and file["x"].shape == (STEPS + 1, 5 * COUNT),
            f"{ranks} ranks: {peaks[-1] / 1e6:.0f} MB a rank ({peaks[-1] / summary['unknowns']:.0f} B per unknown), "
            f"setup {summary['seconds_setup']:.1f} s, stepping {summary['seconds_stepping']:.1f} s, "
            f"total {summary['seconds_total']:.1f} s",
        )
    # Three steps of states of order 1 round to 1e-15 or so each; nothing has switched yet.
    difference = np.abs(last[0] - last[1]).max()
    verdict.expect(difference <= 1e-14, f"the two ends differ by {difference:.1e}")
    ratio = peaks[1] / peaks[0]
    verdict.expect(ratio <= LARGEST_RATIO, f"peak of a rank of two over the peak of one: {ratio:.3f}")


def main():
    verdict = Verdict()
    with program.temporary_folder() as name:
        test_memory(program.Path(name), verdict)
    verdict.exit()


main()
