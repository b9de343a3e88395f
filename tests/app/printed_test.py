# ranks: 1
# timeout: 120
"""Texts that others wrote, printed: none forges a line of ours, moves the cursor, rings, or hides what it says."""

import os
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program
from output_files_test import SCENE

EVIL = {
    "newline": "a\nsweepvi: everything is well",
    "return": "a\rsweepvi: fine",
    "escape": "a\x1b[2J\x1b]0;owned\x07",
    "bell": "a\x07\x08\x7f",
    "C1": "a\x9b31m",
    "override": "a\u202egpj.toml",
    "isolate": "a\u2066b\u2069\u200f",
    "separators": "a\u2028b\u2029c\u0085d",
    "no width": "a\u200bb\ufeff\u00ad",
    "tag": "a\U000e0041b",
}
BYTES = [b"a\xff\xfeb", b"a\xc0\x8ab", b"a\xed\xa0\x80b", b"a\xf4\x90\x80\x80b", b"a\xe2\x80", b"a\x80b"]
HIDDEN = set(map(chr, [*range(0x20), *range(0x7F, 0xA0), 0xAD, *range(0x200B, 0x2010), *range(0x2028, 0x202F), *range(0x2060, 0x2070), 0xFEFF,
                       0xE0041, 0xFFFD])) - {"\n"}


def toml(text):
    """A basic string."""
    return '"' + "".join(c if c.isalnum() else f"\\U{ord(c):08x}" for c in text) + '"'


class Printed(unittest.TestCase):
    def setUp(self):
        temporary = program.temporary_folder()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)

    def check(self, *words, code):
        outcome = program.run(*words, cwd=self.folder)
        self.assertEqual(outcome.code, code, outcome)
        for text in (outcome.out, outcome.err):
            self.assertEqual(set(text) & HIDDEN, set(), repr(text))
        if code:
            self.assertEqual(len(outcome.err.splitlines()), 1, outcome.err)
        return outcome

    def test_texts_in_scenes(self):
        for name, text in EVIL.items():
            with self.subTest(name=name):
                scene = self.folder / "scene.toml"
                for broken in (SCENE + f"{toml(text)} = 1\n", SCENE.replace('kind = "linear"', f"kind = {toml(text)}"),
                               SCENE + f"D = {toml(text)}\n", SCENE + f"[petsc]\noptions = {toml(text)}\n"):
                    scene.write_text(broken)
                    self.check("check", "scene.toml", code=2)
                scene.write_text(SCENE.replace('"ball"', toml(text)))
                out = self.check("check", "scene.toml", code=0).out
                self.assertEqual(sum(line.startswith("scene ") for line in out.splitlines()), 1)

    def test_names_of_files(self):
        for text in [*(text.encode() for text in EVIL.values()), *BYTES]:
            name = os.fsdecode(text.replace(b"/", b""))
            with self.subTest(name=name):
                (self.folder / name).write_text(SCENE)
                self.check("check", name, code=0)
                self.check("run", name, "-o", name + ".h5", code=0)
                self.check("run", name, "-o", name + ".h5", code=5)
                (self.folder / name).write_text("x")
                self.check("check", name, code=2)
                self.check("check", name + "no", code=2)

    def test_words(self):
        (self.folder / "scene.toml").write_text(SCENE)
        for text in map(EVIL.get, ("newline", "escape", "override")):
            for words in (["--" + text], ["--set", text], ["--set", f"model.{text}=1"], ["--set", f"title={toml(text)}\n"], [text],
                          ["--summary", text + "/x"]):
                outcome = program.run("run", "scene.toml", *words, cwd=self.folder)
                self.assertEqual(set(outcome.err + outcome.out) & HIDDEN, set(), repr(outcome.err))
                self.assertLessEqual(len(outcome.err.splitlines()), 1, outcome.err)
            outcome = program.run("jobs", "--server", text, cwd=self.folder)
            self.assertEqual((outcome.code, set(outcome.err) & HIDDEN), (2, set()), repr(outcome.err))

    def test_what_may_be_read_is_kept(self):
        for name in ("Prüfstand.toml", "двигатель.toml", "機械.toml", "naïve \U0001f680.toml", "back\\slash.toml"):
            (self.folder / name).write_text(SCENE)
            self.assertIn(name, self.check("check", name, code=0).out)


if __name__ == "__main__":
    unittest.main()
