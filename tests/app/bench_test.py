# ranks: 1
# timeout: 120
"""`sweepvi bench`: what it counts, what it writes, what it refuses, and that the scenes of examples/scaling keep changing
contact. Never how fast."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program

PAPER65 = program.SOURCE / "examples" / "paper65" / "scene.toml"
SCALING = program.SOURCE / "examples" / "scaling"
SCENES = ["jerk", "flexible", "wall", "contact", "zi", "lattice"]
SIZE = 400
SHAPED = ["--set", "model.shape=[20,20]"]
STRICT = "-sweepvi_certificate_rtol 1e-30 -sweepvi_target_rtol 1e-40 -sweepvi_halvings 0"
SETTINGS = f"""
[[setting]]
name = "ours"
[[setting]]
name = "bare"
options = "-sweepvi_predictor none"
[[setting]]
name = "strict"
options = "{STRICT}"
[[setting]]
name = "other step"
set = "time.end=20"
[[setting]]
name = "not for this"
schemes = "moreau-jean"
"""


class Bench(unittest.TestCase):
    def setUp(self):
        folder = program.temporary_folder()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def bench(self, *words, code=0, scene=PAPER65, ranks=1):
        outcome = program.run("bench", scene, *words, cwd=self.folder, ranks=ranks, timeout=100)
        self.assertEqual(outcome.code, code, outcome)
        return outcome

    def summary(self, *words, **how):
        outcome = self.bench("--summary", "b.json", *words, **how)
        return program.read_json(self.folder / "b.json"), outcome

    def check_numbers(self, row):
        self.assertTrue(0 < row["seconds_least"] <= row["seconds_per_step"] <= row["seconds_most"], row)
        self.assertAlmostEqual(row["matmults_per_step"], row["seconds_per_step"] / row["matmult_seconds"], delta=1e-9 * row["matmults_per_step"])
        for key in ("seconds_setup", "seconds_stepping", "matmult_seconds", "peak_rss_bytes", "bytes_per_unknown"):
            self.assertGreater(row[key], 0, key)
        self.assertLess(row["max_residual"], 1e-10)
        self.assertEqual(sum(row["rungs"].values()), row["steps"])

    def test_what_it_writes(self):
        found, outcome = self.summary()
        self.check_numbers(found)
        said = {key: found[key] for key in "exit status ranks warmup count repeats steps h unknowns constraints form snes_type".split()}
        self.assertEqual(said, {"exit": 0, "status": "done", "ranks": 1, "warmup": 3, "count": 20, "repeats": 1, "steps": 20, "h": 0.01,
                                "unknowns": 5, "constraints": 1, "form": "box on z", "snes_type": "vinewtonrsls"})  # fmt: skip
        self.assertEqual((found["predictor_hits"], found["snes_iterations"], found["unused_options"]), (20, 0, []))
        self.assertNotIn("runs", found)
        info = program.run("info").out
        self.assertIn(found["blas"], info)
        self.assertIn(f"BLAS {found['blas']}\n", outcome.out)
        for line in ("5 unknowns (box on z), 1 constraint, 1 rank", "3 steps of 0.01 s to warm up, 20 to time, 1 round",
                     "MatMults per step", "contacts changed per step", "bytes per unknown"):  # fmt: skip
            self.assertIn(line, outcome.out)
        self.assertEqual(sorted(program.content(self.folder)), ["b.json"])

    def test_counts_are_those_of_the_timed_steps(self):
        # All steps, against a run of all steps; then the part in which the one contact closes, at 4.345 s, and opens, at 6.1996 s.
        run = program.run("run", PAPER65, "--summary", "r.json", cwd=self.folder)
        self.assertEqual(run.code, 0, run)
        whole = program.read_json(self.folder / "r.json")
        found, _ = self.summary("--warmup", 0, "--count", whole["steps"])
        for key in "steps unknowns jacobian_nonzeros snes_iterations predictor_hits linear_solves active_changes rungs max_residual".split():
            self.assertEqual(found[key], whole[key], key)
        self.assertEqual(found["contact_changes"], 2 / whole["steps"])
        found, _ = self.summary("--warmup", 430, "--count", 10)
        self.assertEqual((found["contact_changes"], found["contact_changes_least"], found["active_changes"]), (0.1, 0, 1))
        found, _ = self.summary("--warmup", 500, "--count", 10)
        self.assertEqual((found["contact_changes"], found["closed_contacts"]), (0, 1))
        found, _ = self.summary("--warmup", 610, "--count", 20)
        self.assertEqual(found["active_changes"], 1)

    def test_bounces_count_twice(self):
        # A ball bounces at sqrt(2), ...: hit in one step, gone in the next.
        ball = program.SOURCE / "examples" / "ball" / "scene.toml"
        found, _ = self.summary("--warmup", 0, "--count", 400, scene=ball)
        run = program.run("run", ball, "-o", "b.h5", "--summary", "r.json", "--set", "time.end=2.0", cwd=self.folder)
        self.assertEqual(run.code, 0, run)
        whole = program.read_json(self.folder / "r.json")
        self.assertEqual(whole["steps"], 400)
        self.assertEqual(found["active_changes"], whole["active_changes"])
        self.assertEqual(found["contact_changes"], whole["active_changes"] / 400)

    def test_settings_side_by_side(self):
        (self.folder / "settings.toml").write_text(SETTINGS)
        found, outcome = self.summary("--settings", "settings.toml", "--count", 5, "-no_such_option", code=3)
        rows = {row["setting"]: row for row in found["runs"]}
        self.assertEqual(list(rows), ["ours", "bare", "strict", "other step"])
        self.assertEqual((found["exit"], found["setting"], found["repeats"]), (3, "ours", 3))
        self.assertEqual(found["unused_options"], ["-no_such_option"])
        for name in ("ours", "bare", "other step"):
            self.assertEqual((rows[name]["status"], rows[name]["steps"]), ("done", 5))
            self.check_numbers(rows[name])
        self.assertEqual((rows["ours"]["predictor_hits"], rows["bare"]["predictor_hits"]), (5, 0))
        self.assertEqual((rows["ours"]["snes_iterations"], rows["bare"]["snes_iterations"]), (0, 5))
        self.assertIsNone(rows["ours"]["states_differ"])
        self.assertLess(rows["bare"]["states_differ"], 1e-14)
        self.assertEqual(rows["strict"]["status"], "failed")
        self.assertRegex(rows["strict"]["failure"], r"^step 1, t = 0.01 s: the step could not be certified")
        self.assertIsNone(rows["strict"]["seconds_per_step"])
        self.assertIn("1 of 4 settings failed; the table says why", outcome.err)
        self.assertIn("strict failed: step 1", outcome.out)
        table = outcome.out.split("\n\n")[1].splitlines()
        table = table[: next(i for i, line in enumerate(table) if line.startswith("strict failed"))]
        self.assertEqual(len({len(line) for line in table}), 1, "columns are not aligned")
        self.assertTrue(any(line.startswith("  times the first") for line in table))
        # The command line wins over a setting, and a setting leaves nothing behind.
        found, _ = self.summary("--settings", "settings.toml", "--count", 5, "--repeats", 2, "-sweepvi_certificate_rtol", "1e-10",
                                "-sweepvi_target_rtol", "1e-14", "-sweepvi_predictor", "active-set")  # fmt: skip
        self.assertEqual([(row["status"], row["predictor_hits"]) for row in found["runs"]], [("done", 5)] * 4)

    def test_ranks(self):
        words = ["--count", 10, "--set", "model.count=300"]
        alone, _ = self.summary(*words, scene=SCALING / "jerk.toml")
        both, outcome = self.summary(*words, scene=SCALING / "jerk.toml", ranks=2)
        self.assertEqual((both["ranks"], both["edge_cut"]), (2, 1))
        self.assertEqual(outcome.out.count("MatMults per step"), 1)
        self.assertGreater(alone["contact_changes"], 0)
        for key in "contact_changes contact_changes_least closed_contacts unknowns constraints predictor_hits jacobian_nonzeros".split():
            self.assertEqual(both[key], alone[key], key)

    def test_a_column_is_solved_along_its_path(self):
        """Contacts that push each other: without a factorization, and as SNESVI alone solves them."""
        (self.folder / "settings.toml").write_text("""
            [[setting]]
            name = "ours"
            [[setting]]
            name = "bare"
            options = "-sweepvi_predictor none"
            [[setting]]
            name = "sets"
            options = "-sweepvi_predictor active-set"
            """)
        for scheme in ("homsp", "moreau-jean"):
            words = ["--count", 10, "--set", "model.count=100", "--set", f"time.scheme='{scheme}'"]
            found, _ = self.summary(*words, "--settings", "settings.toml", "--repeats", 1, scene=SCALING / "contact.toml")
            ours, bare, sets = found["runs"]
            self.assertEqual([row["status"] for row in found["runs"]], ["done"] * 3)
            self.assertEqual(bare["predictor_hits"], 0)
            self.assertGreater(sets["factorizations"], 0)
            self.assertLess(max(bare["states_differ"], sets["states_differ"]), 1e-12)
            for row in (ours, *(self.summary(*words, scene=SCALING / "contact.toml", ranks=ranks)[0] for ranks in (2, 3))):
                self.assertEqual((row["predictor_hits"], row["factorizations"], row["snes_iterations"]), (10, 0, 0))
                self.assertGreater(row["contact_changes_least"], 0)

    def test_contacts_change_in_every_step(self):
        """At any time after a few steps. Phases are spread evenly, so a few hundred elements show it as well as all."""

        def changes(case):
            name, warmup = case
            with program.temporary_folder() as folder:
                words = ["--set", f"model.count={SIZE}", *(SHAPED if name == "lattice" else [])]
                outcome = program.run("bench", SCALING / f"{name}.toml", "--warmup", warmup, "--count", 40, *words, "--summary", "b.json", cwd=folder, timeout=100)
                return outcome, program.read_json(Path(folder) / "b.json") if outcome.code == 0 else None

        cases = [(name, warmup) for name in SCENES for warmup in (10, 100)]
        for case, (outcome, found) in zip(cases, program.run_all(changes, cases)):
            with self.subTest(case):
                self.assertEqual(outcome.code, 0, outcome)
                # Hundreds at N = 1e5. The leanest, flexible after ten steps, has one in 500; all others one in 100 and more.
                self.assertGreater(found["contact_changes"], SIZE / (800 if case == ("flexible", 10) else 200), case)
                self.assertTrue(0 < found["closed_contacts"] < found["constraints"])

    def test_stops_in_order(self):
        found, outcome = self.summary("--wall-limit", 0, code=4)
        self.assertEqual((found["status"], found["exit"], found["steps"], found["seconds_per_step"]), ("stopped", 4, 0, None))
        self.assertIn("stopped by --wall-limit 0", outcome.err)

    def test_a_failure_is_told(self):
        found, outcome = self.summary(*STRICT.split(), code=3)
        self.assertEqual((found["status"], found["exit"]), ("failed", 3))
        self.assertIn("sweepvi: step 1, t = 0.01 s: the step could not be certified", outcome.err)

    def test_what_it_refuses(self):
        (self.folder / "settings.toml").write_text('[[setting]]\nname = "a"\n[[setting]]\nname = "b"\noptions = "-snes_type no"\n')
        (self.folder / "none.toml").write_text('[[setting]]\nname = "a"\nschemes = "hybrid"\n')
        cases = [
            (["--count", "1000"], "the scene has 1000 steps; --warmup 3 and --count 1000 need 1003. Take fewer, or --set time.end=10.03", 2),
            (["--set", "time.scheme=hybrid"], "has no steps to time; use 'sweepvi study'", 2),
            (["--settings", "settings.toml"], "SNES type no", 2),
            (["--settings", "none.toml"], "no setting of --settings goes with the scheme homsp", 2),
            (["--summary", "no/folder.json"], "there is no folder no", 5),
            (["--set", "time.stpe=1"], "did you mean 'step'?", 2),
        ]
        before = program.content(self.folder)
        outcomes = program.run_all(lambda case: program.run("bench", PAPER65, *case[0], cwd=self.folder, env=program.SLOW_UNWINDER), cases)
        for outcome, (_, message, code) in zip(outcomes, cases):
            with self.subTest(message):
                self.assertEqual((outcome.code, outcome.out), (code, ""), outcome)
                self.assertIn(message, outcome.err)
        self.assertEqual(program.content(self.folder), before)

    def test_help_with_a_scene(self):
        self.assertIn("-sweepvi_certificate_rtol", self.bench("-help").out)
        self.assertEqual(program.content(self.folder), {})


if __name__ == "__main__":
    unittest.main()
