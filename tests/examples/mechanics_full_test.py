"""The elastic bar of 1000 masses, as the header of its scene says."""
# ranks: 1
# labels: long
# timeout: 300

import unittest

import mechanics_test
import numpy as np


class FineBar(mechanics_test.Runs):
    def test_elastic_bar(self):
        self.promised("elastic_bar/scene.toml", "1.0010", "2.0050", "0.49773", "0.0060")
        _, found = self.bar()
        _, fine = self.bar("--set", "time.step=1e-3", folder=self.made(1000))
        np.testing.assert_allclose(fine, [1.001, 2.005, 0.49773, 0.0060], atol=1e-5)
        self.assertLess(max(abs(fine[0] - 1), abs(fine[1] - 2)), 0.5 * max(abs(found[0] - 1), abs(found[1] - 2)))
        self.assertLess(abs(fine[2] - 0.5), 0.5 * abs(found[2] - 0.5))


if __name__ == "__main__":
    unittest.main()
