# ranks: 1
"""--confine, --progress and `check` of a problem: what the service asks of the program."""

import json
import os
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program
from in_folder import BALL, InFolder

A_MTX = "%%MatrixMarket matrix coordinate real general\n2 2 1\n1 2 1.0\n"


class Confined(InFolder):
    def setUp(self):
        super().setUp()
        (self.folder / "A.mtx").write_text(A_MTX)
        (self.folder / "0.mtx").write_text(A_MTX)
        self.write(BALL.replace("[[0, 1], [0, 0]]", '"A.mtx"'))
        self.allow({})

    def write(self, text):
        (self.folder / "scene.toml").write_text(text)

    def allow(self, files):
        (self.folder / "files.json").write_text(json.dumps(files))

    def check(self, *words, verb="check"):
        return program.run(verb, "scene.toml", "--confine", "files.json", *words, cwd=self.folder)

    def refused(self, outcome, *fragments):
        self.assertEqual(outcome.code, 2, outcome)
        for fragment in fragments:
            self.assertIn(fragment, outcome.err)

    def test_only_files_of_the_list(self):
        self.refused(self.check(), "scene.toml:7:", 'model.A = "A.mtx" is no file that came with the document')
        self.allow({"A.mtx": "0.mtx"})
        self.assertEqual(self.check().code, 0)
        (self.folder / "A.mtx").unlink()
        self.assertEqual(self.check(verb="run").code, 0)
        (self.folder / "scene.h5").unlink()
        self.assertEqual(program.run("check", "scene.toml", cwd=self.folder).code, 2)  # where nothing is confined
        np.savez(self.folder / "A.data", np.array([[0.0, 1.0], [0.0, 0.0]]))
        self.allow({"A.mtx": "A.data.npz", "A.npz": "A.data.npz"})  # what it is its content tells
        for name in ("A.mtx", "A.npz"):
            self.assertEqual(self.check("--set", f"model.A={name}", verb="run").code, 0)
            (self.folder / "scene.h5").unlink()
        self.refused(self.check("--set", "model.A=A.data.npz"), "no file that came")
        self.allow({"A.mtx": "0.mtx"})
        self.refused(self.check("--set", "model.A=0.mtx"), "no file that came")
        self.refused(self.check("--set", 'model.C={file="0.mtx", dataset="/C"}'), "no file that came")

    def test_what_is_written_has_its_own_name(self):
        self.write(BALL + '[output]\nfile = "own.h5"\n')
        self.assertEqual(self.check("-o", "other.h5", verb="run").code, 0)
        self.assertTrue((self.folder / "other.h5").exists() and not (self.folder / "own.h5").exists())

    def test_hdf5_that_leads_elsewhere(self):
        with h5py.File(self.folder / "data.h5", "w") as file:
            file["A"] = np.array([[0.0, 1.0], [0.0, 0.0]])
            group = file.create_group("sparse")
            group.attrs["shape"] = [2, 2]
            for name, values in (("data", [1.0]), ("indices", [1]), ("indptr", [0, 1, 1])):
                group[name] = values
        with h5py.File(self.folder / "links.h5", "w") as file:
            file["A"] = h5py.ExternalLink("data.h5", "/A")
            group = file.create_group("sparse")
            group.attrs["shape"] = [2, 2]
            for name in ("data", "indices", "indptr"):
                group[name] = h5py.ExternalLink("data.h5", "/sparse/" + name)
            layout = h5py.VirtualLayout((2, 2), "f8")
            layout[:] = h5py.VirtualSource("data.h5", "A", (2, 2))
            file.create_virtual_dataset("virtual", layout)
        self.allow({"links.h5": "links.h5", "data.h5": "data.h5"})
        for dataset, fragment in (("A", "link to another file"), ("sparse", "link to another file"), ("virtual", "in other files")):
            self.write(BALL.replace("[[0, 1], [0, 0]]", f'{{file = "links.h5", dataset = "/{dataset}"}}'))
            self.refused(self.check(), fragment)
            self.assertEqual(program.run("check", "scene.toml", cwd=self.folder).code, 0, "not confined, it is followed")
        for dataset in ("A", "sparse"):
            self.write(BALL.replace("[[0, 1], [0, 0]]", f'{{file = "data.h5", dataset = "/{dataset}"}}'))
            self.assertEqual(self.check().code, 0, dataset)

    def test_links_tell_nothing_of_where_they_lead(self):
        """Whether it is there, HDF5, or waits for a writer for ever."""
        elsewhere = program.temporary_folder()
        self.addCleanup(elsewhere.cleanup)
        folder = Path(elsewhere.name)
        os.mkfifo(folder / "fifo")
        (folder / "text").write_text("no HDF5")
        with h5py.File(folder / "matrix", "w") as file:
            file["A"] = np.array([[0.0, 1.0], [0.0, 0.0]])
        with h5py.File(self.folder / "links.h5", "w") as file:
            for name in ("fifo", "text", "matrix", "absent"):
                file[name] = h5py.ExternalLink(folder / name, "/A")
                file.create_group(f"in {name}")["deeper"] = h5py.ExternalLink(folder / name, "/")
        self.allow({"links.h5": "links.h5"})
        for pattern in ("{}", "in {}/deeper/A"):
            complaints = set()
            for name in ("fifo", "text", "matrix", "absent"):
                dataset = pattern.format(name)
                self.write(BALL.replace("[[0, 1], [0, 0]]", f'{{file = "links.h5", dataset = "/{dataset}"}}'))
                outcome = self.check()
                self.refused(outcome, "is a link to another file")
                complaints.add(outcome.err.replace(name, "NAME"))
            self.assertEqual(len(complaints), 1, complaints)

    def test_only_harmless_options(self):
        self.write(BALL)
        self.assertEqual(self.check("-snes_type", "vinewtonssls", "-snes_monitor").code, 0)
        self.refused(self.check("-log_view", ":x"), "':x' may not be used here")
        self.refused(self.check("-info"), "'-info' may not be used here")
        self.write(BALL + '[petsc]\noptions = "-snes_rtol 1e-9 -info"\n')
        self.refused(self.check(), "petsc.options: option '-info' may not be used here")
        self.assertEqual(program.run("check", "scene.toml", cwd=self.folder).code, 0)

    def test_list_that_is_none(self):
        for text in ("", "[]", '{"a": 1}'):
            (self.folder / "files.json").write_text(text)
            self.refused(self.check(), "files.json is no list of files")


class Progress(InFolder):
    def test_lines_of_json(self):
        (self.folder / "scene.toml").write_text(BALL)
        for count in (1, 2):  # appended to
            outcome = program.run("run", "scene.toml", "--progress", "p", "--force", cwd=self.folder)
            self.assertEqual(outcome.code, 0, outcome)
            lines = [json.loads(line) for line in (self.folder / "p").read_text().splitlines()]
            last = [line for line in lines if line["step"] == line["steps"] == 20]
            self.assertEqual(len(last), count)
        self.assertAlmostEqual(lines[-1]["t"], 2.0)
        self.assertEqual((lines[-1]["left"], lines[-1]["iterations"]), (0.0, 0))
        self.assertLess(lines[-1]["residual"], 1e-10)
        self.assertRegex(lines[-1]["end"], r"^\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ$")
        outcome = program.run("run", "scene.toml", "--progress", "scene.toml", "--force", cwd=self.folder)
        self.assertEqual(outcome.code, 2, outcome)


class Problems(InFolder):
    def test_check(self):
        problem = self.folder / "p.toml"
        problem.write_text("[problem]\nM = [[2, 1], [1, 2]]\nq = [-1.0, 2.0]\n")
        outcome = program.run("check", "p.toml", cwd=self.folder)
        self.assertEqual(outcome.code, 0, outcome)
        self.assertRegex(outcome.out, r"unknowns +2\nnonzeros of M +4\n")
        problem.write_text("[problem]\nM = [[2, 1], [1, 2]]\nq = [-1.0]\n")
        outcome = program.run("check", "p.toml", cwd=self.folder)
        self.assertEqual(outcome.code, 2, outcome)
        self.assertIn("problem.q has 1 entries; expected n = 2", outcome.err)


if __name__ == "__main__":
    unittest.main()
