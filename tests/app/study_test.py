# ranks: 2
# timeout: 120
"""`sweepvi study` on AB (65): errors of an independent implementation, orders, settings, failures, refusals."""

import csv
import math
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program

SCENE = program.SOURCE / "examples" / "paper65" / "scene.toml"
REGULATOR = program.SOURCE / "examples" / "zi_regulator" / "scene.toml"  # hybrid takes no controller
REFERENCE = {round(row["h"], 9): row for row in program.read_json(program.SOURCE / "tests" / "reference" / "order65.json")}
STEPS = [1e-1, 1e-2, 1e-3]
DIGITS = 1e-6  # final errors: the same scheme, written independently, agrees to 1e-8; the hybrid reference is exact to 1e-12
GRAPHS = 2e-3  # Hausdorff distances: three digits are computed, and the polylines' own error is up to h^2/8 |x''|
THETAS = """
[[setting]]
name    = "1"
schemes = "homsp"
[[setting]]
name    = "1/2"
set     = "time.theta=0.5 model.x0=[1,0,0,0,0]"
options = "-sweepvi_predictor none"
schemes = "homsp,moreau-jean"
[[setting]]
name    = "series"
schemes = "hybrid"
"""
SETTINGS = """
[[setting]]
name = "semismooth, \\"bare\\""
options = "-sweepvi_predictor none -snes_type vinewtonssls"
[[setting]]
name = "strict"
options = "-sweepvi_certificate_rtol 1e-30 -sweepvi_target_rtol 1e-40 -sweepvi_halvings 0 -no_such_option"
[[setting]]
name = "default"
"""


class Study(unittest.TestCase):
    def setUp(self):
        folder = program.temporary_folder()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def study(self, *words, code=0, scene=SCENE, ranks=1):
        outcome = program.run("study", scene, *words, cwd=self.folder, ranks=ranks, timeout=60)
        self.assertEqual(outcome.code, code, outcome)
        return outcome

    def runs(self, *words, repeats=1, **how):
        """The rows of the summary, and all of it; the CSV file must say the same."""
        outcome = self.study("--repeats", repeats, "--csv", "rows.csv", "--summary", "rows.json", *words, **how)
        summary = program.read_json(self.folder / "rows.json")
        with open(self.folder / "rows.csv", newline="") as file:
            table = list(csv.DictReader(file))
        self.assertEqual(len(table), len(summary["runs"]))
        for line, row in zip(table, summary["runs"]):
            self.assertEqual(list(line), list(row))
            for key, text in line.items():
                value = float(text) if isinstance(row[key], (int, float)) else text
                self.assertEqual(value, row[key] if row[key] is not None else "", key)
        return summary["runs"], summary, outcome

    def check_final_errors(self, rows):
        for row in rows:
            self.assertLess(abs(row["final"] / REFERENCE[row["h"]]["final_2"] - 1), DIGITS, row)

    def test_errors_and_orders(self):
        rows, summary, outcome = self.runs("--steps", "1e-1,1e-2,1e-3", repeats=2)
        self.assertEqual([row["h"] for row in rows], STEPS)
        self.assertEqual((summary["status"], summary["components"], summary["repeats"], summary["unused_options"]), ("done", 5, 2, []))
        self.assertIn("reference: hybrid, tolerance 1e-12, h = 0.001 s", outcome.out)
        self.assertEqual(summary["reference"], "hybrid, tolerance 1e-12, h = 0.001 s")
        self.check_final_errors(rows)
        for row in rows:
            # The largest distance of the full states is at the end of the run.
            self.assertLess(abs(row["hausdorff"] / row["final"] - 1), GRAPHS, row)
            self.assertLess(row["events"], 2 * row["h"], "both events are found within two steps")
            self.assertEqual((row["status"], row["failure"], row["events_unmatched"]), ("done", None, 0))
            self.assertEqual(row["steps"], round(10 / row["h"]))
            self.assertEqual(row["linear_solves"], 0, "five states are one block, solved without a factorization")
            self.assertTrue(0 < row["seconds_min"] <= row["seconds"] <= row["seconds_max"], row)
            self.assertGreater(row["matmults_per_step"], 1)
        self.assertIsNone(rows[0]["final_order"])
        for last, row in zip(rows, rows[1:]):
            self.assertAlmostEqual(row["final_order"], math.log10(last["final"] / row["final"]), 12)
            for order in (row["final_order"], row["hausdorff_order"]):
                self.assertTrue(0.93 < order < 1.03, row)  # first order; 0.956 from 1e-1, where h is not yet small
        lines = outcome.out.splitlines()
        self.assertEqual(len({len(line) for line in lines[3:]}), 1, "columns are not aligned")
        self.assertEqual(sorted(program.content(self.folder)), ["rows.csv", "rows.json"])

    def test_outputs_without_the_rest(self):
        rows, summary, _ = self.runs("--steps", "1e-2,1e-3", "--components", "0,1,2")
        self.assertEqual(summary["components"], 3)
        for row in rows:
            self.assertLess(abs(row["hausdorff"] / REFERENCE[row["h"]]["haus_z"] - 1), GRAPHS, row)

    def test_two_ranks(self):
        words = ["--steps", "1e-1,3e-2", "--components", "1,4"]
        alone, _, _ = self.runs(*words)
        both, summary, _ = self.runs(*words, ranks=2)
        self.assertEqual((summary["components"], summary["ranks"]), (2, 2))
        for one, two in zip(alone, both):
            for key in ("final", "hausdorff", "sup", "l1", "events"):
                self.assertLess(abs(one[key] - two[key]), 1e-9 * one[key], key)  # rounding of up to 333 steps
            self.assertEqual(one["steps"], two["steps"])

    def test_settings_stay_apart_and_a_run_that_fails_is_a_row(self):
        (self.folder / "settings.toml").write_text(SETTINGS)
        words = ["--steps", "1e-1,5e-2", "--settings", "settings.toml"]
        rows, summary, outcome = self.runs(*words, code=3)
        by_name = {}
        for row in rows:
            by_name.setdefault(row["setting"], []).append(row)
        self.assertEqual(list(by_name), ['semismooth, "bare"', "strict", "default"])
        for row in by_name["strict"]:
            self.assertEqual((row["status"], row["final"], row["seconds"]), ("failed", None, None))
            self.assertRegex(row["failure"], r"^step \d+, t = \S+ s: the step could not be certified")
        self.assertIn("2 of 6 runs failed", outcome.err)
        self.assertEqual((summary["status"], summary["exit"], summary["unused_options"]), ("failed", 3, ["-no_such_option"]))
        self.check_final_errors([by_name["default"][0], by_name['semismooth, "bare"'][0]])
        for row in by_name["default"]:  # the predictor is right in each step, as it is without other settings
            self.assertEqual(row["newton_iterations"], 0)
        for row in by_name['semismooth, "bare"']:
            self.assertGreaterEqual(row["newton_iterations"], row["steps"])
        # The command line wins over every setting.
        rows, _, _ = self.runs(*words, "-sweepvi_certificate_rtol", "1e-10", "-sweepvi_target_rtol", "1e-14", "-snes_type", "vinewtonrsls",
                               "-sweepvi_predictor", "active-set")
        self.assertEqual([(row["status"], row["newton_iterations"]) for row in rows], [("done", 0)] * 6)

    def test_settings_of_the_scene(self):
        (self.folder / "settings.toml").write_text(THETAS)
        words = ["--schemes", "homsp,hybrid", "--steps", "1e-1,2.5e-2", "--settings", "settings.toml"]
        rows, _, _ = self.runs(*words)
        self.assertEqual([(row["scheme"], row["setting"]) for row in rows],
                         [("homsp", "1")] * 2 + [("homsp", "1/2")] * 2 + [("hybrid", "series")] * 2)
        self.assertEqual(rows[2]["options"], "--set time.theta=0.5 --set model.x0=[1,0,0,0,0] -sweepvi_predictor none")
        self.check_final_errors(rows[:1])
        # Of an independent program with theta = 1/2 (84.9 h^2 at 1e-1); order 2, within what the events' places do.
        self.assertLess(abs(rows[2]["final"] / 8.486e-3 - 1), 1e-3)
        self.assertTrue(1.85 < rows[3]["final_order"] < 2.15, rows[3])
        # The command line wins.
        rows, _, _ = self.runs(*words, "--set", "time.theta=1")
        self.assertLess(abs(rows[2]["final"] - rows[0]["final"]), 1e-12)  # found by SNES, and by the predictor

    def test_hybrid_takes_tolerances(self):
        rows, _, _ = self.runs("--schemes", "homsp,hybrid", "--steps", "1e-1", "--tolerances", "1e-3,1e-9", "--reference", "1e-2")
        self.assertEqual([(row["scheme"], row["tolerance"]) for row in rows], [("homsp", None), ("hybrid", 1e-3), ("hybrid", 1e-9)])
        self.assertEqual([row["final_order"] for row in rows], [None] * 3)
        # The reference is off by its own error, which is all that the hybrid runs differ from it by.
        for row in rows[1:]:
            self.assertLess(abs(row["final"] / REFERENCE[1e-2]["final_2"] - 1), 1e-2, row)
        rows, _, _ = self.runs("--schemes", "hybrid", "--tolerances", "1e-3,1e-9", "--set", "time.step=0.1")
        self.assertLess(rows[1]["events"], rows[0]["events"])
        self.assertLess(rows[1]["events"], 1e-9)

    def test_references(self):
        rows, summary, _ = self.runs("--steps", "1e-2", "--set", "time.end=1", scene=REGULATOR)
        self.assertRegex(summary["reference"], r"^zhuravlev-ivanov, h = 0\.001 s \(not hybrid: .*regulator")
        self.assertGreater(rows[0]["sup"], 0)
        run = program.run("run", SCENE, "-o", "h.h5", "--set", "time.scheme=hybrid", "--set", "time.tolerance=1e-12", cwd=self.folder)
        self.assertEqual(run.code, 0, run)
        rows, summary, _ = self.runs("--steps", "1e-1", "--reference", "h.h5")
        self.assertEqual(summary["reference"], "h.h5, 1005 rows")  # 1000 intervals, and two rows at each event
        self.check_final_errors(rows)
        (self.folder / "end.csv").write_text("t,a,b,c,d,e\n0,1,0,0,0,0\n10,0,0,0,0,0\n")
        rows, _, _ = self.runs("--steps", "1e-1", "--reference", "end.csv")
        self.assertIsNone(rows[0]["events"])
        # No step passes: there is neither a run nor a reference.
        strict = ["-sweepvi_certificate_rtol", "1e-30", "-sweepvi_target_rtol", "1e-40", "-sweepvi_halvings", "0"]
        outcome = self.study("--steps", "1e-1", "--reference", "1", *strict, code=3)
        # Unless one is solved to the last bit.
        self.assertRegex(outcome.err, r"there is no reference: homsp with h = 1 s failed: step ([12]), t = \1 s")

    def test_what_it_refuses(self):
        def settings(text):
            path = self.folder / f"settings{len(list(self.folder.iterdir()))}.toml"
            path.write_text(text)
            return ["--steps", "1", "--settings", path]

        (self.folder / "two.csv").write_text("t,a,b\n0,1,2\n")
        cases = [
            (["--steps", "1", "--schemes", "homps"], "no scheme 'homps'; did you mean 'homsp'?", 2),
            (["--steps", "1", "--schemes", "homsp,moreau-jean"], '"moreau-jean" does not fit this model', 2),
            (["--steps", "1", "--components", "5"], "has no column 5; its columns are 0 to 4", 2),
            (["--steps", "1", "--reference", "none.h5"], "none.h5: there is no such file", 2),
            (["--steps", "1", "--reference", "two.csv"], "states of 5 numbers, two.csv of 2", 2),
            (["--steps", "1", "--reference", "-1"], "--reference -1: a step is above 0", 2),
            (["--steps", "1", "--tolerances", "1e-3"], "--tolerances goes with the scheme hybrid", 2),
            (["--schemes", "homsp,hybrid", "--tolerances", "1e-3"], "the other schemes need --steps", 2),
            (["--steps", "1", "-snes_type", "newtonls"], "newtonls does not solve box VIs", 2),
            (["--steps", "1", "--csv", "two.csv", "--summary", "two.csv"], "the same file", 2),
            (["--steps", "1", "--csv", "no/folder.csv"], "there is no folder no", 5),
            (settings(""), "setting is missing", 2),
            (settings('[[setting]]\nname = "a"\noption = ""\n'), "no key 'option'; did you mean 'options'?", 2),
            (settings('[[setting]]\noptions = ""\n'), "name is missing", 2),
            (settings('[[setting]]\nname = "a"\n[[setting]]\nname = "a"\n'), '= "a" is there twice', 2),
            (settings('[[setting]]\nname = "a"\noptions = "pc_type lu"\n'), "does not start with an option", 2),
            (settings('[[setting]]\nname = "a"\n[[setting]]\nname = "b"\noptions = "-snes_type no"\n'), "SNES type no", 2),
            (settings('[[setting]]\nname = "a"\nset = "time.theta"\n'), "expected key=value", 2),
            (settings('[[setting]]\nname = "a"\nset = "time.step=1"\n'), "has 'time.step=1'; the command line says that, for all settings", 2),
            (settings('[[setting]]\nname = "a"\nset = "time.tetha=1"\n'), "did you mean 'theta'?", 2),
            (settings('[[setting]]\nname = "a"\nschemes = "hybird"\n'), "no scheme 'hybird'; did you mean 'hybrid'?", 2),
            (settings('[[setting]]\nname = "a"\nschemes = "hybrid"\n'), "no setting of --settings goes with", 2),
        ]
        before = program.content(self.folder)
        outcomes = program.run_all(lambda case: program.run("study", SCENE, *case[0], cwd=self.folder, env=program.SLOW_UNWINDER), cases)
        for outcome, (_, message, code) in zip(outcomes, cases):
            with self.subTest(message):
                self.assertEqual((outcome.code, outcome.out), (code, ""), outcome)
                self.assertIn(message, outcome.err)
        self.assertEqual(program.content(self.folder), before)

    def test_shipped_settings_and_the_picture(self):
        rows, _, _ = self.runs("--steps", "1e-1,5e-2", "--settings", program.SOURCE / "examples" / "studies" / "settings.toml")
        self.assertEqual([row["setting"] for row in rows[::2]], ["default", "reduced space", "semismooth"])
        for row, first in zip(rows[2:], rows[:2] * 2):
            self.assertLess(abs(row["final"] - first["final"]), 1e-10)
        plot = program.subprocess.run([sys.executable, program.SOURCE / "scripts" / "plot", "rows.csv"], cwd=self.folder,
                                      capture_output=True, text=True, check=False, timeout=60)
        self.assertEqual((plot.returncode, plot.stdout), (0, "./rows.png\n"), plot.stderr)
        self.assertEqual((self.folder / "rows.png").read_bytes()[:4], b"\x89PNG")


if __name__ == "__main__":
    unittest.main()
