# ranks: 1
# timeout: 240
"""The program from outside, as contract.md (and the README) promise it: what it writes, and that ranks agree on it."""

import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program
from in_folder import ATTRIBUTES, BALL, CHAIN, DATASETS, ONE_STATE, InFolder, read_file

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


if __name__ == "__main__":
    unittest.main()
