# ranks: 2
# labels: long
# timeout: 900
"""Cancelling and resuming at many moments of a run's start and of its writing."""

import random
import sys
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import recovery_test
from recovery_test import going_on


class ManyMoments(recovery_test.Stopping):
    moments = tuple(0.03 * i for i in range(40))

    def test_cancel_at_any_moment_of_a_run_that_writes_all_the_time(self):
        scene = recovery_test.SHORT.replace("every = 500", "every = 1\ncheckpoint = 0.001").replace("count = 60", "count = 4000")
        scene = scene.replace("end = 1500.0", "end = 1.0")
        moments = random.Random(8)
        for ranks in (1, 2):
            whole = self.undisturbed(scene, "--set", "output.checkpoint=0", ranks=ranks)
            for _ in range(10):
                number = self.accepted(self.daemon.submit(scene, ranks=ranks))
                self.daemon.wait_for_progress(number)
                for _ in range(2):
                    time.sleep(moments.random() * 2.0)
                    if self.daemon.ask("POST", f"/v1/jobs/{number}/cancel").status == 202:
                        if self.daemon.wait(number)["state"] == "cancelled":
                            self.resumed(number)
                job = self.daemon.wait(number)
                self.assertEqual(job["state"], "done", job)
                self.assertEqual(going_on.same_bits(whole, self.daemon.fetch(number, self.folder / "r.h5")), [])


def load_tests(loader, _tests, _pattern):
    names = ["test_cancel_at_any_moment_of_the_start", "test_cancel_at_any_moment_of_a_run_that_writes_all_the_time"]
    return loader.loadTestsFromNames(["ManyMoments." + name for name in names], sys.modules[__name__])


if __name__ == "__main__":
    unittest.main()
