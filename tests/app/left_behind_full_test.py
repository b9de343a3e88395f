# ranks: 3
# labels: long
# timeout: 300
"""Nothing of PETSc's is left behind, on two and three ranks."""

import unittest

import left_behind_test


class LeftBehindOnMoreRanks(left_behind_test.LeftBehind):
    test_on_one_rank = None  # the quick test has them

    def test_on_two_ranks(self):
        self.at(2, list(left_behind_test.CASES))

    def test_on_three_ranks(self):
        self.at(3, list(left_behind_test.CASES))


if __name__ == "__main__":
    unittest.main()
