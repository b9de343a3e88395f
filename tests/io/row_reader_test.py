# ranks: 1
"""Readers may hold a run's files: they do not stop it, and what they hold stays what it is."""

import os
import subprocess
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program
from row_kill import start

READER = """
import sys, h5py
with h5py.File(sys.argv[1], "r") as file:
    before = file["/x"][...]
    print(len(before), flush=True)
    for line in sys.stdin:
        same = (file["/x"][: len(before)] == before).all()
        print(same, flush=True)
"""


class Reader:
    """Holds a file open with h5py, in a process of its own."""

    def __init__(self, path, locking):
        self.process = subprocess.Popen(
            [sys.executable, "-c", READER, str(path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
            env={**os.environ, "HDF5_USE_FILE_LOCKING": locking},
        )
        self.rows = self.process.stdout.readline().strip()

    def sees_the_same(self):
        self.process.stdin.write("?\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()

    def close(self):
        self.process.communicate(timeout=10)


class Run:
    """The program that writes rows as told."""

    def __init__(self, path, ranks, session):
        self.process = start("drive", path, ranks=ranks, session=session)
        self.process.stdout.readline()

    def tell(self, line):
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()
        return self.process.stdout.readline().strip()

    def finish(self):
        err = self.process.communicate("finish\n", timeout=30)[1]
        return self.process.returncode, err


class Readers(unittest.TestCase):
    def test_they_do_not_stop_a_run_and_are_not_harmed(self):
        for ranks, locking in (1, "TRUE"), (1, "FALSE"), (2, "TRUE"):  # several ranks lock nothing in any case
            with self.subTest(ranks=ranks, locking=locking), program.temporary_folder() as folder:
                self.check(Path(folder), ranks, locking)

    def check(self, folder, ranks, locking):
        final, partial = folder / "run.h5", folder / "run.h5.partial"
        first = Run(final, ranks, folder)
        self.assertEqual(first.tell("rows 20"), "20")
        self.assertEqual(first.tell("mark"), "20")
        of_running = Reader(partial, locking)
        self.assertEqual(of_running.rows, "20")
        first.tell("rows 300")
        self.assertEqual(first.tell("mark"), "320")
        self.assertEqual(of_running.sees_the_same(), "True")
        self.assertEqual(first.finish(), (0, ""))
        self.assertEqual(of_running.sees_the_same(), "True")
        of_running.close()

        # What an interrupted run has left and an old result, both held while the next run replaces them.
        os.link(final, partial)
        of_left, of_old = Reader(partial, locking), Reader(final, locking)
        self.assertEqual((of_left.rows, of_old.rows), ("320", "320"))
        second = Run(final, ranks, folder)
        self.assertEqual(second.tell("rows 10"), "10")
        self.assertEqual(second.tell("mark"), "10")
        self.assertEqual(second.finish(), (0, ""))
        for reader in of_left, of_old:
            self.assertEqual(reader.sees_the_same(), "True")
            reader.close()
        last = Reader(final, locking)
        self.assertEqual(last.rows, "10")
        last.close()
        self.assertEqual([path.name for path in folder.glob("*.h5*")], ["run.h5"])


if __name__ == "__main__":
    unittest.main()
