# ranks: 1
"""The systemd unit, as far as systemd-analyze can tell without a systemd: it is understood, and shut in."""

import re
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

UNIT = program.SOURCE / "scripts/sweepvi-serve.service"
MOST = 2.5  # of 10: what systemd calls OK


@unittest.skipUnless(shutil.which("systemd-analyze"), "no systemd-analyze")
class Unit(unittest.TestCase):
    def analyze(self, *words):
        done = subprocess.run(["systemd-analyze", *words], capture_output=True, text=True, timeout=60)
        return done.stdout + done.stderr

    def test_exposure(self):
        text = self.analyze("security", "--offline=true", str(UNIT))
        found = re.search(r"exposure level for \S+: ([0-9.]+)", text)
        if not found:
            self.skipTest("this systemd-analyze does not look at files: " + text[-200:])
        self.assertLessEqual(float(found[1]), MOST, text)

    def test_every_line_is_understood(self):
        with program.temporary_folder() as folder:
            copy = Path(folder) / UNIT.name
            copy.write_text(UNIT.read_text().replace("/usr/local/bin/sweepvi", "/bin/true"))
            complaints = [line for line in self.analyze("verify", str(copy)).splitlines() if UNIT.name in line]
        self.assertEqual(complaints, [])


if __name__ == "__main__":
    unittest.main()
