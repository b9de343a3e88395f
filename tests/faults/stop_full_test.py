# Signals at any time, one or two at once: the run stops in order, goes on from its file, and ends with the same bits.
#
# ranks: 2
# labels: long
# timeout: 3600
import signal

import faults
import program

USR1, TERM, INT = signal.SIGUSR1, signal.SIGTERM, signal.SIGINT
SIGNALS = [(USR1,), (TERM,), (INT,), (USR1, USR1), (TERM, USR1), (INT, INT)]


def main():
    verdict = program.Verdict()
    for ranks in 1, 2, 3:
        stops = faults.Stops()
        for seed, case in enumerate(faults.CASES):
            with program.temporary_folder() as folder:
                expected, seconds = faults.undisturbed(case, ranks, folder)
                try:
                    faults.signal_until_done(case, ranks, expected, seconds, SIGNALS, seed, stops)
                    verdict.expect(True, f"{case.name}, {ranks} ranks")
                except AssertionError as error:
                    verdict.expect(False, f"{case.name}, {ranks} ranks: {error}")
        print(f"  {ranks} ranks: {stops}")
    verdict.exit()


if __name__ == "__main__":
    main()
