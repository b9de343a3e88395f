"""The main job of scripts/run, whole, held against the numbers in its header."""
# ranks: 2
# labels: long no-sanitize
# timeout: 600

import unittest

import gallery
import numpy as np
import program


class JerkChain(unittest.TestCase):
    def test_as_its_header_says(self):
        example = next(e for e in gallery.examples() if e.words == ["examples/jerk_chain/scene.toml"])
        with program.temporary_folder() as folder:
            result = gallery.run(folder, example, timeout=500)
        self.assertEqual(example.ranks, 2)
        for text in ("10000 unknowns", "2017 contacts", "17 elements twice", "2.94 s", "7.06 s"):
            self.assertIn(text, example.expect)
        self.assertEqual(result.summary["unknowns"], 10000)
        self.assertEqual(result.summary["max_penetration"], 0.0)
        self.assertGreaterEqual(result.w.min(), 0.0)
        closed = result.z[:, :, 0] == 0
        self.assertTrue((result.z[closed & (result.level == 3)] >= 0).all())
        contacts = result.contacts()
        per_element = np.bincount(contacts["constraint"], minlength=2000)
        self.assertEqual((len(contacts), per_element.min(), np.count_nonzero(per_element == 2)), (2017, 1, 17))
        self.assertEqual(len(result.lift_offs()), 2017)
        self.assertAlmostEqual(contacts["t"].min(), 2.94)
        self.assertAlmostEqual(result.events["t"].max(), 7.06)
        self.assertEqual(closed.sum(axis=1).max(), 2000)
        self.assertFalse(closed[-1].any())


if __name__ == "__main__":
    unittest.main()
