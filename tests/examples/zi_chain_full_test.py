"""Ten thousand balls on two ranks, as the scene's header says."""
# ranks: 2
# labels: long no-sanitize
# timeout: 400

import unittest

import gallery
import oscillators
import program


class FullChain(unittest.TestCase):
    def test_as_its_header_says(self):
        example = next(e for e in gallery.examples() if e.words == ["examples/zi_chain/scene.toml"])
        for text in ("40000 unknowns", "62226 impacts", "first at 0.288 s", "at rest from 1.122 s"):
            self.assertIn(text, example.expect)
        self.assertEqual(example.ranks, 2)
        with program.temporary_folder() as folder:
            result = oscillators.run(folder, example, timeout=350)
        self.assertEqual(result.summary["unknowns"], 40000)
        self.assertEqual(result.summary["snes_iterations"], 0)
        self.assertEqual(result.summary["rungs"]["predictor"], 3000)
        self.assertLess(result.summary["max_residual"], 1e-14)
        # Which of the last tiny bounces count depends on rounding, and so on the ranks: one in a thousand at most.
        self.assertAlmostEqual(len(result.impacts()), 62226, delta=62)
        self.assertAlmostEqual(result.events["t"][0], 0.288, delta=1e-9)
        self.assertAlmostEqual(result.rest().max(), 1.125, delta=1e-9)  # the first row from 1.122 s on


if __name__ == "__main__":
    unittest.main()
