# Each of the first 300 file calls of a run with checkpoints, of a job's life and of a daemon's start fails once, or with all
# after it: nothing is lost or doubled, and everything goes on.
#
# ranks: 2
# labels: long no-sanitize
# timeout: 10800
import os
import sys

import injection
import program

CALLS = int(os.environ.get("SWEEPVI_INJECTED_CALLS", "300"))
PARTS = sys.argv[1:] or ["runs", "lives", "ends", "starts"]


def main():
    numbers = range(1, CALLS + 1)
    verdict = program.Verdict()
    if "runs" in PARTS:
        with injection.runs(1, 2) as all_runs:
            for run in all_runs:
                for fault in injection.FAULTS:
                    # Two ranks differ from one in how they write rows.
                    run.go_through(numbers if run.ranks == 1 else numbers[4::10], fault, verdict)
    if "lives" in PARTS:
        for fault in injection.EIO, injection.FULL:
            injection.lives(numbers, fault, verdict)
    if "ends" in PARTS:
        for fault in injection.EIO, injection.FULL:
            injection.lives(numbers[:40], fault, verdict, "be_removed")
            injection.lives(numbers[:20], fault, verdict, "be_cancelled")
    if "starts" in PARTS:
        with program.temporary_folder() as folder:
            starts = injection.Starts(folder)
            for fault in injection.EIO, injection.FULL:
                starts.go_through(numbers, fault, verdict)
    verdict.exit()


if __name__ == "__main__":
    main()
