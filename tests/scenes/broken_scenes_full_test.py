# ranks: 2
# labels: long
# timeout: 240
"""All broken scenes on two ranks; see broken_scenes_test.py."""

import unittest

import broken_scenes_test


class BrokenScenesOnTwoRanks(broken_scenes_test.BrokenScenes):
    test_on_one_rank = None  # the quick test has them all

    def test_on_two_ranks(self):
        self.at(2)


if __name__ == "__main__":
    unittest.main()
