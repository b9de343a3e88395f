# ranks: 1
# labels: no-sanitize
# timeout: 240
"""A daemon that is killed finds its runs again, and what nobody watched any more is told so."""

import signal
import sqlite3
import sys
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import program
from daemon import BALL, LONG
from service_test import InService


class Killed(InService):
    def test_running_jobs_are_found_again(self):
        number = self.accepted(self.daemon.submit(LONG))
        waiting = self.accepted(self.daemon.submit(BALL, ranks=2, key="waits"))
        self.daemon.wait_for_progress(number)
        self.daemon.kill()
        self.assertNotEqual(daemon.processes_of(self.daemon.data), [], "the run died with the daemon")
        self.daemon.start()
        self.assertEqual(self.daemon.submit(BALL, ranks=2, key="waits").json["id"], waiting)
        for one in (number, waiting):
            job = self.daemon.wait(one)
            self.assertEqual((job["state"], job["attempt"]), ("done", 1), job)

    def test_a_run_that_ends_without_a_daemon(self):
        number = self.accepted(self.daemon.submit())
        while not (self.daemon.home(number) / "attempt-1/claim").exists():
            time.sleep(0.005)
        self.daemon.kill()
        time.sleep(2.0)
        self.daemon.start()
        job = self.daemon.wait(number, timeout=5)
        self.assertEqual((job["state"], job["attempt"]), ("done", 1), job)

    def test_runs_whose_supervisor_is_gone_are_interrupted(self):
        number = self.accepted(self.daemon.submit(LONG, set=["output.checkpoint=0.01"]))
        self.daemon.wait_for_progress(number)
        self.daemon.kill()
        for process in Path("/proc").iterdir():
            try:
                words = (process / "cmdline").read_bytes().split(b"\0")
            except OSError:
                continue
            if b"supervise" in words and str(self.daemon.data).encode() in words[-2]:
                daemon.os.kill(int(process.name), signal.SIGKILL)
        self.daemon.start()
        job = self.daemon.wait(number)
        self.assertEqual((job["state"], job["checkpoint"]), ("interrupted", True), job)
        self.assertEqual(daemon.processes_of(self.daemon.data), [])
        scratch = self.daemon.home(number) / "attempt-1/scratch"
        self.assertTrue(scratch.is_symlink() and not scratch.exists(), "MPI's files are left behind")
        self.assertEqual(self.daemon.ask("POST", f"/v1/jobs/{number}/resume").status, 202)
        self.assertEqual(self.daemon.wait(number)["state"], "done")

    def test_started_but_never_launched(self):
        # As if killed between the two: the queue says that it runs, and nobody ever began.
        number = self.accepted(self.daemon.submit())
        self.daemon.wait(number)
        self.daemon.kill()
        with sqlite3.connect(self.daemon.data / "queue.db") as queue:
            queue.execute("UPDATE jobs SET state = 'running', attempt = 2 WHERE id = ?", (number,))
        queue.close()
        self.daemon.start()
        job = self.daemon.wait(number)
        self.assertEqual((job["state"], job["attempt"]), ("done", 3), job)

    def test_one_daemon_for_one_folder(self):
        outcome = program.run("serve", "--data", self.daemon.data, "--listen", "127.0.0.1:0")
        self.assertEqual(outcome.code, 2, outcome)
        self.assertIn("another daemon works here", outcome.err)


if __name__ == "__main__":
    unittest.main()
