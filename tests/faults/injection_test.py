# Some of the file calls of a run with checkpoints, of a job's life and of a daemon's start that lose most if their failure
# goes unnoticed; injection_full_test.py goes through all.
#
# ranks: 2
# labels: no-sanitize
# timeout: 300
import injection
import program
from injection import EIO, FULL


def main():
    verdict = program.Verdict()
    with injection.runs(1, kinds=("a run", "going on from a checkpoint")) as (run, going_on):
        # The output is opened, its first rows are written; a checkpoint is synchronised, renamed; the last rows, the end.
        run.go_through([2, 14, 66, 70, 74, 330], EIO, verdict)
        run.go_through([40, 68], FULL, verdict)
        going_on.go_through([8, 45], EIO, verdict)
    # The folder, the queue, the notes, the claim, the run.
    injection.lives([3, 20, 40, 75], EIO, verdict)
    with program.temporary_folder() as folder:
        injection.Starts(folder).go_through([2, 12], FULL, verdict)
    verdict.exit()


if __name__ == "__main__":
    main()
