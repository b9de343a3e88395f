# ranks: 1
# timeout: 240
"""The program from outside, as contract.md (and the README) promise it: texts, options, files and exit codes."""

import os
import re
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program

BALL = """title = "falling ball"
[time]
end = 2.0                  # s; the ball lands at sqrt(2) s
step = 0.1
[model]
kind = "linear"            # q'' = -1 + lambda, w = q, plastic
A = [[0, 1], [0, 0]]
B = [[0], [1]]
C = [[1, 0]]
f = [0, -1]
x0 = [1, 0]
"""

CHAIN = """title = "short chain"
[time]
end = 6.0
step = 0.02
[model]
kind = "chain"
element = "jerk"
count = 5
coupling = 0.5
"""

ONE_STATE = """[time]
end = 1.0
step = 0.1
[model]
kind = "linear"
A = [[0]]
B = [[1]]
C = [[1]]
f = [-2]
x0 = [1]
"""

# The wall y' = 1 pushes x towards the wall at 1.05; from step 11, t = 1.1 s, nothing fits between them.
SQUEEZE = """title = "closing gap"
[time]
end = 2.0
step = 0.1
[model]
kind = "linear"            # w = (x - y, 1.05 - x)
A = [[0, 0], [0, 0]]
B = [[1, -1], [0, 0]]
C = [[1, -1], [-1, 0]]
w0 = [0, 1.05]
f = [0, 1]
x0 = [0.5, 0]
"""
SQUEEZED = 10  # steps that have a solution

TWO_WALLS = """[time]
end = 1.0
step = 0.1
[model]
kind = "linear"            # x' = 2 between 0 and 1.5: both constraints read and push the same state
A = [[0]]
B = [[1, -1]]
C = [[1], [-1]]
w0 = [0, 1.5]
f = [2]
x0 = [1]
"""

DATASETS = set(
    "t x w mu level events solver/iterations solver/seconds solver/residual solver/active".split()
)
ATTRIBUTES = set(
    "format_version title scene options sweepvi_version git_hash petsc_version mumps_version hdf5_version mpi_version"
    " ranks host scheme step started finished status".split()
)


def read_file(path):
    """Every dataset as an array, and the root attributes."""
    arrays = {}
    with h5py.File(path) as file:
        file.visititems(lambda name, item: arrays.update({name: item[()]} if isinstance(item, h5py.Dataset) else {}))
        return arrays, dict(file.attrs)


class InFolder(unittest.TestCase):
    """A working directory of its own for each test, with the scene in it."""

    def setUp(self):
        folder = program.temporary_folder()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def write(self, text, name="scene.toml"):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return name

    def sweepvi(self, *words, code=0, **how):
        how.setdefault("env", {})
        how["env"].setdefault("HOME", str(self.folder))  # no rc file but ours
        outcome = program.run(*words, cwd=self.folder, **how)
        self.assertEqual(outcome.code, code, outcome)
        self.assertNotIn("PETSC ERROR", outcome.err, outcome)
        return outcome

    def simulate(self, text, *words, name="run", code=0, **how):
        """Runs the scene; gives what the file, its root attributes and the summary say."""
        scene = self.write(text)
        files = ["-o", f"{name}.h5", "--summary", f"{name}.json", "--force"]
        self.sweepvi("run", scene, *files, *words, code=code, **how)
        arrays, attributes = read_file(self.folder / f"{name}.h5")
        return arrays, attributes, program.read_json(self.folder / f"{name}.json")

    def files(self):
        return sorted(program.content(self.folder))


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
        for name in "sweepvi PETSc MUMPS METIS HDF5 MPI BLAS".split():
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
        self.assertEqual(self.snes_type(one), other, "the rc file over the scene")
        self.assertEqual(self.snes_type("", env=one), one, "PETSC_OPTIONS over the rc file")

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


class Files(InFolder):
    def test_paths(self):
        """Command line: from the working directory; scene: from the scene; by default the stem, where we are."""
        scene = self.write(BALL, "below/ball.toml")
        self.sweepvi("run", scene)
        self.assertEqual(self.files(), ["ball.h5", scene])
        self.write(BALL + '[output]\nfile = "named.h5"\n', scene)
        self.sweepvi("run", scene)
        self.assertEqual(self.files(), ["ball.h5", scene, "below/named.h5"])
        self.sweepvi("run", scene, "--set", "output.file=other.h5", "--summary", "s.json")
        self.assertEqual(self.files(), ["ball.h5", scene, "below/named.h5", "other.h5", "s.json"])

    def test_force(self):
        scene = self.write(BALL)
        self.sweepvi("run", scene)
        before = program.content(self.folder)
        self.sweepvi("run", scene, code=5)
        self.sweepvi("run", scene, "--force", "-snes_type", "newtonls", code=2)
        self.assertEqual(program.content(self.folder), before, "a refused run touched the file")
        self.sweepvi("run", scene, "--force", "--set", "title=second")
        self.assertEqual(read_file(self.folder / "scene.h5")[1]["title"], "second")
        self.assertEqual(self.files(), ["scene.h5", scene])

    def test_the_scene_is_never_overwritten(self):
        for words in (["--summary", "scene.toml"], ["-o", "scene.toml", "--force"]):
            with self.subTest(words):
                outcome = program.run("run", self.write(BALL), *words, cwd=self.folder)
                self.assertIn(outcome.code, (2, 5), outcome)
                self.assertEqual((self.folder / "scene.toml").read_bytes(), BALL.encode(), "the scene is gone")

    def test_summary(self):
        for ranks in (1, 2):
            with self.subTest(ranks=ranks):
                arrays, _, summary = self.simulate(CHAIN, "-sweepvi_predictor", "active-set", ranks=ranks)
                self.assertEqual(program.SUMMARY_KEYS - summary.keys(), set(), "keys are missing")
                self.assertEqual((summary["exit"], summary["status"], summary["steps"]), (0, "done", 300))
                self.assertEqual((summary["ranks"], summary["unknowns"], summary["constraints"]), (ranks, 25, 5))
                self.assertEqual(summary["edge_cut"] > 0, ranks > 1)
                self.assertEqual(summary["snes_iterations"], arrays["solver/iterations"].sum())
                self.assertEqual(summary["max_residual"], arrays["solver/residual"].max())
                self.assertLessEqual(summary["max_residual"], 1e-10)
                self.assertEqual(summary["unused_options"], [])
                parts = summary["seconds_setup"] + summary["seconds_stepping"]
                self.assertTrue(0 < parts <= summary["seconds_total"], summary)
                per_step = summary["seconds_per_step"]
                self.assertAlmostEqual(per_step, summary["seconds_stepping"] / 300)
                self.assertAlmostEqual(summary["matmults_per_step"] / (per_step / summary["matmult_seconds"]), 1)
                for count in ("jacobian_nonzeros", "factorizations", "linear_solves", "peak_rss_bytes", "active_changes"):
                    self.assertGreater(summary[count], 0, count)
                self.assertEqual(sum(summary["rungs"].values()), 300, "a rung for each step")
                _, _, by_elements = self.simulate(CHAIN, ranks=ranks)
                for count in ("factorizations", "linear_solves", "snes_iterations"):
                    self.assertEqual(by_elements[count], 0, f"{count} of weakly coupled elements")

    def test_solve_summary(self):
        problem = self.write("[problem]\nM = [[2, 1], [0, 2]]\nq = [-1, 2]\n")
        self.sweepvi("solve", problem, "--summary", "s.json")
        summary = program.read_json(self.folder / "s.json")
        self.assertEqual(program.SUMMARY_KEYS - summary.keys(), set(), "keys are missing")
        self.assertEqual((summary["exit"], summary["status"], summary["unknowns"]), (0, "done", 2))

    def test_datasets_and_attributes(self):
        arrays, attributes, _ = self.simulate(CHAIN + "[output]\nblocks = [1, 3]\n")
        self.assertEqual((DATASETS | {"z", "element"}) - arrays.keys(), set(), "datasets are missing")
        self.assertEqual(ATTRIBUTES - attributes.keys(), set(), "root attributes are missing")
        self.assertEqual(attributes["status"], "done")
        self.assertEqual((attributes["format_version"], attributes["ranks"]), (1, 1))
        self.assertEqual((attributes["title"], attributes["scheme"]), ("short chain", "homsp"))
        self.assertAlmostEqual(attributes["step"], 0.02, 15)
        self.assertEqual(attributes["scene"], (self.folder / "scene.toml").read_text())
        self.assertLessEqual(attributes["started"], attributes["finished"])
        for name in ("t", "x", "z", "w", "mu", "level", "solver/iterations", "solver/seconds"):
            self.assertEqual(len(arrays[name]), 301, name)
        self.assertEqual(arrays["mu"].shape, (301, 2, 3))
        self.assertEqual(arrays["element"].tolist(), [1, 3])
        self.assertEqual(arrays["t"][[0, -1]].tolist(), [0, 6])
        for name in ("mu", "level", "solver/iterations"):
            self.assertTrue(np.all(arrays[name][0] == 0), f"row 0 of {name} is 0")

    def test_every_dataset_says_what_it_is(self):
        self.simulate(CHAIN + "[output]\nblocks = [1, 3]\n")
        with h5py.File(self.folder / "run.h5") as file:
            for name in (*DATASETS, "z", "element"):
                with self.subTest(name):
                    data = file[name]
                    self.assertTrue(data.attrs["description"])
                    self.assertTrue(all(np.ravel(data.attrs["units"])))
                    if len(data) == len(file["t"]) and name != "t":
                        self.assertIn(file["t"], data.dims[0].values(), "the scale of axis 0 is not /t")
            self.assertTrue(h5py.h5ds.is_scale(file["t"].id), "/t is no dimension scale")
            self.assertEqual(list(file["x"].attrs["names"]), ["z1", "z2", "z3", "xi1", "xi2"])
            self.assertEqual(list(file["z"].attrs["names"]), ["z1", "z2", "z3"])

    def test_events(self):
        arrays, _, _ = self.simulate(CHAIN)
        events, t = arrays["events"], arrays["t"]
        self.assertEqual(events.dtype.names, ("t", "constraint", "level", "kind", "impulse"))
        self.assertGreater(len(events), 0, "every element of the chain meets its wall")
        keys = [(event["t"], event["constraint"], event["level"]) for event in events]
        self.assertEqual(keys, sorted(keys), "events in order")
        self.assertTrue(set(events["t"]) <= set(t), "events happen at the ends of steps")
        self.assertTrue(np.all(events["impulse"] >= 0))
        rows = np.searchsorted(t, events["t"])
        for row, event in zip(rows, events):
            on = arrays["w"][row, event["constraint"]] == 0
            self.assertEqual(on, event["kind"] == 0, f"w = 0 after an impact, > 0 after a lift-off: {event}")

    def test_solve_file(self):
        problem = self.write("[problem]\nM = [[2, 1], [0, 2]]\nq = [-1, 2]\n")
        self.sweepvi("solve", problem, "-o", "s.h5")
        with h5py.File(self.folder / "s.h5") as file:
            self.assertEqual(file.attrs["status"], "done")
            self.assertEqual(file.attrs["format_version"], 1)
            for name in ("solution", "F"):
                self.assertTrue(file[name].attrs["units"] and file[name].attrs["description"], name)


class Recording(InFolder):
    def test_every(self):
        """Rows k, 2k, ...; the first and the last always; sums and extremes over what lies between."""
        full, _, summary = self.simulate(CHAIN)
        for every in (7, 300, 1000):
            with self.subTest(every=every):
                rows = [*range(0, 300, every), 300]
                part, _, _ = self.simulate(CHAIN + f"[output]\nevery = {every}\n")
                for name in ("t", "x", "z", "w", "level", "solver/active", "events"):
                    expected = full[name] if name == "events" else full[name][rows]
                    np.testing.assert_array_equal(part[name], expected, err_msg=name)
                groups = list(zip(rows[:-1], rows[1:]))
                for i, (first, last) in enumerate(groups, 1):
                    between = slice(first + 1, last + 1)
                    np.testing.assert_allclose(part["mu"][i], full["mu"][between].sum(axis=0), rtol=1e-13, atol=1e-15)
                    self.assertEqual(part["solver/iterations"][i], full["solver/iterations"][between].sum())
                    self.assertEqual(part["solver/residual"][i], full["solver/residual"][between].max())

    def test_blocks(self):
        full, _, _ = self.simulate(CHAIN)
        for ranks in (1, 3):
            with self.subTest(ranks=ranks):
                part, _, _ = self.simulate(CHAIN + "[output]\nblocks = [4, 1]\n", ranks=ranks)
                chosen = part["element"]
                self.assertEqual(sorted(chosen), [1, 4])
                for name, width in (("x", 5), ("z", 3), ("w", 1), ("level", 1), ("mu", 1)):
                    shape = (301, 5, -1)
                    expected = full[name].reshape(shape)[:, chosen]
                    np.testing.assert_allclose(part[name].reshape(301, 2, -1), expected, rtol=1e-9, atol=1e-12, err_msg=name)
                np.testing.assert_array_equal(part["solver/active"], full["solver/active"], "all elements count")

    def test_ranks_agree(self):
        """Files depend on the number of ranks only through rounding, which 300 dissipative steps do not amplify."""
        alone, attributes, _ = self.simulate(CHAIN)
        for ranks in (2, 3):
            with self.subTest(ranks=ranks):
                together, others, _ = self.simulate(CHAIN, ranks=ranks)
                self.assertEqual(alone.keys(), together.keys())
                self.assertEqual({key for key in attributes if attributes[key] != others[key]} - {"started", "finished"}, {"ranks"})
                for name in alone.keys() - {"events", "solver/seconds", "solver/residual", "solver/iterations"}:
                    np.testing.assert_allclose(together[name], alone[name], rtol=1e-9, atol=1e-12, err_msg=name)
                for field in alone["events"].dtype.names:
                    expected = alone["events"][field]
                    np.testing.assert_allclose(together["events"][field], expected, rtol=1e-9, atol=1e-12, err_msg=field)

    def test_more_ranks_than_states(self):
        """x' = -2 + lambda, x >= 0 from 1: at the wall from 0.5 s on."""
        for ranks in (1, 3):
            with self.subTest(ranks=ranks):
                arrays, _, _ = self.simulate(ONE_STATE, ranks=ranks)
                exact = np.maximum(1 - 2 * arrays["t"], 0)
                np.testing.assert_allclose(arrays["x"][:, 0], exact, atol=1e-14)
                np.testing.assert_allclose(arrays["mu"][6:, 0, 0], 0.2, rtol=1e-12)

    def test_constraints_that_share_a_state(self):
        """They may live on different ranks."""
        for ranks in (1, 2, 3):
            with self.subTest(ranks=ranks):
                arrays, _, summary = self.simulate(TWO_WALLS, ranks=ranks)
                exact = np.minimum(1 + 2 * arrays["t"], 1.5)
                np.testing.assert_allclose(arrays["x"][:, 0], exact, atol=1e-14)
                np.testing.assert_allclose(arrays["w"], np.column_stack([exact, 1.5 - exact]), atol=1e-14)
                # Opposite rows are one constraint with two walls, whose output is the state itself: a box on z.
                self.assertEqual((summary["unknowns"], summary["constraints"]), (1, 2))

    def test_solve_with_more_ranks_than_unknowns(self):
        problem = self.write("[problem]\nM = [[2]]\nq = [-1]\n")
        self.sweepvi("solve", problem, ranks=3)
        self.assertEqual(read_file(self.folder / "scene.h5")[0]["solution"].tolist(), [[0.5]])


class Check(InFolder):
    def test_examples(self):
        scenes = sorted(Path(program.SOURCE).glob("examples/*/scene.toml"))
        self.assertGreater(len(scenes), 1)
        for scene in scenes:
            for ranks in (1, 2):
                with self.subTest(scene.parent.name, ranks=ranks):
                    outcome = self.sweepvi("check", scene, ranks=ranks)
                    scheme = re.search(r"scheme (\S+)", outcome.out)[1]
                    more = {
                        "homsp": ("sizes", "relative degree", "Markov matrix", "zero dynamics"),
                        "moreau-jean": ("sizes", "mass matrix", "restitution", "time stepping"),
                    }
                    for row in ("steps", "form", "unknowns", *more.get(scheme, ())):
                        self.assertRegex(outcome.out, rf"(?m)^{row}  +\S", outcome)
                    self.assertEqual(outcome.err, "", outcome)
                    self.assertEqual(self.files(), [])

    def test_paper65(self):
        text = self.sweepvi("check", program.SOURCE / "examples/paper65/scene.toml").out
        self.assertRegex(text, r"relative degree +r = 3 for 1 constraint\b")
        self.assertRegex(text, r"zero dynamics +2 states")
        self.assertRegex(text, r"sizes +5 states, 1 constraints, 3 outputs")

    def test_degrees_of_a_mixture(self):
        """r = 1 and r = 2 in one system, and an unstable zero dynamics: x3' = x3 + x1."""
        text = self.sweepvi("check", self.write(
            "[time]\nend = 1\nstep = 0.1\n[model]\nkind = \"linear\"\n"
            "A = [[0, 1, 0, 0], [0, 0, 0, 0], [1, 0, 1, 0], [0, 0, 0, 0]]\n"
            "B = [[0, 0], [1, 0], [0, 0], [0, 1]]\nC = [[1, 0, 0, 0], [0, 0, 0, 1]]\nx0 = [1, 0, 0, 1]\n"
        )).out  # fmt: skip
        self.assertRegex(text, r"relative degree +r = 1 for 1 constraint, r = 2 for 1 constraint")
        self.assertRegex(text, r"zero dynamics +1 states, largest real part of the spectrum 1 1/s \(unstable")

    def test_solvability_is_not_promised_without_reason(self):
        """w = x - lambda: with x < 0 there is no lambda >= 0, so the Markov matrix D = -1 is not positive definite."""
        outcome = program.run("check", self.write(ONE_STATE + "D = [[-1]]\n"), cwd=self.folder)
        self.assertIn(outcome.code, (0, 2), outcome)
        self.assertNotIn("exactly one solution", outcome.out)
        self.assertNotIn("counted inf", outcome.out)


class Unsolved(InFolder):
    def judge(self, text, steps, ranks):
        """Exit 3; the file holds the run up to the last good step, with nothing of the failed one."""
        for every in (1, 3):
            recorded = f"[output]\nevery = {every}\n"
            part, attributes, summary = self.simulate(text + recorded, code=3, ranks=ranks)
            self.assertEqual((attributes["status"], summary["status"], summary["exit"]), ("failed", "failed", 3))
            self.assertEqual(summary["steps"], steps)
            rows = sorted({*range(0, steps + 1, every), steps})
            np.testing.assert_allclose(part["t"], 0.1 * np.array(rows), rtol=1e-14)
            self.assertEqual({len(part[name]) for name in DATASETS - {"events"}}, {len(rows)})
            self.assertEqual(self.files(), ["run.h5", "run.h5.checkpoint", "run.json", "run.problem.h5", "run.problem.toml", "scene.toml"])
        return part

    def test_no_step_at_all(self):
        for ranks in (1, 2):
            with self.subTest(ranks=ranks):
                part = self.judge(SQUEEZE.replace("w0 = [0, 1.05]", "w0 = [0, 0.05]"), 0, ranks)
                np.testing.assert_array_equal(part["t"], [0])

    def test_step_without_a_solution(self):
        for ranks in (1, 2):
            with self.subTest(ranks=ranks):
                part = self.judge(SQUEEZE, SQUEEZED, ranks)
                exact = np.column_stack([np.maximum(0.5, part["t"]), part["t"]])
                np.testing.assert_allclose(part["x"], exact, atol=1e-12)

    def test_step_without_a_solvable_jacobian(self):
        """I - h A = 0; and numbers that overflow."""
        singular = ONE_STATE.replace("A = [[0]]", "A = [[10.0]]").replace("f = [-2]\n", "")
        overflow = ONE_STATE.replace("A = [[0]]", "A = [[1e200]]").replace("x0 = [1]", "x0 = [1e200]")
        for name, text in {"singular": singular, "overflow": overflow}.items():
            for ranks in (1, 2):
                with self.subTest(name, ranks=ranks):
                    words = ("--force", "-sweepvi_halvings", "0")  # half the step is solvable
                    outcome = self.sweepvi("run", self.write(text), *words, code=3, ranks=ranks)
                    self.assertIn("sweepvi: step 1, t = 0.1 s: ", outcome.err, outcome)

    def test_options_that_make_petsc_give_up(self):
        """They turn an unsolved step into an error inside PETSc; for us it is still an unsolved step."""
        for option in ("-snes_error_if_not_converged", "-ksp_error_if_not_converged", "-ts_error_if_step_fails"):
            with self.subTest(option):
                self.sweepvi("run", self.write(SQUEEZE), "--force", option, code=3)

    def test_summary_holds_the_failed_residual(self):
        """As after `solve`; without it the summary of a failed run looks perfect."""
        _, _, summary = self.simulate(SQUEEZE, code=3)
        self.assertGreater(summary["max_residual"], 1e-10)

    def test_message(self):
        scene = self.write(SQUEEZE)
        for ranks in (1, 2):
            with self.subTest(ranks=ranks):
                outcome = self.sweepvi("run", scene, "--force", code=3, ranks=ranks)
                self.assertEqual(len(re.findall(r"(?m)^sweepvi: step 11, t = 1.1 s: ", outcome.err)), 1, outcome)
                self.assertIn("asked for 1e-10", outcome.err)


if __name__ == "__main__":
    unittest.main()
