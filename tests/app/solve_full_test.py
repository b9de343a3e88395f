# ranks: 2
# labels: long
# timeout: 240
"""More of the random problems of solve_test.py."""

import unittest

import solve_test


class SolveMore(solve_test.Solve):
    LCPS, MIXED = 200, 50


if __name__ == "__main__":
    unittest.main()
