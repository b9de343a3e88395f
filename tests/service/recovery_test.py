# ranks: 1
# labels: no-sanitize
# timeout: 240
"""Stopping, going on, and failures of runs."""

import contextlib
import json
import os
import signal
import sys
import threading
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import going_on
import program
from daemon import BALL, LONG
from service_test import InService

# A second or two on an idle machine, to be run whole and in parts.
SHORT = LONG.replace("end = 6000.0", "end = 1500.0").replace("count = 30", "count = 60").replace("every = 50", "every = 500")


class Stopping(InService):
    def undisturbed(self, scene, *words, ranks=1):
        (self.folder / "whole.toml").write_text(scene)
        name = f"whole{ranks}.h5"
        outcome = program.run("run", "whole.toml", "-o", name, *words, ranks=ranks, cwd=self.folder, timeout=60)
        self.assertEqual(outcome.code, 0, outcome)
        return self.folder / name

    @contextlib.contextmanager
    def held(self, number, ranks=1):
        """The run stands still meanwhile: no machine is so fast that it ends before a word reaches it."""
        self.daemon.wait_for_progress(number)
        self.assertEqual(daemon.signal_ranks(self.daemon.data, signal.SIGSTOP), ranks, "ended before it could be held")
        yield
        daemon.signal_ranks(self.daemon.data, signal.SIGCONT)

    def cancelled(self, number, timeout=20):
        answer = self.daemon.ask("POST", f"/v1/jobs/{number}/cancel")
        self.assertEqual(answer.status, 202, answer.body)
        return self.daemon.wait(number, timeout=timeout)

    def resumed(self, number, body=None):
        answer = self.daemon.ask("POST", f"/v1/jobs/{number}/resume", body)
        self.assertEqual(answer.status, 202, answer.body)

    def test_cancel_while_running_and_resume(self):
        for ranks in (1, 2):
            with self.subTest(ranks=ranks):
                scene = SHORT if ranks == 1 else SHORT.replace("end = 1500.0", "end = 600.0")  # waiting for each other takes time
                whole = self.undisturbed(scene, ranks=ranks)
                number = self.accepted(self.daemon.submit(scene, ranks=ranks))
                with self.held(number, ranks):
                    self.assertEqual(self.daemon.ask("POST", f"/v1/jobs/{number}/cancel").status, 202)
                job = self.daemon.wait(number)
                self.assertEqual((job["state"], job["exit"], job["checkpoint"]), ("cancelled", 4, True), job)
                self.assertIn("stopped by SIGUSR1 after step", job["message"])
                self.assertLess(job["progress"]["step"], job["progress"]["steps"])
                self.resumed(number)
                job = self.daemon.wait(number)
                self.assertEqual((job["state"], job["attempt"]), ("done", 2), job)
                result = self.daemon.fetch(number, self.folder / "parts.h5")
                self.assertEqual(going_on.same_bits(whole, result), [])

    def test_resumed_again_and_again(self):
        """Each key and each option keeps the value it was given last, and what check refuses is not kept at all."""
        number = self.accepted(self.daemon.submit(LONG))
        path = f"/v1/jobs/{number}/resume"
        for i in range(3):
            self.cancelled(number)
            for change in ({"set": ["model.colour=1"]}, {"set": [f"model.k{j}=1" for j in range(200)]}, {"options": ["-info"]},
                           {"set": [f"title='{j}{'x' * 4000}'" for j in range(150)], "options": ["-ksp_max_it"]},
                           {"set": ["time.step=-1"]}, {"colour": 1}):
                self.refused(self.daemon.ask("POST", path, json.dumps(change)), 400)
            title = "x" * 3000
            change = {"set": [f"title='{j}{title}'" for j in range(200)], "options": ["-snes_monitor", "-snes_max_it", str(50 + i)]}
            self.resumed(number, json.dumps(change))
            job = self.daemon.job(number)
            self.assertEqual(job["set"], [f"title='199{title}'"])
            self.assertEqual(job["options"], ["-snes_monitor", "-snes_max_it", str(50 + i)])
        self.cancelled(number)

    moments = (0.0, 0.1, 0.3)

    def test_cancel_at_any_moment_of_the_start(self):
        whole = self.undisturbed(BALL)
        for delay in self.moments:
            number = self.accepted(self.daemon.submit(BALL))
            time.sleep(delay)
            answer = self.daemon.ask("POST", f"/v1/jobs/{number}/cancel")
            self.assertIn(answer.status, (202, 409))
            job = self.daemon.wait(number)
            self.assertIn(job["state"], ("cancelled", "done"), job)
            if job["state"] == "cancelled":
                self.resumed(number)
                self.assertEqual(self.daemon.wait(number)["state"], "done")
            self.assertEqual(going_on.same_bits(whole, self.daemon.fetch(number, self.folder / "r.h5")), [], delay)

    def test_cancel_while_it_waits(self):
        first = self.accepted(self.daemon.submit(LONG, ranks=2))
        second = self.accepted(self.daemon.submit(BALL, ranks=2))
        answer = self.daemon.ask("POST", f"/v1/jobs/{second}/cancel").json
        self.assertEqual((answer["state"], answer["attempt"]), ("cancelled", 0))
        self.refused(self.daemon.ask("POST", f"/v1/jobs/{second}/cancel"), 409, "nothing to cancel")
        self.refused(self.daemon.ask("DELETE", f"/v1/jobs/{first}"), 409, "cancel it first")
        self.cancelled(first)
        self.resumed(second)
        self.assertEqual(self.daemon.wait(second)["state"], "done")

    def test_cancel_while_it_writes(self):
        # Every step is a row of thousands of numbers, and a checkpoint comes whenever there is time for one.
        scene = SHORT.replace("every = 500", "every = 1\ncheckpoint = 0.001").replace("count = 60", "count = 1000")
        scene = scene.replace("end = 1500.0", "end = 6.0")
        whole = self.undisturbed(scene, "--set", "output.checkpoint=0")
        number = self.accepted(self.daemon.submit(scene))
        with self.held(number):
            self.assertEqual(self.daemon.ask("POST", f"/v1/jobs/{number}/cancel").status, 202)
        job = self.daemon.wait(number)
        self.assertEqual((job["state"], job["checkpoint"]), ("cancelled", True), job)
        self.resumed(number)
        self.assertEqual(self.daemon.wait(number)["state"], "done")
        self.assertEqual(going_on.same_bits(whole, self.daemon.fetch(number, self.folder / "r.h5")), [])

    def test_a_run_that_does_not_listen_is_killed(self):
        self.daemon.kill()
        self.daemon.grace = 0.5
        self.daemon.start()
        number = self.accepted(self.daemon.submit(LONG))
        self.daemon.wait_for_progress(number)
        self.assertEqual(daemon.signal_ranks(self.daemon.data, signal.SIGSTOP), 1)
        begin = time.monotonic()
        job = self.cancelled(number)
        self.assertEqual(job["state"], "cancelled", job)
        self.assertLess(time.monotonic() - begin, 8)
        self.assertEqual(daemon.processes_of(self.daemon.data), [])

    @contextlib.contextmanager
    def stopped_supervisor(self, again):
        """It cannot look at anything, for good if somebody stops it again and again."""
        while not daemon.processes_of(self.daemon.data):
            time.sleep(0.02)
        (supervisor,) = daemon.supervisors_of(self.daemon.data)
        os.kill(supervisor, signal.SIGSTOP)
        done = threading.Event()

        def stop():
            while again and not done.wait(0.02):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(supervisor, signal.SIGSTOP)

        thread = threading.Thread(target=stop)
        thread.start()
        yield
        done.set()
        thread.join()
        with contextlib.suppress(ProcessLookupError):
            os.kill(supervisor, signal.SIGCONT)

    def test_supervisors_that_were_stopped(self):
        """Cancelling works, in order where they can be let go on; and so do limits of time."""
        self.daemon.kill()
        self.daemon.grace = 0.3
        self.daemon.start()
        number = self.accepted(self.daemon.submit(LONG))
        self.daemon.wait_for_progress(number)
        with self.stopped_supervisor(again=False):
            job = self.cancelled(number)
        self.assertEqual((job["state"], job["exit"], job["checkpoint"]), ("cancelled", 4, True), job)
        self.resumed(number)
        with self.stopped_supervisor(again=True):
            job = self.cancelled(number)
        self.assertEqual(job["state"], "cancelled", job)
        self.assertIn("its supervisor did not stop it", job["message"])
        self.assertEqual(daemon.processes_of(self.daemon.data) + daemon.supervisors_of(self.daemon.data), [])
        study = self.accepted(self.daemon.submit(LONG, verb="study", steps=[1e-3], repeats=1, wall_limit=1.0))
        with self.stopped_supervisor(again=True):
            job = self.daemon.wait(study)
        self.assertEqual(job["state"], "interrupted", job)
        self.assertIn("its supervisor did not stop it", job["message"])

    def test_order_by_priority_then_age(self):
        blocker = self.accepted(self.daemon.submit(LONG, ranks=2))
        numbers = [self.accepted(self.daemon.submit(BALL, ranks=2, priority=p)) for p in (0, -1, 5)]
        self.cancelled(blocker)
        jobs = [self.daemon.wait(number) for number in numbers]
        order = sorted(range(3), key=lambda i: jobs[i]["started"])
        self.assertEqual(order, [2, 0, 1])

    def test_time_limits(self):
        number = self.accepted(self.daemon.submit(LONG, wall_limit=0.5))
        job = self.daemon.wait(number)
        self.assertEqual((job["state"], job["exit"], job["checkpoint"]), ("interrupted", 4, True), job)
        self.assertIn("stopped by --wall-limit 0.5", job["message"])
        study = self.accepted(self.daemon.submit(LONG, verb="study", steps=[1e-3], repeats=1, wall_limit=1.0))
        self.assertIn("limit of time", self.daemon.wait(study)["message"])


class Failures(InService):
    words = ("--max-job-disk", "8M", "--max-memory", "4G")

    def test_a_solver_that_crashes(self):
        number = self.accepted(self.daemon.submit(LONG, set=["output.every=100000"]))
        for death, word in ((signal.SIGSEGV, "11"), (signal.SIGKILL, "9")):
            self.daemon.wait_for_progress(number)
            time.sleep(0.3)
            self.assertEqual(daemon.signal_ranks(self.daemon.data, death), 1)
            job = self.daemon.wait(number)
            self.assertEqual(job["state"], "failed", job)
            self.assertIn(word, job["message"], job)
            self.assertEqual(self.daemon.ask("GET", "/healthz").json["running"], 0)
            (self.daemon.home(number) / "progress").unlink()
            self.daemon.ask("POST", f"/v1/jobs/{number}/resume")

    def test_out_of_memory(self):
        # Enough to begin with, and not for what it needs.
        scene = LONG.replace("count = 30", "count = 200000").replace("every = 50", "every = 1")
        number = self.accepted(self.daemon.submit(scene, memory=700 << 20))
        job = self.daemon.wait(number)
        self.assertEqual(job["state"], "failed", job)
        self.assertRegex(job["message"].lower(), "memory|bad_alloc|alloc", job)
        self.refused(self.daemon.submit(BALL, memory=5 << 30), 400, "memory")
        number = self.accepted(self.daemon.submit())
        self.assertEqual(self.daemon.wait(number)["state"], "done")

    def test_out_of_disk(self):
        scene = LONG.replace("every = 50", "every = 1").replace("count = 30", "count = 300")
        number = self.accepted(self.daemon.submit(scene))
        job = self.daemon.wait(number)
        self.assertEqual(job["state"], "failed", job)
        self.assertRegex(job["message"], "disk|too large", job)
        number = self.accepted(self.daemon.submit())
        self.assertEqual(self.daemon.wait(number)["state"], "done")

    def test_what_cannot_be_solved(self):
        squeeze = """[time]
end = 1.0
step = 0.1
[model]
kind = "sweeping"
u0 = [0.0]
G = [[1], [-1]]
g = [-1, {offset = -1, amplitude = 2.5, frequency = 0.25}]
"""
        number = self.accepted(self.daemon.submit(squeeze))
        job = self.daemon.wait(number)
        self.assertEqual((job["state"], job["exit"]), ("failed", 3), job)
        self.assertIn("step 6", job["message"])
        self.assertEqual(self.daemon.ask("GET", f"/v1/jobs/{number}/result").status, 200)


if __name__ == "__main__":
    unittest.main()
