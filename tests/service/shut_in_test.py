# ranks: 1
"""What the processes of a job may do, as Linux tells it: no new privileges for all of them; for ranks and checks no
capabilities and a filter of system calls; nothing of the daemon's environment that programs do not need."""

import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import program
from daemon import LONG

SECRET = "a-key-of-somebodys-cloud"


def described(process):
    """(name of the program, status, environment)"""
    folder = Path(f"/proc/{process}")
    status = dict(line.split(":\t", 1) for line in (folder / "status").read_text().splitlines() if ":\t" in line)
    return (folder / "exe").resolve().name, status, (folder / "environ").read_bytes().split(b"\0")


class ShutIn(unittest.TestCase):
    def test_processes_of_a_job(self):
        temporary = program.temporary_folder()
        self.addCleanup(temporary.cleanup)
        given = {"CLOUD_SECRET_KEY": SECRET, "SWEEPVI_TOKEN": SECRET, "LC_TIME": "C", "SHELL_SECRET": SECRET}
        service = daemon.Daemon(temporary.name, env=given)
        self.addCleanup(service.end)
        number = service.submit(LONG, ranks=2).json["id"]
        service.wait_for_progress(number)
        found = [described(process) for process in daemon.processes_of(service.data)]
        names = [name for name, *_ in found]
        self.assertEqual(names.count("sweepvi"), 2, names)
        self.assertTrue({"orterun", "mpirun", "prterun"} & set(names), names)
        filters = "no seccomp" not in program.run("info").out
        for name, status, environment in found:
            self.assertEqual(status["NoNewPrivs"], "1", name)
            self.assertNotIn(SECRET.encode(), b"".join(environment), name)
            self.assertIn(b"LC_TIME=C", environment, name)
            if name == "sweepvi":
                self.assertEqual(int(status["CapEff"], 16) | int(status["CapPrm"], 16), 0)
                if filters:
                    self.assertEqual(status["Seccomp"], "2")
        # The supervisor belongs to it, and is found by its words.
        supervisors = [
            entry.name
            for entry in Path("/proc").iterdir()
            if entry.name.isdigit() and str(service.data).encode() in self.words_of(entry) and b"supervise" in self.words_of(entry)
        ]
        self.assertEqual(len(supervisors), 1)
        self.assertNotIn(SECRET.encode(), Path(f"/proc/{supervisors[0]}/environ").read_bytes())
        service.ask("POST", f"/v1/jobs/{number}/cancel")
        self.assertEqual(service.wait(number)["state"], "cancelled")

    @staticmethod
    def words_of(entry):
        try:
            return (entry / "cmdline").read_bytes()
        except OSError:
            return b""


if __name__ == "__main__":
    unittest.main()
