# Every scene of examples/ gives the same bits every time, on two and three ranks as well; with SNESVI alone, too.
#
# ranks: 2
# labels: long
# timeout: 3600
import sys
import unittest

import same_bits


class SameBits(unittest.TestCase):
    def test_all_scenes(self):
        for scene in same_bits.scenes():
            for ranks in 2, 3:
                with self.subTest(scene=scene, ranks=ranks):
                    self.assertEqual(same_bits.two_runs_differ_in(scene, ranks), [])

    def test_without_predictor(self):
        for scene in "examples/flexible_chain/scene.toml", "examples/shared_input/scene.toml":
            for snes in "vinewtonrsls", "vinewtonssls":
                words = ["-sweepvi_predictor", "none", "-snes_type", snes]
                with self.subTest(scene=scene, snes=snes):
                    self.assertEqual(same_bits.two_runs_differ_in(scene, 3, *words), [])


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
