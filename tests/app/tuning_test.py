# ranks: 2
# timeout: 120
"""The recipes of examples/scaling/tuning.toml: each changes what examples/README.md says, told by counters, and none the trajectory."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program

SCALING = program.SOURCE / "examples" / "scaling"
SETTINGS = SCALING / "tuning.toml"
STEPS = 10
SIZE = 120


class Tuning(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.runs = {(scene, ranks): cls.bench(scene, ranks) for scene in ("jerk", "contact") for ranks in (1, 2)}

    @staticmethod
    def bench(scene, ranks):
        with program.temporary_folder() as folder:
            words = ["--set", f"model.count={SIZE}", "--warmup", "20", "--count", str(STEPS), "--repeats", "1"]
            words += ["--settings", SETTINGS, "--summary", "b.json"]
            outcome = program.run("bench", SCALING / f"{scene}.toml", *words, cwd=folder, ranks=ranks, timeout=100)
            rows = program.read_json(Path(folder) / "b.json")["runs"]
        return {row["setting"]: row for row in rows}

    def rows(self, *names):
        """Of each run the rows of these settings, or all of them."""
        return [(scene, rows[name], rows["by itself"]) for (scene, _), rows in self.runs.items() for name in names or rows]

    def test_no_recipe_changes_what_is_computed(self):
        for scene, row, _ in self.rows():
            if scene == "contact" and row["setting"] == "active set, PETSc LU":
                continue  # multipliers have no diagonal, and PETSc's LU does not exchange rows: it may fail
            self.assertEqual(row["status"], "done", row["failure"])
            self.assertEqual(row["steps"], STEPS)
            self.assertLess(row["max_residual"], 1e-10)
            self.assertLess(row["states_differ"] or 0.0, 1e-12)  # rounding, on states of size 1
            self.assertGreater(row["active_changes"], STEPS // 2)  # there is something to find out

    def test_by_itself_nothing_is_factored(self):
        expected = {"jerk": "blocks", "contact": "paths"}
        for scene, row, _ in self.rows("by itself"):
            self.assertEqual(row["predictor"], expected[scene])
            self.assertEqual((row["factorizations"], row["snes_iterations"], row["predictor_hits"]), (0, 0, STEPS))
            self.assertEqual(row["mumps_flops"], 0.0)

    def test_active_set(self):
        for _, row, _ in self.rows("active set"):
            self.assertEqual(row["predictor"], "active set")
            self.assertEqual((row["snes_iterations"], row["predictor_hits"]), (0, STEPS))
            # Each step changes the set: factored at least once, and not much more often than sets are tried.
            self.assertTrue(STEPS <= row["factorizations"] <= 10 * STEPS, row["factorizations"])
            self.assertGreater(row["mumps_flops"], 0.0)

    def test_petsc_lu(self):
        for scene, row, _ in self.rows("active set, PETSc LU"):
            if scene == "contact":
                continue
            self.assertEqual(row["predictor_hits"], STEPS)
            self.assertGreaterEqual(row["factorizations"], STEPS)
            self.assertEqual(row["mumps_flops"], 0.0)

    def test_petsc_alone(self):
        for _, row, _ in self.rows("PETSc alone"):
            self.assertEqual((row["predictor"], row["predictor_hits"], row["snes_type"]), ("nobody", 0, "vinewtonssls"))
            self.assertGreaterEqual(row["snes_iterations"], STEPS)
            self.assertGreaterEqual(row["factorizations"], row["snes_iterations"])  # one in each iteration
            self.assertGreater(row["mumps_flops"], 0.0)

    def test_iterative(self):
        for _, row, _ in self.rows("iterative"):
            self.assertEqual((row["predictor"], row["mumps_flops"]), ("nobody", 0.0))
            self.assertGreaterEqual(row["linear_solves"], STEPS)

    def test_other_form(self):
        for scene, row, own in self.rows("other form"):
            self.assertEqual(row["form"], "primal-dual")
            if scene == "jerk":  # outputs are unknowns there; here three multipliers for each constraint as well
                self.assertEqual((own["unknowns"], row["unknowns"]), (5 * SIZE, 8 * SIZE))


if __name__ == "__main__":
    unittest.main()
