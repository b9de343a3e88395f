"""A thousand balls, against the closed form in the scene's header."""
# ranks: 1
# labels: long no-sanitize
# timeout: 300

import unittest

import gallery
import program


class FallingColumn(unittest.TestCase):
    def test_as_its_header_says(self):
        example = next(e for e in gallery.examples() if e.words == ["examples/falling_column/scene.toml"])
        self.assertIn("mu_2 = h (1000 - i)", example.expect)
        with program.temporary_folder() as folder:
            gallery.audit_column(gallery.run(folder, example, timeout=250), 1000, 10.1)


if __name__ == "__main__":
    unittest.main()
