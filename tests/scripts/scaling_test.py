# ranks: 2
"""scripts/scaling.py: its table, CSV file and picture for small scenes; a setting that fails is said to. Never how fast."""

import csv
import os
import subprocess
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "app"))
import program


class Scaling(unittest.TestCase):
    def scaling(self, folder, *words, code=0):
        environment = {**os.environ, **program.ENVIRONMENT, "SWEEPVI": str(program.PROGRAM), "OMPI_MCA_orte_tmpdir_base": folder}
        done = subprocess.run([sys.executable, "scripts/scaling.py", *words, "--csv", f"{folder}/s.csv"], cwd=program.SOURCE,
                              env=environment, capture_output=True, text=True, check=False, timeout=100)  # fmt: skip
        self.assertEqual(done.returncode, code, done.stderr)
        return done

    def test_tables_file_and_picture(self):
        with program.temporary_folder() as folder:
            done = self.scaling(folder, "contact,lattice", "30", "--ranks", "1,2", "--settings", "ours,KLU",
                                "--rounds", "2", "--count", "1", "--warmup", "2")  # fmt: skip
            with open(Path(folder) / "s.csv", newline="") as file:
                rows = list(csv.DictReader(file))
            made = program.content(folder)
            self.assertTrue(all(made[f"scaling_{scene}.png"][:4] == b"\x89PNG" for scene in ("contact", "lattice")))
        # Sizes of a lattice are squares; twice as many elements on two ranks are for ours, and lattices go without.
        ours = [(row["scene"], row["N"], row["ranks"]) for row in rows if row["setting"] == "ours"]
        contact = [("contact", "30", "1"), ("contact", "30", "2"), ("contact", "60", "2")]
        self.assertEqual(sorted(ours), sorted(contact + [("lattice", "25", ranks) for ranks in "12"]))
        for row in rows:
            if row["setting"] == "ours" or row["scene"] == "lattice":
                self.assertEqual((row["status"], row["rounds"], row["steps"]), ("done", "2", "10"), row)
                self.assertGreater(float(row["seconds_per_step"]), 0)
        for line in ("BLAS ", "**contact**: milliseconds per step (MatMults per step)", "| N | ranks | strong | weak |",
                     "contacts changed (least)"):  # fmt: skip
            self.assertIn(line, done.stdout)

    def test_what_it_refuses(self):
        with program.temporary_folder() as folder:
            self.assertIn("there is no scene 'jrek'", self.scaling(folder, "jrek", code=2).stderr)
            self.assertIn("known: ours, reduced space, MUMPS", self.scaling(folder, "jerk", "--settings", "x", code=2).stderr)


if __name__ == "__main__":
    unittest.main()
