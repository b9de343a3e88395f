# A run gives the same bits every time, on two and three ranks as well.
#
# ranks: 2
import sys
import unittest

import same_bits


class SameBits(unittest.TestCase):
    def test_two_runs(self):
        for scene, ranks in ("examples/flexible_chain/scene.toml", 3), ("examples/sweeping_chain/scene.toml", 2):
            with self.subTest(scene=scene, ranks=ranks):
                self.assertEqual(same_bits.two_runs_differ_in(scene, ranks), [])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
