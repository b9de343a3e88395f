# ranks: 1
"""sweepvi fsck: says each thing that is wrong with a data folder, changes nothing unless asked to, and with --mend leaves
what a daemon can work with."""

import shutil
import sqlite3
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
import program
from data_folder_test import content
from service_test import InService


class Fsck(InService):
    def setUp(self):
        super().setUp()
        self.data = self.daemon.data
        self.numbers = [self.accepted(self.daemon.submit()) for _ in range(4)]
        for number in self.numbers:
            self.assertEqual(self.daemon.wait(number)["state"], "done")
        self.homes = [self.daemon.home(number) for number in self.numbers]

    def fsck(self, code, *fragments, mend=False):
        before = content(self.data)
        outcome = program.run("fsck", "--data", self.data, *(["--mend"] if mend else []))
        self.assertEqual(outcome.code, code, outcome)
        for fragment in fragments:
            self.assertIn(fragment, outcome.out + outcome.err)
        if not mend:
            self.assertEqual(content(self.data), before, "something was changed")
        return outcome

    def in_queue(self, *statements):
        with sqlite3.connect(self.data / "queue.db") as queue:
            for statement in statements:
                queue.execute(statement)
        queue.close()

    def test_each_thing_that_is_wrong(self):
        outcome = program.run("fsck", "--data", self.data)  # while somebody else writes there
        self.assertEqual(outcome.code, 2, outcome)
        self.assertIn("a daemon works here", outcome.err)
        self.daemon.end()
        self.fsck(0, "4 jobs, 4 folders, 0 in quarantine: nothing is wrong")
        first, second, third, fourth = self.homes
        with open(first / "result.h5", "r+b") as file:
            file.seek(100)
            byte = file.read(1)
            file.seek(100)
            file.write(bytes([byte[0] ^ 1]))
        (second / "result.h5").write_bytes(b"short")
        (second / "attempt-1/ending.json").write_text("{")
        (third / "job.json").write_text("no notes")
        self.in_queue(f"UPDATE jobs SET ranks = -1 WHERE id = {self.numbers[3]}")
        stray = self.data / "jobs" / ("0" * 32)
        stray.mkdir()
        (stray / "unfinished").touch()
        (self.data / "jobs/letter").mkdir()
        (self.data / "jobs/letter/text").write_text("unread")
        text = self.fsck(2, "its result is not what was written", "its result has 5 bytes", "cannot be read", "has no notes",
                         "its row in the queue is damaged", "was promised to nobody", "jobs/letter belongs to no job", "7 things").out  # fmt: skip
        self.assertEqual(len(text.splitlines()), 8, text)
        # What can be mended is; results that are spoilt stay as they are, and told.
        self.fsck(2, "its result is not what was written", "its result has 5 bytes", "1 in quarantine", mend=True)
        after = self.fsck(2).out
        self.assertNotIn("row in the queue", after)
        self.assertNotIn("promised to nobody", after)
        self.daemon.start()
        self.assertEqual(self.daemon.job(self.numbers[3])["state"], "done")
        self.assertEqual(self.daemon.wait(self.accepted(self.daemon.submit()))["state"], "done")

    def test_queues_that_are_lost(self):
        self.daemon.end()
        shutil.rmtree(self.homes[0])
        self.fsck(2, f"job {self.numbers[0]}: its folder")
        for spoil in (lambda path: path.write_bytes(b"no database" * 1000), lambda path: path.unlink()):
            spoil(self.data / "queue.db")
            self.fsck(2, "queue.db")
            self.fsck(0, "3 jobs, 3 folders", "nothing is wrong", mend=True)

    def test_folders_of_others(self):
        with program.temporary_folder() as folder:
            self.assertEqual(program.run("fsck", "--data", folder).code, 2)
            self.assertEqual(list(Path(folder).iterdir()), [])


if __name__ == "__main__":
    unittest.main()
