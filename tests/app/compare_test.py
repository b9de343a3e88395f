# ranks: 3
# timeout: 120
"""`sweepvi compare` against numpy, and what it refuses."""

import shutil
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program

sys.path.insert(0, str(program.SOURCE / "scripts"))
from filled_graph import FilledGraph, hausdorff

SCENE = program.SOURCE / "examples" / "paper65" / "scene.toml"
CHAIN = program.SOURCE / "examples" / "jerk_chain" / "scene.toml"
REFERENCE = program.SOURCE / "tests" / "reference" / "jerk_chain_N2.csv"
ROUNDING = 1e-12  # sums of 1e4 terms
RTOL = 1e-6  # of numpy's Hausdorff distance


class Run:
    """A recorded run, in numpy's hands."""

    def __init__(self, path):
        with h5py.File(path) as file:
            self.t, self.x, self.mu = file["t"][:], file["x"][:], file["mu"][:]
            self.events = file["events"][:]

    def at(self, t):
        return np.stack([np.interp(t, self.t, column) for column in self.x.T], axis=1)

    def graph(self):
        return FilledGraph(self.t, self.x)

    def around(self, first, last):
        """The row before `first` and the row after `last`."""
        return self.t[self.t < first].max(), self.t[self.t > last].min()


def by_hand(a, b):
    """What `compare` should find for two runs over the same time with the same events in the same order."""
    merged = np.union1d(a.t, b.t)
    d = a.at(merged) - b.at(merged)
    kept = np.ones(len(merged), dtype=bool)
    left_out = np.zeros(len(merged) - 1, dtype=bool)
    for s, t in zip(a.events["t"], b.events["t"]):
        ends = np.array([run.around(min(s, t), max(s, t)) for run in (a, b)])
        first, last = ends[:, 0].min(), ends[:, 1].max()
        kept &= (merged <= first) | (merged >= last)
        left_out |= (merged[:-1] >= first) & (merged[1:] <= last)
    points, weights = np.polynomial.legendre.leggauss(8)
    pieces = np.arange(32)
    s = ((points + 1) / 2 + pieces[:, None]).ravel() / len(pieces)
    weights = np.tile(weights / 2 / len(pieces), len(pieces))
    l1 = sum(w * (np.diff(merged) * np.linalg.norm((1 - q) * d[:-1] + q * d[1:], axis=1)).sum() for q, w in zip(s, weights))
    return {
        "hausdorff": hausdorff(a.graph(), b.graph(), RTOL),
        "sup": np.linalg.norm(d[kept], axis=1).max(),
        "left_out": np.diff(merged)[left_out].sum() / (merged[-1] - merged[0]),
        "l1": l1,
        "final": np.linalg.norm(a.x[-1] - b.x[-1]),
        "events": abs(a.events["t"] - b.events["t"]).max(),
        "measures": abs(a.mu.sum(axis=0) - b.mu.sum(axis=0)).max(axis=0),
    }


class Compare(unittest.TestCase):
    """Two runs of AB (65), made once."""

    @classmethod
    def setUpClass(cls):
        folder = program.temporary_folder()
        cls.addClassCleanup(folder.cleanup)
        cls.runs = Path(folder.name)
        commands = [
            [SCENE, "-o", "coarse.h5"],
            [SCENE, "-o", "fine.h5", "--set", "time.step=1e-3"],
            [SCENE, "-o", "stopped.h5", "--wall-limit", "0"],
            [CHAIN, "-o", "all.h5"],
            [CHAIN, "-o", "one.h5", "--set", "output.blocks=[1]"],
            [CHAIN, "-o", "other.h5", "--set", "output.blocks=[0]"],
        ]
        chain = ["count=2", "coupling=0.5"]
        for command in commands[3:]:
            command += [word for key in chain for word in ("--set", "model." + key)]
            command += ["--set", "time.end=10", "--set", "time.step=1e-2"]

        def run(command):
            outcome = program.run("run", *command, cwd=cls.runs)
            assert outcome.code == (4 if "--wall-limit" in command else 0), outcome

        program.run_all(run, commands)

    def compare(self, *words, code=0, **how):
        outcome = program.run("compare", *words, cwd=self.runs, **how)
        self.assertEqual(outcome.code, code, outcome)
        if code != 0:
            self.assertEqual(outcome.out, "")
        return outcome

    def numbers(self, *words, **how):
        self.compare(*words, "--summary", "s.json", **how)
        summary = self.runs / "s.json"
        self.addCleanup(summary.unlink, missing_ok=True)
        return program.read_json(summary)

    def copy(self, name, change):
        """A copy of the coarse run with a change in it."""
        shutil.copy(self.runs / "coarse.h5", self.runs / name)
        self.addCleanup((self.runs / name).unlink, missing_ok=True)
        with h5py.File(self.runs / name, "r+") as file:
            change(file)
        return name

    def near(self, found, expected, rtol):
        np.testing.assert_allclose(found, expected, rtol=rtol, atol=1e-14)

    def expect(self, found, expected):
        self.assertGreaterEqual(found["hausdorff"]["value"], expected["hausdorff"] * (1 - 1e-12) - found["hausdorff"]["tolerance"])
        self.near(found["hausdorff"]["value"], expected["hausdorff"], RTOL + found["hausdorff"]["tolerance"])
        self.near(found["sup"]["value"], expected["sup"], ROUNDING)
        self.near(found["sup"]["left_out"], expected["left_out"], ROUNDING)
        self.near(found["final"], expected["final"], ROUNDING)
        # Gauss's rule is exact to rounding but where the difference passes close to 0, in few intervals.
        self.near(found["l1"], expected["l1"], 1e-8)
        self.near(found["events"]["largest_difference"], expected["events"], ROUNDING)
        self.near(found["measures"], expected["measures"], 1e-10)  # differences of sums

    def test_numbers_are_those_of_numpy_on_any_number_of_ranks(self):
        a, b = Run(self.runs / "coarse.h5"), Run(self.runs / "fine.h5")
        expected = by_hand(a, b)
        for ranks in (1, 2, 3):
            with self.subTest(ranks=ranks):
                found = self.numbers("coarse.h5", "fine.h5", ranks=ranks)
                self.expect(found, expected)
                self.assertEqual(found["ranks"], ranks)
                self.assertEqual((found["a"]["rows"], found["b"]["rows"]), (1001, 10001))
                events = found["events"]
                self.assertEqual([events[key] for key in ("matched", "unmatched_a", "unmatched_b")], [4, 0, 0])
        other_way = self.numbers("fine.h5", "coarse.h5")
        for key in ("l1", "final", "measures"):
            self.near(other_way[key], found[key], 1e-10)
        self.near(other_way["hausdorff"]["value"], found["hausdorff"]["value"], 1e-5)

    def test_components(self):
        a, b = Run(self.runs / "coarse.h5"), Run(self.runs / "fine.h5")
        for run in (a, b):
            run.x = run.x[:, [0, 3]]
        found = self.numbers("coarse.h5", "fine.h5", "--components", "3,0")
        self.expect(found, by_hand(a, b))
        self.assertEqual(found["components"], 2)

    def test_tolerance(self):
        exact = self.numbers("coarse.h5", "fine.h5", "--tolerance", "1e-10")["hausdorff"]
        self.assertEqual(exact["tolerance"], 1e-10)
        rough = self.numbers("coarse.h5", "fine.h5", "--tolerance", "0.01")["hausdorff"]
        self.assertLessEqual(rough["value"], exact["value"] + 1e-10)
        self.assertGreaterEqual(rough["value"] + 0.01, exact["value"])

    def test_a_run_is_where_it_is(self):
        found = self.numbers("coarse.h5", "coarse.h5")
        self.assertLess(found["hausdorff"]["value"], 1e-14)  # feet of perpendiculars, |x| < 3
        for value in (found["sup"]["value"], found["l1"], found["final"], *found["measures"]):
            self.assertEqual(value, 0.0)

    def test_small_distances_have_digits(self):
        """Moved by 1e-9: far below the first tolerance."""

        def move(file):
            file["x"][:, 1] += 1e-9

        moved = self.copy("moved.h5", move)
        self.near(self.numbers("coarse.h5", moved)["hausdorff"]["value"], 1e-9, 2e-3)

    def test_what_is_printed(self):
        text = self.compare("coarse.h5", "fine.h5").out
        for line in ("A: coarse.h5, 1001 rows", "Hausdorff distance", "sup error", "L1 error", "final error", "event times"):
            self.assertIn(line, text)
        self.assertIn("option -snes_tipe was not used", self.compare("coarse.h5", "fine.h5", "-snes_tipe", "x").err)

    def test_a_table_is_a_reference(self):
        table = np.genfromtxt(REFERENCE, delimiter=",", skip_header=1)
        run = Run(self.runs / "all.h5")
        found = self.numbers("all.h5", REFERENCE)
        self.near(found["final"], np.linalg.norm(run.x[-1] - table[-1, 1:]), ROUNDING)
        self.assertIsNone(found["events"])
        self.assertIsNone(found["measures"])
        self.near(
            found["hausdorff"]["value"],
            hausdorff(run.graph(), FilledGraph(table[:, 0], table[:, 1:]), RTOL),
            RTOL + found["hausdorff"]["tolerance"],
        )
        self.assertGreater(found["sup"]["left_out"], 0.0)  # the run's events are known
        # Without events between the rows of the table there is the run's own error, 9.9 h on (65), alone.
        self.assertLess(found["sup"]["value"], 0.1)
        some = self.numbers(REFERENCE, "all.h5", "--components", "5,6")
        self.near(some["final"], np.linalg.norm((run.x[-1] - table[-1, 1:])[5:7]), ROUNDING)

    def test_a_stopped_run_has_the_time_that_it_has(self):
        found = self.numbers("stopped.h5", "fine.h5")
        self.assertEqual((found["start"], found["end"]), (0.0, 0.0))
        self.assertEqual((found["l1"], found["final"]), (0.0, 0.0))
        self.assertGreater(found["hausdorff"]["value"], 9.9)  # of the whole graphs: 10 s are missing

    def test_blocks(self):
        self.assertEqual(self.numbers("one.h5", "one.h5")["final"], 0.0)
        self.refused([("one.h5 holds 1 (/element), other.h5 holds 0 (/element)", ["one.h5", "other.h5"], 1)])

    def refused(self, cases):
        """Each (message, words, ranks) ends in exit 2 with that message, and without a trace in the folder."""
        before = program.content(self.runs)
        outcomes = program.run_all(lambda case: program.run("compare", *case[1], cwd=self.runs, ranks=case[2]), cases)
        self.assertEqual(program.content(self.runs), before, "a file was made or changed")
        for outcome, (message, _, _) in zip(outcomes, cases):
            with self.subTest(message):
                self.assertEqual((outcome.code, outcome.out), (2, ""), outcome)
                self.assertIn(message, outcome.err)

    def test_bad_files(self):
        (self.runs / "text.h5").write_text("no HDF5")
        (self.runs / "alone.h5.partial").write_text("")
        (self.runs / "short.h5").write_bytes((self.runs / "coarse.h5").read_bytes()[:200000])
        for name in ("text.h5", "alone.h5.partial", "short.h5"):
            self.addCleanup((self.runs / name).unlink)
        with h5py.File(self.runs / "strange.h5", "w") as file:
            file["x"] = np.zeros((3, 2))
        self.addCleanup((self.runs / "strange.h5").unlink)
        cases = {
            "none.h5": "none.h5: there is no such file",
            "alone.h5": "there is no such file yet, only alone.h5.partial",
            "alone.h5.partial": "go on with --restart alone.h5.checkpoint",
            ".": ". is a folder",
            "text.h5": "text.h5 is not an HDF5 file",
            "short.h5": "short.h5",
            "strange.h5": "strange.h5 was not written by sweepvi",
            "all.h5": "coarse.h5 has states of 5 numbers, all.h5 of 10",
        }
        too_many = ("fine.h5 has no column 5; its columns are 0 to 4", ["fine.h5", "coarse.h5", "--components", "0,5"], 2)
        self.refused([(message, ["coarse.h5", name], 1) for name, message in cases.items()] + [too_many])

    def test_changed_files(self):
        def put(name, index, value):
            def change(file):
                file[name][index] = value

            return change

        def remove(name):
            def change(file):
                del file[name]

            return change

        def cut(file):
            t = file["t"][:-1]
            del file["t"]
            file["t"] = t

        def version(file):
            file.attrs["format_version"] = 2

        def versions(file):
            file.attrs["format_version"] = np.ones(1000, dtype="i8")

        def running(file):
            file.attrs["status"] = "running"

        def more_measures(file):
            mu = file["mu"][:]
            del file["mu"]
            file["mu"] = np.concatenate([mu, mu])

        def beyond_64_bits(file):  # 4 numbers a row, said 64 bits
            layout = h5py.VirtualLayout(shape=(len(file["t"]), 2**62 + 1, 4), dtype="f8")
            layout[0, 0, 0:1] = h5py.VirtualSource("none.h5", "mu", shape=(1,))
            del file["mu"]
            file.create_virtual_dataset("mu", layout)

        def later(file):
            file["t"][:] += 11

        changes = [
            (put("x", (1000, 3), np.nan), "/x should hold finite numbers, found nan at [1000, 3]"),
            (put("t", 7, 0.0), "/t should not decrease"),
            (put("t", 7, np.inf), "/t should hold finite numbers"),
            (put("mu", (7, 0, 2), np.nan), "/mu (constraints and levels as columns) should hold finite numbers, found nan at [7, 2]"),
            (remove("x"), "holds no trajectory (/x)"),
            (remove("t"), "/t is missing"),
            (cut, "/t 1000 rows; they should be equally many"),
            (version, "has format_version 2"),
            (versions, "has no number as attribute format_version"),
            (more_measures, "/mu has shape 2002 x 1 x 3, and /t 1001 rows"),
            (beyond_64_bits, "/mu: a row takes at least"),
            (running, "is of a run that was not done"),
            (later, "they have no time in common"),
        ]
        # On two ranks one of them meets the bad entry of /x or /mu.
        self.refused(
            [
                (message, ["coarse.h5", self.copy(f"changed{i}.h5", change)], 2 if "nan" in message else 1)
                for i, (change, message) in enumerate(changes)
            ]
        )
        without = self.copy("without.h5", remove("events"))
        self.assertIsNone(self.numbers("coarse.h5", without)["events"])

        def many_words(file):
            file.attrs["status"] = ["running"] * 1000

        # No status of a run, but one more text than a reader has room for.
        self.assertEqual(self.numbers("coarse.h5", self.copy("words.h5", many_words))["final"], 0.0)

    def test_bad_tables(self):
        tables = [
            ("", ".csv:1: a table of a trajectory begins with a line 't,name,...'"),
            ("time,x\n0,1\n", ".csv:1: a table"),
            ("t\n0\n", ".csv:1: a table"),
            ("t,a,b,c,d,e\n", ".csv has no rows"),
            ("t,a,b,c,d,e\n0,1,2,3,4\n", ".csv:2: expected 6 numbers, as in line 1, found 5"),
            ("t,a,b,c,d,e\n0,1,2,x,4,5\n", ".csv:2: 'x' is not a finite number"),
            ("t,a,b,c,d,e\n0,1,2,nan,4,5\n", ".csv:2: 'nan' is not a finite number"),
            ("t,a,b,c,d,e\n1,1,2,3,4,5\n0,1,2,3,4,5\n", ".csv:3: the time decreases"),
            ("t,a\n0,1\n", "coarse.h5 has states of 5 numbers, table8.csv of 1"),
        ]
        for i, (text, _) in enumerate(tables):
            (self.runs / f"table{i}.csv").write_text(text)
            self.addCleanup((self.runs / f"table{i}.csv").unlink)
        self.refused([(message, ["coarse.h5", f"table{i}.csv"], 1) for i, (_, message) in enumerate(tables)])
        table = self.runs / "table.csv"
        table.write_text("t, a, b, c, d, e\r\n0, +1, 0, 1e-400, 0, 0\r\n\r\n")
        self.assertEqual(self.numbers("coarse.h5", "table.csv")["final"], 0.0)
        table.unlink()

    def test_the_summary_goes_where_it_can(self):
        before = program.content(self.runs)
        self.assertIn("same file", self.compare("coarse.h5", "fine.h5", "--summary", "fine.h5", code=2).err)
        self.compare("coarse.h5", "fine.h5", "--summary", "no/such/folder.json", code=5)
        self.assertEqual(program.content(self.runs), before)
        self.compare("coarse.h5", "fine.h5")
        self.assertEqual(program.content(self.runs), before)


if __name__ == "__main__":
    unittest.main()
