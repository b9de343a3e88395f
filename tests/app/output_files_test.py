# ranks: 1
# timeout: 120
"""Files that the program makes, under every kind of name: devices and pipes are written in place and stay what they are,
links are followed and stay, regular files are replaced whole, and what is lost on standard output is told."""

import json
import os
import stat
import subprocess
import sys
import threading
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program

SCENE = """title = "ball"
[time]
end = 1.0
step = 0.1
[model]
kind = "linear"
A = [[0, 1], [0, 0]]
B = [[0], [1]]
C = [[1, 0]]
f = [0, -1]
x0 = [1, 0]
"""
PROBLEM = """[problem]
M = [[2, 1], [1, 2]]
q = [-1.0, 2.0]
"""
# Every verb that writes a text file, and the word for it.
TEXTS = {
    "run": ("--summary", ["run", "scene.toml", "-o", "r.h5", "--force"]),
    "solve": ("--summary", ["solve", "problem.toml", "-o", "s.h5", "--force"]),
    "bench": ("--summary", ["bench", "scene.toml", "--count", "2", "--warmup", "1"]),
    "compare": ("--summary", ["compare", "a.h5", "a.h5"]),
    "csv": ("--csv", ["study", "scene.toml", "--steps", "0.1", "--repeats", "1"]),
    "study": ("--summary", ["study", "scene.toml", "--steps", "0.1", "--repeats", "1"]),
}


def is_device(path):
    return stat.S_ISCHR(os.lstat(path).st_mode)


class Files(unittest.TestCase):
    def setUp(self):
        temporary = program.temporary_folder()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)
        (self.folder / "scene.toml").write_text(SCENE)
        (self.folder / "problem.toml").write_text(PROBLEM)
        self.run_("run", "scene.toml", "-o", "a.h5")

    def run_(self, *words, code=0, **how):
        outcome = program.run(*words, cwd=self.folder, **how)
        self.assertEqual(outcome.code, code, outcome)
        return outcome

    def good(self, verb, text):
        if verb == "csv":
            self.assertGreaterEqual(len(text.splitlines()), 2, text)
        else:
            self.assertIsInstance(json.loads(text), dict)

    def reader(self, fifo):
        """Somebody who reads a pipe until its end."""
        texts = []
        thread = threading.Thread(target=lambda: texts.append(fifo.read_text()), daemon=True)
        thread.start()
        return thread, texts

    def test_links_and_regular_files(self):
        for verb, (word, words) in TEXTS.items():
            with self.subTest(verb=verb):
                target, link, chain = self.folder / f"{verb}.there", self.folder / f"{verb}.link", self.folder / f"{verb}.chain"
                (self.folder / "deep").mkdir(exist_ok=True)
                link.symlink_to(f"deep/../{target.name}")  # leads nowhere at first
                chain.symlink_to(link)
                self.run_(*words, word, chain.name)
                self.good(verb, target.read_text())
                target.write_text("before")
                target.chmod(0o640)
                self.run_(*words, word, chain.name)
                self.good(verb, target.read_text())
                self.assertEqual(stat.S_IMODE(target.stat().st_mode), 0o640, "its permissions")
                self.assertTrue(link.is_symlink() and chain.is_symlink())
        left = sorted(path.name for path in self.folder.iterdir() if ".there" in path.name)
        self.assertEqual(left, sorted(f"{verb}.there" for verb in TEXTS), "nothing else is left")
        loop = self.folder / "loop"
        loop.symlink_to(loop)
        self.assertIn("links", self.run_(*TEXTS["run"][1], "--summary", "loop", code=5).err.lower())

    def test_fifos(self):
        for verb, (word, words) in TEXTS.items():
            with self.subTest(verb=verb):
                fifo = self.folder / f"{verb}.fifo"
                os.mkfifo(fifo)
                thread, texts = self.reader(fifo)
                self.run_(*words, word, fifo.name)
                thread.join(10)
                self.good(verb, texts[0])
                self.assertTrue(stat.S_ISFIFO(os.lstat(fifo).st_mode))

    def test_devices(self):
        # Nodes and links of our own: whoever gets this wrong as root destroys what he writes to.
        device, full = self.folder / "null", self.folder / "full"
        full.symlink_to("/dev/full")
        try:
            os.mknod(device, stat.S_IFCHR | 0o666, os.makedev(1, 3))
            device.write_text("")
        except OSError:  # only root makes devices: then a link to one
            device.symlink_to("/dev/null")
        for verb, (word, words) in TEXTS.items():
            with self.subTest(verb=verb):
                self.run_(*words, word, device.name)
                self.assertTrue(device.is_symlink() or is_device(device))
        outcome = self.run_(*TEXTS["run"][1], "--summary", "full", code=5)
        self.assertIn("full could not be written: No space left", outcome.err)
        self.run_("run", "scene.toml", "-o", "p.h5", "--progress", device.name)
        # A table needs a regular file, and nothing is computed for one that has none.
        own = self.folder / "own"
        own.symlink_to("/dev/stdout")
        for name in (device.name, "full", "own", "/dev/fd/1", "/proc/self/fd/1"):
            for verb in (("run", "scene.toml"), ("solve", "problem.toml")):
                for force in ([], ["--force"]):
                    outcome = self.run_(*verb, "-o", name, *force, code=5)
                    self.assertIn("regular file", outcome.err)
        self.assertTrue(device.is_symlink() or is_device(device))
        self.assertTrue(full.is_symlink() and own.is_symlink())

    def test_outputs_behind_links(self):
        target = self.folder / "elsewhere/there.h5"
        target.parent.mkdir()
        link = self.folder / "link.h5"
        link.symlink_to("elsewhere/there.h5")
        for ranks in (1, 2):
            self.run_("run", "scene.toml", "-o", "link.h5", "--force", ranks=ranks)
            self.assertTrue(link.is_symlink() and target.is_file())
            self.assertEqual([path.name for path in target.parent.iterdir()], ["there.h5"])
        self.assertIn("exists", self.run_("run", "scene.toml", "-o", "link.h5", code=5).err)
        self.run_("solve", "problem.toml", "-o", "link.h5", "--force")
        self.assertTrue(link.is_symlink())

    def test_standard_output_as_a_file(self):
        """Between what else is printed there, whatever it is: a file, a pipe."""
        (self.folder / "own").symlink_to("/dev/stdout")
        for name in ("own", "/proc/self/fd/1", "/dev/fd/1"):
            for verb in TEXTS if name == "own" else ("run", "csv"):
                word, words = TEXTS[verb]
                with self.subTest(verb=verb, name=name):
                    out = self.folder / "out"
                    plain = self.run_(*words).out
                    with open(out, "w") as file:
                        self.run_(*words, word, name, out=file)
                    piped = self.run_(*words, word, name).out
                    for text in (out.read_text(), piped):
                        start = text.index("{\n") if verb != "csv" else 0
                        if verb != "csv":
                            json.JSONDecoder().raw_decode(text[start:])
                        self.assertGreaterEqual(len(text.splitlines()), len(plain.splitlines()) + 2)
        with open(self.folder / "log", "w") as file:
            self.run_("run", "scene.toml", "-o", "p.h5", "--progress", "own", out=file)
        lines = (self.folder / "log").read_text().splitlines()
        self.assertEqual(json.loads(lines[0])["step"], 10)
        self.assertTrue(lines[1].startswith("p.h5: 10 steps"), lines)

    def test_standard_output_that_is_lost(self):
        for words in (["help"], ["info"], ["--version"], ["check", "scene.toml"], ["run", "scene.toml", "-o", "q.h5"],
                      ["solve", "problem.toml", "-o", "q2.h5"], ["compare", "a.h5", "a.h5"], ["serve", "--help"], ["jobs", "--help"],
                      ["run", "scene.toml", "-o", "q3.h5", "-log_view"], ["run", "scene.toml", "-o", "q4.h5", "-snes_monitor"],
                      TEXTS["csv"][1]):
            with open("/dev/full", "w") as full:
                outcome = self.run_(*words, code=5, out=full)
            self.assertIn("standard output", outcome.err)
        self.assertTrue((self.folder / "q.h5").is_file(), "the run itself is done")
        reader, writer = os.pipe()
        os.close(reader)
        with os.fdopen(writer, "w") as pipe:  # as if by `| head`
            outcome = self.run_("check", "scene.toml", code=5, out=pipe)
        self.assertIn("Broken pipe", outcome.err)
        self.assertEqual(self.run_("check", "nowhere.toml", code=2, out=subprocess.DEVNULL).code, 2)

    def test_progress(self):
        fifo = self.folder / "progress"
        os.mkfifo(fifo)
        # Nobody reads it: the run goes on without.
        self.run_("run", "scene.toml", "-o", "f1.h5", "--progress", "progress")
        thread, texts = self.reader(fifo)
        time.sleep(0.2)
        self.run_("run", "scene.toml", "-o", "f2.h5", "--progress", "progress")
        thread.join(10)
        self.assertEqual(json.loads(texts[0].splitlines()[-1])["step"], 10)
        self.assertTrue(stat.S_ISFIFO(os.lstat(fifo).st_mode))
        link = self.folder / "progress.link"
        link.symlink_to("lines")
        for _ in range(2):
            self.run_("run", "scene.toml", "-o", "f3.h5", "--force", "--progress", "progress.link")
        self.assertEqual(len((self.folder / "lines").read_text().splitlines()), 2)
        (self.folder / "full").symlink_to("/dev/full")
        self.run_("run", "scene.toml", "-o", "f4.h5", "--progress", "full")


if __name__ == "__main__":
    unittest.main()
