# ranks: 1
# timeout: 180
"""What a daemon keeps: a folder that is not its own is left alone, and whatever happens to the queue, its rows, its disk
or its folders, no job is lost, none comes twice, and everything goes on."""

import contextlib
import json
import os
import shutil
import sqlite3
import subprocess
import sys
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "faults"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import disk
import program
from daemon import BALL, LONG
from service_test import InService

VERSION_1 = """CREATE TABLE jobs (id INTEGER PRIMARY KEY AUTOINCREMENT, state TEXT NOT NULL, title TEXT NOT NULL,
  ranks INTEGER NOT NULL, priority INTEGER NOT NULL, work TEXT NOT NULL, {more});
CREATE TABLE queue (name TEXT NOT NULL); INSERT INTO queue VALUES ('1a2b3c4d');"""
REST = """key TEXT UNIQUE, digest TEXT NOT NULL, report TEXT NOT NULL, bytes INTEGER NOT NULL, submitted REAL NOT NULL,
  started REAL, finished REAL, attempt INTEGER NOT NULL DEFAULT 0, stop_asked INTEGER NOT NULL DEFAULT 0, exit INTEGER,
  signal INTEGER, message TEXT NOT NULL DEFAULT '', result_bytes INTEGER NOT NULL DEFAULT 0,
  result_sha256 TEXT NOT NULL DEFAULT ''"""
WORK = {"verb": "run", "set": [], "options": [], "wall_limit": 0.0, "memory": 0}


def content(folder):
    """Names, modes and bytes below a folder."""
    found = {".": folder.stat().st_mode}
    for path in sorted(folder.rglob("*")):
        found[str(path.relative_to(folder))] = (path.lstat().st_mode, path.read_bytes() if path.is_file() else None)
    return found


class Folders(unittest.TestCase):
    def setUp(self):
        temporary = program.temporary_folder()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name) / "data"
        self.folder.mkdir(mode=0o755)

    def refused(self, *fragments):
        before = content(self.folder)
        outcome = program.run("serve", "--data", self.folder, "--listen", "127.0.0.1:0")
        self.assertEqual(outcome.code, 2, outcome)
        for fragment in fragments:
            self.assertIn(fragment, outcome.err)
        self.assertEqual(content(self.folder), before, "something was changed")

    def test_folders_of_others_are_left_alone(self):
        (self.folder / "jobs").mkdir()
        (self.folder / "jobs/application.txt").write_text("years of work")
        (self.folder / "incoming").mkdir()
        (self.folder / "incoming/letter.txt").write_text("unread")
        self.refused("sweepvi-data", "choose an empty one")
        for name in ("notes.txt", ".hidden", "queue.db", "lock"):
            for path in list(self.folder.iterdir()):
                shutil.rmtree(path) if path.is_dir() else path.unlink()
            (self.folder / name).write_text("not yours")
            self.refused("sweepvi-data")
        (self.folder / "lock").unlink()
        with sqlite3.connect(self.folder / "queue.db") as queue:  # of a print server, say
            queue.execute("CREATE TABLE jobs (id INTEGER, printer TEXT)")
        queue.close()
        self.refused("sweepvi-data")

    def test_folders_that_others_may_write(self):
        self.folder.chmod(0o777)
        self.refused("others may write", "chmod go-w")
        self.folder.chmod(0o755)
        try:
            os.chown(self.folder, 65534, 65534)
        except OSError:  # who is not root gives nothing away
            return
        self.refused("not yours")

    def test_what_is_no_folder(self):
        self.folder.rmdir()
        self.folder.write_text("")
        outcome = program.run("serve", "--data", self.folder, "--listen", "127.0.0.1:0")
        self.assertEqual((outcome.code, self.folder.read_text()), (2, ""), outcome)

    def test_later_versions(self):
        with daemon.Daemon(self.folder.parent) as server:
            server.submit()
        with sqlite3.connect(self.folder / "queue.db") as queue:
            queue.execute("PRAGMA user_version = 99")
        queue.close()
        outcome = program.run("serve", "--data", self.folder, "--listen", "127.0.0.1:0")
        self.assertEqual(outcome.code, 2, outcome)
        self.assertIn("later version", outcome.err)

    def test_earlier_versions(self):
        """With all columns that version 1 had, and with those only that no version can do without."""
        for columns in (REST, "digest TEXT"):
            with self.subTest(columns=columns[:20]):
                shutil.rmtree(self.folder)
                (self.folder / "incoming/0123456789abcdef").mkdir(parents=True)
                home = self.folder / "jobs/7"
                home.mkdir(parents=True)
                (home / "scene.toml").write_text(BALL)
                (home / "files.json").write_text("{}")
                with sqlite3.connect(self.folder / "queue.db") as queue:
                    queue.executescript(VERSION_1.format(more=columns))
                    more = ", key, digest, report, bytes, submitted" if columns == REST else ""
                    values = ", 'old', 'x', '', 1, 1.7e9" if columns == REST else ""
                    queue.execute(f"INSERT INTO jobs (id, state, title, ranks, priority, work{more}) "
                                  f"VALUES (7, 'queued', 's.toml', 1, 0, ?{values})", (json.dumps(WORK),))
                queue.close()
                with daemon.Daemon(self.folder.parent) as server:
                    self.assertEqual(server.wait(7)["state"], "done")
                    self.assertEqual(server.submit().json["id"], 8)
                    self.assertEqual(server.wait(8)["state"], "done")
                    self.assertEqual(server.wrong, [])


class Kept(InService):
    def restart(self, change):
        self.daemon.kill()
        change()
        self.daemon.start()

    def done(self, **how):
        number = self.accepted(self.daemon.submit(**how))
        self.assertEqual(self.daemon.wait(number)["state"], "done")
        return number, self.daemon.ask("GET", f"/v1/jobs/{number}/result").body

    def in_queue(self, *statements):
        with sqlite3.connect(self.daemon.data / "queue.db") as queue:
            for statement in statements:
                queue.execute(statement)
        queue.close()

    def queue_files(self):
        return list(self.daemon.data.glob("queue.db*"))

    def test_queues_that_are_gone_or_damaged(self):
        """Results stay, what runs is found again, what waits is run, numbers and keys keep their jobs."""

        def lose():
            for path in self.queue_files():
                path.unlink()

        def lose_all_but_the_log():
            (self.daemon.data / "queue.db").unlink()

        def overwrite():
            for path in self.queue_files():
                path.unlink()
            (self.daemon.data / "queue.db").write_bytes(b"no database at all" * 1000)

        def damage():
            path = self.daemon.data / "queue.db"
            self.in_queue("PRAGMA wal_checkpoint(TRUNCATE)")
            pages = bytearray(path.read_bytes())
            pages[4096:] = bytes(len(pages) - 4096)
            path.write_bytes(pages)

        for change in (lose, lose_all_but_the_log, overwrite, damage):
            with self.subTest(change=change.__name__):
                number, result = self.done(key=change.__name__)
                running = self.accepted(self.daemon.submit(LONG, set=["time.end=300"]))
                self.daemon.wait_for_progress(running)
                waiting = self.accepted(self.daemon.submit(ranks=2))
                self.restart(change)
                job = self.daemon.wait(number)
                self.assertEqual(job["state"], "done", job)
                self.assertEqual(self.daemon.ask("GET", f"/v1/jobs/{number}/result").body, result)
                self.assertEqual(self.daemon.submit(key=change.__name__).json["id"], number)
                for one in (running, waiting):
                    job = self.daemon.wait(one)
                    self.assertEqual((job["state"], job["attempt"]), ("done", 1), job)
                self.assertGreater(self.accepted(self.daemon.submit()), waiting)

    def test_folders_that_nobody_knows(self):
        number, _ = self.done()
        stray, unfinished = self.daemon.data / "jobs/stray", self.daemon.data / "jobs/0123abcd"

        def change():
            stray.mkdir()
            (stray / "result.h5").write_text("somebody's")
            unfinished.mkdir()
            (unfinished / "unfinished").touch()
            shutil.rmtree(self.daemon.home(number))

        self.restart(change)
        self.assertFalse(unfinished.exists(), "nobody was promised anything of it")
        kept = [path.read_text() for path in self.daemon.data.glob("quarantine/stray-*/result.h5")]
        self.assertEqual((stray.exists(), kept), (False, ["somebody's"]))
        self.assertIn("belongs to no job", self.daemon.log())
        self.assertEqual(self.daemon.job(number)["state"], "done")
        self.refused(self.daemon.ask("GET", f"/v1/jobs/{number}/result"), 404, "no such file")
        # A job whose folder is gone before it runs fails, and the next one does not.
        blocker = self.accepted(self.daemon.submit(LONG, ranks=2))
        lost = self.accepted(self.daemon.submit())
        shutil.rmtree(self.daemon.home(lost))
        self.daemon.ask("POST", f"/v1/jobs/{blocker}/cancel")
        self.assertEqual(self.daemon.wait(lost)["state"], "failed")
        self.done()

    def test_bad_rows(self):
        """Each is told and left alone; all others are listed and run. One whose folder has its notes comes back."""
        good, result = self.done()
        last = good
        spoilt = ("work = 'no json'", "work = '[]'", """work = '{"verb": "dance"}'""", "work = '{}'", "state = 'asleep'", "ranks = -1",
                  "submitted = 'long ago'", "submitted = -1e300", "folder = '../../etc'", "folder = '/'", "folder = ''", "attempt = -5",
                  "result_sha256 = 'zz'", "work = x'fffe'", "title = x'ff1b5b41'", "message = x'ff00'")
        # Without notes, as those of an earlier version.
        values = ", ".join(f"({900 + i}, 'queued', 't', 1, 99, '{json.dumps(WORK)}', 'd', 'r', 1, 1.0, 'f{i}')"
                           for i in range(len(spoilt)))
        changes = [f"UPDATE jobs SET {change} WHERE id = {900 + i}" for i, change in enumerate(spoilt)]
        insert = f"INSERT INTO jobs (id, state, title, ranks, priority, work, digest, report, bytes, submitted, folder) VALUES {values}"
        self.restart(lambda: self.in_queue(insert, *changes))
        self.assertGreater(self.accepted(self.daemon.submit()), last)
        answer = self.daemon.ask("GET", "/v1/jobs")
        self.assertEqual(answer.status, 200, answer.body)
        self.assertIn(good, [job["id"] for job in answer.json["jobs"]])
        self.assertEqual(self.daemon.ask("GET", "/healthz").status, 200)
        for i, change in enumerate(spoilt):
            answer = self.daemon.ask("GET", f"/v1/jobs/{900 + i}")
            self.assertIn(answer.status, (200, 500), change)  # some need no more than escapes
            if answer.status == 500:
                self.assertIn(f"job {900 + i} in the queue is damaged", self.daemon.log())
                self.assertIn("damaged", answer.json["error"])
        self.assertEqual(self.daemon.ask("DELETE", "/v1/jobs/900").status, 204)
        self.assertEqual(self.daemon.ask("GET", "/v1/jobs/900").status, 404)
        self.done()
        # With notes, as all of ours.
        for change in ("work = ''", "state = '?'", "folder = '..'"):
            self.restart(lambda change=change: self.in_queue(f"UPDATE jobs SET {change} WHERE id = {good}"))
            self.assertEqual(self.daemon.wait(good)["state"], "done", change)
            self.assertEqual(self.daemon.ask("GET", f"/v1/jobs/{good}/result").body, result)

    def test_a_log_that_nobody_can_write(self):
        """As on a full disk: what the daemon complains of stops neither its threads nor an answer."""
        values = "(900, 'queued', 't', 1, 99, 'no json', 'd', 'r', 1, 1.0, 'f')"
        insert = f"INSERT INTO jobs (id, state, title, ranks, priority, work, digest, report, bytes, submitted, folder) VALUES {values}"
        self.daemon.errors_to = "/dev/full"
        self.restart(lambda: self.in_queue(insert))
        self.assertEqual(self.daemon.ask("GET", "/v1/jobs/900").status, 500)
        self.done()
        self.assertIsNone(self.daemon.process.poll())

    def test_endings_that_cannot_be_read(self):
        number, _ = self.done()
        ending = self.daemon.home(number) / "attempt-1/ending.json"

        def change():
            ending.write_text('{"code": ')
            self.in_queue(f"UPDATE jobs SET state = 'running' WHERE id = {number}")

        self.restart(change)
        self.assertEqual(self.daemon.wait(number)["state"], "interrupted")
        self.done()

    def test_more_than_all_jobs_may_keep(self):
        """Jobs that run count, alone and together."""
        self.daemon.words = ("--max-disk", "20M")
        self.restart(lambda: None)
        scene = LONG.replace("every = 50", "every = 1").replace("count = 30", "count = 200")
        numbers = [self.accepted(self.daemon.submit(scene)) for _ in range(2)]
        most = 0
        while not all(self.daemon.job(number)["state"] in daemon.AT_REST for number in numbers):
            files = [path for path in self.daemon.data.glob("jobs/**/*") if path.is_file()]
            most = max(most, sum(path.stat().st_size for path in files if path.exists()))
            time.sleep(0.02)
        # What two jobs write in the half second until they are measured, and while they stop in order.
        self.assertLess(most, 60 << 20)
        states = [self.daemon.job(number) for number in numbers]
        self.assertIn("failed", [job["state"] for job in states])
        # By the daemon, or before it looks by the limit of a file's size that it gave them.
        self.assertTrue(any("disk" in job["message"] or "File too large" in job["message"] for job in states), states)
        for number in numbers:
            self.daemon.ask("DELETE", f"/v1/jobs/{number}")
        self.done()


def leave(folder, room):
    """Shrinks the disk until so much is left. A job may write meanwhile: a disk does not shrink below what it holds."""
    for _ in range(50):
        used = os.statvfs(folder)
        with contextlib.suppress(subprocess.CalledProcessError):
            return disk.resize(folder, (used.f_blocks - used.f_bfree) * used.f_frsize + room)
    raise AssertionError("something writes without a pause")


class FullDisk(unittest.TestCase):
    def test_submissions_at_every_stage_of_a_disk_that_fills(self):
        """Whatever was full, 507 is the answer, and once there is room everything works: no folder is left behind, no
        number stands for two jobs, the queue and the folders agree."""
        with program.temporary_folder() as folder, disk.small_disk(folder, 1 << 20):
            with daemon.Daemon(folder) as server:
                base = server.submit()
                server.wait(base.json["id"])
                filler, answers = Path(folder) / "filler", {}
                accepted = {base.json["id"]}
                # In steps of two pages: what a submission needs before its commit, at it and after it.
                for room in [*range(0, 80, 8), *range(80, 400, 80)]:
                    disk.resize(folder, 64 << 20)
                    filler.touch()
                    leave(folder, room * 1024)
                    for _ in range(2):
                        answer = server.submit(key=f"{room}")
                        answers[answer.status] = answers.get(answer.status, 0) + 1
                        if answer.status == 201:
                            self.assertNotIn(answer.json["id"], accepted, "a number was used again")
                            accepted.add(answer.json["id"])
                    self.assertEqual(server.ask("GET", "/v1/jobs").status, 200)
                    disk.resize(folder, 64 << 20)
                    again = server.submit(key=f"{room}")
                    self.assertIn(again.status, (200, 201), again.body)
                    accepted.add(again.json["id"])
                print(answers)
                self.assertLessEqual(set(answers), {200, 201, 507})
                self.assertGreater(answers.get(507, 0), 5)
                for number in accepted:
                    job = server.wait(number)
                    self.assertIn(job["state"], ("done", "failed", "interrupted"), job)
                listed = {job["id"] for job in server.ask("GET", "/v1/jobs?limit=1000").json["jobs"]}
                self.assertEqual(listed, accepted)
                homes = {server.home(number) for number in accepted}
                self.assertEqual(homes, set((Path(folder) / "data/jobs").iterdir()))
                server.kill()
                server.start()
                self.assertFalse((Path(folder) / "data/quarantine").exists())
                self.assertEqual({job["id"] for job in server.ask("GET", "/v1/jobs?limit=1000").json["jobs"]}, accepted)
                self.assertEqual(server.wrong, [])


if __name__ == "__main__":
    if not disk.enter_own_mounts():
        print("this system lets nobody mount a small disk (unshare --user --mount)")
        del FullDisk
    unittest.main()
