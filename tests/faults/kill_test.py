# Runs that are killed at random moments and taken up again end with the bits of a run that nobody killed.
#
# ranks: 2
# timeout: 300
import sys
import unittest

import faults
import program

KILLS = [
    faults.Kill("all", "any time"),
    faults.Kill("one rank", "at a checkpoint"),
    faults.Kill("all", "at the start"),
]


class Killed(unittest.TestCase):
    def kill(self, case, ranks, seed):
        tally = faults.Tally()
        with program.temporary_folder() as folder:
            expected, seconds = faults.undisturbed(case, ranks, folder)
            faults.kill_until_done(case.often(), ranks, expected, seconds, KILLS, seed, tally)
        print(case.name, tally)

    def test_one_rank(self):
        self.kill(faults.CASES[0], 1, 1)

    def test_two_ranks(self):
        self.kill(faults.CASES[1], 2, 2)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
