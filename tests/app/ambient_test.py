# ranks: 1
# timeout: 100
"""What lies about, in the working directory, the home folder or the environment, changes nothing and loads nothing."""

import os
import shutil
import subprocess
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program
from output_files_test import PROBLEM, SCENE

CODE = """#include <stdio.h>
__attribute__((constructor)) static void loaded(void) { FILE* f = fopen("%s", "w"); if (f) fclose(f); }
int make(void) { return 1; }
"""


class Ambient(unittest.TestCase):
    def setUp(self):
        temporary = program.temporary_folder()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)
        (self.folder / "scene.toml").write_text(SCENE)
        (self.folder / "problem.toml").write_text(PROBLEM)
        (self.folder / "files.json").write_text("{}")
        self.mark, self.library = self.folder / "loaded", self.folder / "own.so"
        compiler = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
        if compiler is None:
            self.skipTest("there is no C compiler")
        (self.folder / "own.c").write_text(CODE % self.mark)
        subprocess.run([compiler, "-shared", "-fPIC", "-o", self.library, self.folder / "own.c"], check=True)

    def run_(self, *words, **how):
        return program.run(*words, cwd=self.folder, **how)

    def harmless(self, outcome, what):
        self.assertFalse(self.mark.exists(), f"{what}: code was loaded: {outcome}")

    def test_files_that_petsc_would_read(self):
        home = self.folder / "home"
        home.mkdir()
        verbs = (["info"], ["check", "scene.toml"], ["run", "scene.toml", "--force"], ["solve", "problem.toml", "--force"],
                 ["check", "scene.toml", "--confine", "files.json"])
        for name in (".petscrc", "petscrc", "home/.petscrc"):
            (self.folder / name).write_text(f"-dll_append {self.library}\n-left_about 1\n")
        for words in verbs:
            for ranks in (1, 2) if words[0] == "run" else (1,):
                outcome = self.run_(*words, ranks=ranks, env={"HOME": str(home), "PETSC_OPTIONS_YAML": f"dll_append: {self.library}"})
                self.assertEqual(outcome.code, 0, outcome)
                self.harmless(outcome, words)
                self.assertNotIn("left_about", outcome.err)
        # Asked for, they are read: below PETSC_OPTIONS and the command line.
        (self.folder / "own.rc").write_text("-left_about 1\n-sweepvi_certificate_rtol 1e-7\n")
        outcome = self.run_("run", "scene.toml", "--force", "-sweepvi_petscrc", "own.rc")
        self.assertEqual(outcome.code, 0, outcome)
        self.assertIn("-left_about was not used", outcome.err)
        self.assertNotIn("petscrc", outcome.err)
        outcome = self.run_("run", "scene.toml", "-sweepvi_petscrc", "nowhere.rc")
        self.assertEqual(outcome.code, 2, outcome)
        # It is the user's own word that loads what it names.
        self.run_("check", "scene.toml", "-dll_append", self.library)
        self.assertTrue(self.mark.exists(), "the test's library cannot be loaded: the others prove nothing")

    def test_the_environment(self):
        for options in (f"-dll_append {self.library}", f"-DLL-append {self.library}", f"-ksp_rtol 1 -dllprepend '{self.library}'",
                        f"-pc_type {self.library}:make", "-options_file .petscrc", "-prefix_push dll_ -append x", "-start_in_debugger"):
            outcome = self.run_("run", "scene.toml", "--force", env={"PETSC_OPTIONS": options})
            self.assertEqual(outcome.code, 2, outcome)
            self.assertIn("PETSC_OPTIONS", outcome.err)
            self.harmless(outcome, options)
            outcome = self.run_("run", "scene.toml", "--force", "--confine", "files.json", env={"PETSC_OPTIONS": options})
            self.assertEqual(outcome.code, 0, outcome)
            self.harmless(outcome, options)
        outcome = self.run_("run", "scene.toml", "--force", env={"PETSC_OPTIONS": "-left_about 1"})
        self.assertIn("-left_about was not used", outcome.err)

    def test_scenes(self):
        for options in (f"-dll_append {self.library}", f"-pc_type {self.library}:make", f"-snes_type {self.library}:make",
                        "-options_file own.rc", "-sweepvi_petscrc own.rc", f"-ksp_type ./own.so:make"):
            (self.folder / "evil.toml").write_text(SCENE + f'[petsc]\noptions = "{options}"\n')
            for words in (["check", "evil.toml"], ["run", "evil.toml", "--force"], ["run", "scene.toml", "--set", f'petsc.options="{options}"']):
                outcome = self.run_(*words)
                self.assertEqual(outcome.code, 2, outcome)
                self.assertIn("command line alone", outcome.err)
                self.harmless(outcome, options)

    def test_confined(self):
        """Refused before PETSc is started, which would act on it."""
        for words in (["-dll_append", self.library], ["-options_file", "own.rc"], ["-sweepvi_petscrc", "own.rc"],
                      ["-pc_type", f"{self.library}:make"], ["-start_in_debugger"], ["-log_view", ":stolen"]):
            (self.folder / "own.rc").write_text(f"-dll_append {self.library}\n")
            for verb in (["run", "scene.toml", "--force"], ["check", "scene.toml"], ["solve", "problem.toml", "--force"]):
                for ranks in (1, 2) if verb[0] == "run" else (1,):
                    outcome = self.run_(*verb, "--confine", "files.json", *words, ranks=ranks)
                    self.assertEqual(outcome.code, 2, outcome)
                    self.assertIn("may not be used here", outcome.err + "may not be used here" * ("needs a" in outcome.err))
                    self.harmless(outcome, words)
        self.assertFalse((self.folder / "stolen").exists())


if __name__ == "__main__":
    unittest.main()
