# ranks: 1
# timeout: 240
"""The program from outside, as contract.md (and the README) promise it: texts and options. Files and exit codes: program_*_test.py."""

import os
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program
from in_folder import BALL, InFolder, read_file


class Texts(InFolder):
    def test_general_help(self):
        texts = [self.sweepvi(*words).out for words in ([], ["help"], ["-h"], ["--help"], ["-help"])]
        for text in texts:
            self.assertEqual(text, texts[0], "the ways to ask for help differ")
        for verb in "run check solve study compare bench info help".split():
            self.assertRegex(texts[0], rf"\b{verb}\b")
        for code in range(6):
            self.assertRegex(texts[0], rf"(?m)^ *{code}  \w", f"exit code {code} is not explained")

    def test_help_on_a_verb(self):
        words = {"run": "-o --set --summary --force -ts_dt", "check": "--set", "solve": "-o --summary --force"}
        words["compare"] = "--components --tolerance --summary"
        words["study"] = "--steps --schemes --tolerances --settings --reference --repeats --csv --summary --components"
        words["bench"] = "--warmup --count --repeats --settings --wall-limit --summary --set -ts_dt"
        for verb, options in words.items():
            with self.subTest(verb):
                text = self.sweepvi("help", verb).out
                self.assertEqual(text, self.sweepvi(verb, "--help").out, "two ways to ask, two answers")
                for option in options.split():
                    self.assertIn(f"  {option} ", text)

    def test_help_with_a_scene_lists_our_options_and_takes_no_step(self):
        scene = self.write(BALL)
        for words in (["run", scene, "-help"], ["help", "run", scene], ["check", scene, "-h"]):
            with self.subTest(words):
                text = self.sweepvi(*words).out
                line = next(line for line in text.splitlines() if "-sweepvi_certificate_rtol" in line)
                self.assertRegex(line, r"<1e-10 : 1e-10>: \w.*\[-\]", "default, text and unit")
                self.assertEqual(self.files(), [scene])

    def test_versions(self):
        text = self.sweepvi("--version").out
        self.assertEqual(text, self.sweepvi("info").out)
        for name in "sweepvi PETSc MUMPS METIS HDF5 MPI BLAS sandbox".split():
            self.assertRegex(text, rf"(?m)^{name} +\S")
        self.assertRegex(text, r"\(.*(Release|Debug|RelWithDebInfo|MinSizeRel).*\)", "the build type")
        self.assertRegex(text, r"BLAS .*\b1\b", "the threads of BLAS")

    def test_one_rank_prints(self):
        for words in (["--version"], ["help"], ["check", self.write(BALL)]):
            with self.subTest(words):
                texts = [self.sweepvi(*words, ranks=ranks).out for ranks in (1, 2)]
                lines = [line for line in texts[1].splitlines() if line]
                self.assertEqual(len(set(lines)), len(lines), f"a line appears twice\n{texts[1]}")
                self.assertEqual(texts[0].splitlines()[0], lines[0])

    def test_closed_pipe(self):
        """`sweepvi run ... | head -1` is no crash."""
        reading, writing = os.pipe()
        os.close(reading)
        outcome = program.run("run", self.write(BALL), "-help", cwd=self.folder, out=writing)
        os.close(writing)
        for noise in ("PETSC ERROR", "MPI_ABORT"):
            self.assertNotIn(noise, outcome.err, outcome)


class Options(InFolder):
    def steps(self, *words):
        return self.simulate(BALL, *words)[2]["steps"]

    def test_set_overrides_the_scene(self):
        self.assertEqual(self.steps(), 20)
        self.assertEqual(self.steps("--set", "time.step=0.2"), 10)
        self.assertEqual(self.steps("--set=time.step=0.2", "--set", "time.end=1"), 5)
        self.assertEqual(self.steps("-ts_dt", "0.2", "-ts_max_time", "1"), 5)
        self.assertEqual(self.steps("-ts_dt", ".2", "--set", "time.step=2e-1"), 10, "the same said twice")

    def test_set_takes_strings_tables_and_new_keys(self):
        _, attributes, _ = self.simulate(BALL, "--set", "time.scheme=zd-euler", "--set", "title=a = b")
        self.assertEqual((attributes["scheme"], attributes["title"]), ("zd-euler", "a = b"))
        arrays, _, _ = self.simulate(BALL, "--set", "model.x0=[3, 0]", "--set", "output.every=5")
        np.testing.assert_allclose(arrays["x"][0], [3, 0])
        self.assertEqual(len(arrays["t"]), 5)

    def snes_type(self, scene="", *words, env=""):
        text = BALL + (f'[petsc]\noptions = "-snes_type {scene}"\n' if scene else "")
        env = {"PETSC_OPTIONS": f"-snes_type {env}"} if env else {}
        return self.simulate(text, *words, env=env)[2]["snes_type"]

    def test_what_wins(self):
        """Defaults, scene, rc file and PETSC_OPTIONS, --set, command line: later over earlier."""
        one, other = "vinewtonrsls", "vinewtonssls"
        here = ["-snes_type", other]
        by_set = ["--set", f"petsc.options=-snes_type {other}"]
        self.assertEqual(self.snes_type(), one, "the default")
        self.assertEqual(self.snes_type(other), other, "the scene over the default")
        self.assertEqual(self.snes_type(one, env=other), other, "PETSC_OPTIONS over the scene")
        self.assertEqual(self.snes_type("", *by_set, env=one), other, "--set over PETSC_OPTIONS")
        self.assertEqual(self.snes_type(one, *by_set), other, "--set over the scene")
        self.assertEqual(self.snes_type(one, *here, env=one), other, "the command line over all")
        self.assertEqual(self.snes_type("", *here, "--set", f"petsc.options=-snes_type {one}"), other, "over --set")
        self.write(f"-snes_type {other}\n", ".petscrc")
        self.assertEqual(self.snes_type(one), one, "an rc file that lies about counts for nothing")
        named = ["-sweepvi_petscrc", ".petscrc"]
        self.assertEqual(self.snes_type(one, *named), other, "the rc file over the scene")
        self.assertEqual(self.snes_type("", *named, env=one), one, "PETSC_OPTIONS over the rc file")

    def test_options_of_the_run_are_recorded(self):
        _, attributes, _ = self.simulate(BALL, "-snes_type", "vinewtonssls", env={"PETSC_OPTIONS": "-snes_max_it 77"})
        self.assertIn("-snes_type vinewtonssls", attributes["options"])
        self.assertIn("-snes_max_it 77", attributes["options"])

    def test_unused_options(self):
        scene = self.write(BALL)
        problem = self.write("[problem]\nM = [[1]]\nq = [-1]\n", "problem.toml")
        for ranks in (1, 2):
            for words in (["run", scene], ["check", scene], ["solve", problem]):
                with self.subTest(words, ranks=ranks):
                    summary = [] if words[0] == "check" else ["--summary", "s.json", "--force"]
                    outcome = self.sweepvi(*words, "-snes_tpye", "x", *summary, ranks=ranks)
                    self.assertEqual(outcome.err.count("-snes_tpye"), 1, outcome)
                    self.assertIn("did you mean '-snes_type'?", outcome.err)
                    if summary:
                        self.assertEqual(program.read_json(self.folder / "s.json")["unused_options"], ["-snes_tpye"])

    def test_used_options_are_not_reported(self):
        scene = self.write(BALL + '[petsc]\noptions = "-snes_max_it 50"\n')
        words = ["-log_view", ":log.txt", "-malloc_dump", "-options_left", "no", "-ts_monitor", ":ts.txt"]
        outcome = self.sweepvi("run", scene, *words, "-sweepvi_certificate_rtol", "1e-9")
        self.assertEqual(outcome.err, "", outcome)

    def test_counters_with_and_without_the_log(self):
        """Factorizations are counted by us, or by PETSc's log where that is asked for, also by the scene."""
        self.write(BALL)
        self.write(BALL + '[petsc]\noptions = "-log_view"\n', "logged.toml")
        counts = set()
        for words in (["scene.toml"], ["scene.toml", "-log_view"], ["logged.toml"]):
            outcome = self.sweepvi("run", *words, "-sweepvi_predictor", "none", "--summary", "s.json", "--force")
            self.assertEqual(outcome.code, 0, outcome)
            self.assertEqual("SweepviJudge" in outcome.out, words != ["scene.toml"], outcome)
            summary = program.read_json(self.folder / "s.json")
            counts.add((summary["factorizations"], summary["linear_solves"], summary["snes_iterations"]))
        self.assertEqual(len(counts), 1, counts)
        self.assertGreater(min(counts.pop()), 0)

    def test_steps_are_not_cut_short(self):
        """-ts_max_steps 3 of 20: exit 0 and `done` would say that the scene was run to its end."""
        self.write(BALL)
        outcome = program.run("run", "scene.toml", "-ts_max_steps", "3", cwd=self.folder)
        if outcome.code == 0:
            arrays, attributes = read_file(self.folder / "scene.h5")
            self.assertEqual((len(arrays["t"]), attributes["status"]), (21, "done"), outcome)
        else:
            self.assertEqual(outcome.code, 2, outcome)

    def test_time_options_of_the_environment_are_not_dropped_silently(self):
        """PETSc reads -ts_dt from PETSC_OPTIONS and [petsc] options alike: it acts, or it is refused, or reported."""
        scene = self.write(BALL + '[petsc]\noptions = "-ts_dt 0.2"\n')
        for env, text in (({}, scene), ({"PETSC_OPTIONS": "-ts_dt 0.2"}, self.write(BALL, "plain.toml"))):
            with self.subTest(text):
                outcome = program.run("run", text, "--summary", "s.json", "--force", cwd=self.folder, env=env)
                acted = outcome.code == 0 and program.read_json(self.folder / "s.json")["steps"] == 10
                self.assertTrue(acted or outcome.code == 2 or "-ts_dt" in outcome.err, f"-ts_dt 0.2 had no effect\n{outcome}")


if __name__ == "__main__":
    unittest.main()
