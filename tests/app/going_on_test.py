# ranks: 1
# timeout: 240
"""A run that was stopped and gone on with leaves the file of a run that was not; nothing else can be gone on with."""

import os
import sys
import unittest
from pathlib import Path

import h5py

sys.path.insert(0, str(Path(__file__).resolve().parent))
import going_on
import program
from in_folder import InFolder

# r = 3, contacts that close and open, xi, forcing: all that a chain's state consists of. 1000 steps.
CHAIN = """[time]
end = 10.0
step = 1e-2
[model]
kind = "chain"
element = "jerk"
count = 12
coupling = 0.5
force = {offset = -0.1, amplitude = 0.3, frequency = 0.4}
[output]
every = 7
"""
SQUEEZE = """[time]
end = 1.0
step = 0.1
[model]
kind = "sweeping"
u0 = [0.0]
G = [[1], [-1]]
g = [-1, {offset = -1, amplitude = 2.5, frequency = 0.25}]
[output]
every = 3
"""  # between -1 and 1 - 2.5 sin(pi t / 2): empty from t = 0.59 s on


class GoingOn(InFolder):
    def setUp(self):
        super().setUp()
        self.scene = self.folder / "scene.toml"
        self.scene.write_text(CHAIN)

    def run_in(self, *words, **how):
        return program.run("run", *words, cwd=self.folder, **how)

    def stop_at_once(self, name, *words, **how):
        outcome = self.run_in("scene.toml", "-o", name, "--wall-limit", 0, *words, **how)
        self.assertEqual(outcome.code, 4, outcome)
        return outcome

    def test_stopped_by_a_signal_and_gone_on_with(self):
        for ranks in (1, 2):
            with self.subTest(ranks=ranks):
                whole, parts = f"whole{ranks}.h5", f"parts{ranks}.h5"
                summary = ["--summary", "whole.json"]
                self.assertEqual(self.run_in("scene.toml", "-o", whole, *summary, ranks=ranks, timeout=60).code, 0)
                code, errors = going_on.interrupted(self.folder, ["run", "scene.toml", "-o", parts], ranks)
                self.assertEqual(code, 4, errors)
                self.assertIn("stopped by SIGUSR1 after step", errors)
                with h5py.File(self.folder / parts) as file:
                    self.assertEqual(file.attrs["status"], "stopped")
                    self.assertLess(file["t"][-1], 10.0)
                # From the stopped file once, from the checkpoint beside it once more.
                again = self.run_in(
                    "scene.toml", "-o", parts, "--restart", parts, "--wall-limit", 0, ranks=ranks, timeout=60
                )
                self.assertEqual(again.code, 4, again)
                end = self.run_in(
                    *("scene.toml", "-o", parts, "--restart", parts + ".checkpoint", "--summary", "parts.json"),
                    ranks=ranks,
                    timeout=60,
                )
                self.assertEqual(end.code, 0, end)
                self.assertEqual(going_on.same_bits(self.folder / whole, self.folder / parts), [])
                one, other = (program.read_json(self.folder / name) for name in ("whole.json", "parts.json"))
                for key in ("steps", "snes_iterations", "predictor_hits", "active_changes", "rungs", "max_residual"):
                    self.assertEqual(one[key], other[key], key)
                left = sorted(path.name for path in self.folder.iterdir() if path.name.startswith(parts))
                self.assertEqual(left, [parts])

    def test_other_ranks_give_the_same_up_to_rounding(self):
        self.assertEqual(self.run_in("scene.toml", "-o", "whole.h5").code, 0)
        code, errors = going_on.interrupted(self.folder, ["run", "scene.toml", "-o", "one.h5"])
        self.assertEqual(code, 4, errors)
        end = self.run_in("scene.toml", "-o", "two.h5", "--restart", "one.h5", ranks=2, timeout=60)
        self.assertEqual(end.code, 0, end)
        whole, two = self.folder / "whole.h5", self.folder / "two.h5"
        # The states are of order 1, and 1000 steps carry the rounding of each (1e-16) on.
        self.assertLess(going_on.largest_difference(whole, two), 1e-12)
        self.assertEqual(going_on.largest_difference(whole, two, "t"), 0.0)
        self.assertTrue((self.folder / "one.h5").exists() and (self.folder / "one.h5.checkpoint").exists())

    def test_a_failed_run_can_be_gone_on_with_and_fails_again(self):
        self.scene.write_text(SQUEEZE)
        outcome = self.run_in("scene.toml", "-o", "a.h5")
        self.assertEqual(outcome.code, 3, outcome)
        again = self.run_in("scene.toml", "-o", "b.h5", "--restart", "a.h5")
        self.assertEqual(again.code, 3, again)
        self.assertEqual(going_on.same_bits(self.folder / "a.h5", self.folder / "b.h5"), ["checkpoint"])
        with h5py.File(self.folder / "a.h5") as file:
            self.assertEqual(list(file["t"][()].round(12)), [0.0, 0.3, 0.5])  # every third, and the last one

    def refused(self, words, fragment, code=2):
        before = program.content(self.folder)
        outcome = self.run_in(*words)
        self.assertEqual(outcome.code, code, outcome)
        self.assertIn(fragment, outcome.err)
        self.assertEqual(program.content(self.folder), before, "files changed")

    def test_what_cannot_be_gone_on_with_is_refused(self):
        self.stop_at_once("a.h5")
        good = (self.folder / "a.h5.checkpoint").read_bytes()
        bad = self.folder / "bad.checkpoint"
        words = ["scene.toml", "-o", "b.h5", "--restart", "bad.checkpoint"]

        for size in (0, 10, 21, 25, 200, len(good) // 2, len(good) - 8, len(good) - 1):
            bad.write_bytes(good[:size])
            self.refused(words, "cut short" if size < 21 else "damaged")
        for place in (30, len(good) // 3, len(good) // 2, len(good) - 1):  # length, header, arrays, checksum
            bad.write_bytes(good[:place] + bytes([good[place] ^ 4]) + good[place + 1 :])
            self.refused(words, "damaged")
        bad.write_bytes(good.replace(b"sweepvi checkpoint 1\n", b"sweepvi checkpoint 9\n"))
        self.refused(words, "the checkpoint has the format 'sweepvi checkpoint 9'")
        bad.write_text("no checkpoint\n")
        self.refused(words, "neither a checkpoint nor an output file")
        self.refused(["scene.toml", "-o", "b.h5", "--restart", "."], ".: cannot be read")

        words = ["scene.toml", "-o", "b.h5", "--restart", "a.h5.checkpoint"]
        self.refused([*words, "--set", "time.step=2e-2"], "another scene: time.step was 0.01, here it is 0.02")
        self.refused([*words, "--set", "model.coupling=1"], "another scene: model.coupling was 0.5, here it is 1")
        self.refused([*words, "--set", "output.every=1"], "another scene: output.every was 7, here it is 1")
        self.refused([*words, "--set", "model.a1=-1"], "another scene: model.a1 was not set, here it is -1")

        rows = (self.folder / "a.h5").read_bytes()
        os.remove(self.folder / "a.h5")
        self.refused(words, "a.h5")
        (self.folder / "a.h5").write_bytes(rows[: len(rows) // 4])
        self.refused(words, "a.h5")

    def test_a_complete_file_holds_nothing_to_go_on_from(self):
        self.assertEqual(self.run_in("scene.toml", "-o", "a.h5").code, 0)
        self.refused(["scene.toml", "-o", "b.h5", "--restart", "a.h5"], "holds no checkpoint")

    def test_an_interrupted_run_is_not_overwritten_unasked(self):
        self.stop_at_once("a.h5")
        os.remove(self.folder / "a.h5")
        self.refused(["scene.toml", "-o", "a.h5"], "Go on with --restart a.h5.checkpoint", code=5)
        outcome = self.run_in("scene.toml", "-o", "a.h5", "--force")
        self.assertEqual(outcome.code, 0, outcome)
        self.assertFalse((self.folder / "a.h5.checkpoint").exists())


if __name__ == "__main__":
    unittest.main()
