# ranks: 1
"""Box VIs with and without a solution, known without rounding (solvable.py): no step that has none is certified."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import solvable


class Solvable(unittest.TestCase):
    def test_on_one_rank(self):
        # Among them one with a null direction along which rounding leaves nothing of q, which was certified at |u| = 1e30 once.
        self.assertEqual(solvable.main("quick", count=30, largest=60, small_count=300), 0)

    def test_on_two_ranks(self):
        self.assertEqual(solvable.main("two ranks", count=10, largest=40, small_count=30, ranks=2), 0)


if __name__ == "__main__":
    unittest.main()
