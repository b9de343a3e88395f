# ranks: 2
"""Scenes that no machine, or not this one, can hold say so at once: exit 2, nothing written."""

import os
import resource
import unittest

import program

SCENE = """
[time]
end = 1.0
step = 1e-3
[model]
kind = "chain"
element = "contact"
count = 10
"""

# s of processor time, whatever else the machine does. Starting MPI and PETSc takes 0.1 s; sanitizers get their share.
QUICK = 10.0


def spent():
    """Processor time of all that this process has run."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


class Large(unittest.TestCase):
    def refused(self, message, *words, verb="run", ranks=1):
        with program.temporary_folder() as folder:
            scene = program.Path(folder) / "scene.toml"
            scene.write_text(SCENE)
            before = program.content(folder)
            start = spent()
            outcome = program.run(verb, scene, *words, ranks=ranks, cwd=folder)
            seconds = spent() - start
            self.assertEqual(outcome.code, 2, outcome)
            self.assertIn(message, outcome.err)
            self.assertEqual(program.content(folder), before, outcome)
            self.assertLess(seconds, QUICK, outcome)

    def test_count(self):
        for count in ("3000000000", "1e9", "9223372036854775807"):
            self.refused("expected at most 536870911", "--set", f"model.count={count}")

    def test_steps(self):
        for step in ("1e-300", "4.6566128709e-10"):  # 2^31 - 1 steps are the most: 1 s of 4.6566128752e-10 s
            self.refused("steps; expected at most 2147483647", "--set", f"time.step={step}")

    # 5e8 elements of two states: at least 250 GB.
    def test_memory(self):
        for verb in ("run", "check"):
            for ranks in (1, 2):
                words = ["--set", "model.count=500000000", "-sweepvi_memory_limit", "100"]
                self.refused("at least 250 GB of memory", *words, verb=verb, ranks=ranks)

    # 1e7 elements need 5 GB or more: without the option it is the limit of the process that is too low.
    @unittest.skipIf("ASAN_OPTIONS" in os.environ, "the address sanitizer maps terabytes")
    def test_address_space(self):
        limits = resource.getrlimit(resource.RLIMIT_AS)
        resource.setrlimit(resource.RLIMIT_AS, (3 << 30, limits[1]))
        try:
            self.refused("(ulimit -v)", "--set", "model.count=10000000")
        finally:
            resource.setrlimit(resource.RLIMIT_AS, limits)

    def test_estimate(self):
        with program.temporary_folder() as folder:
            scene = program.Path(folder) / "scene.toml"
            scene.write_text(SCENE)
            outcome = program.run("check", scene)
            self.assertRegex(outcome.out, r"memory estimate +[0-9.]+ MB over all ranks; [0-9.]+ .B available")


if __name__ == "__main__":
    unittest.main()
