# ranks: 2
"""The sandbox of a confined process, tried from inside by sandbox_program on one and two ranks: what leads out of it is
refused, what a run needs is there, and nothing is left behind."""

import os
import socket
import subprocess
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program

PROBE = Path(os.environ["SWEEPVI_BUILD"]) / "tests/sandbox_program"

# What a run needs, and what touches nobody else.
ALLOWED = {
    "write-own",
    "replace-own",
    "read-own",
    "remove-own",
    "read-library",
    "read-status",
    "read-memory",
    "start-thread",
    "allocate",
    "signal-self",
    "messages",
    "file-of-all",
    "end",
}
REFUSED = set(
    "read-elsewhere read-by-dots read-by-link list-elsewhere write-elsewhere truncate-elsewhere remove-elsewhere"
    " move-elsewhere link-elsewhere make-link make-fifo make-folder-elsewhere environment-of-others memory-of-others"
    " read-passwd list-root write-temporary mode-of-own start-process start-program start-library-program run-memory"
    " signal-others signal-all trace-others read-others limit-others raise-own-limit other-user own-names connect-network"
    " connect-socket connect-abstract listen".split()
)
# Threads that MPI has started see the machine as it was when MPI started.
OF_MAIN_ONLY = {"environment-of-others", "memory-of-others"}


def has_sandbox():
    described = program.run("info").out
    return "no Landlock" not in described and "no seccomp" not in described


@unittest.skipUnless(has_sandbox(), "this kernel has no Landlock or no seccomp")
class Sandbox(unittest.TestCase):
    def setUp(self):
        temporary = program.temporary_folder()
        self.addCleanup(temporary.cleanup)
        base = Path(temporary.name)
        self.base, self.folder, self.elsewhere = base, base / "own", base / "elsewhere"
        for folder in (self.folder, self.elsewhere, base / "mpi"):
            folder.mkdir()
        (self.elsewhere / "secret").write_text("of somebody else")
        (self.folder / "link").symlink_to(self.elsewhere / "secret")
        self.network = socket.create_server(("127.0.0.1", 0))
        self.socket = socket.socket(socket.AF_UNIX)
        self.socket.bind(str(base / "socket"))
        self.socket.listen()
        self.abstract = socket.socket(socket.AF_UNIX)
        self.abstract.bind(b"\0sweepvi")
        self.abstract.listen()
        self.victim = subprocess.Popen(["sleep", "1000"])
        self.addCleanup(self.victim.wait)
        self.addCleanup(self.victim.kill)
        for end in (self.network, self.socket, self.abstract):
            self.addCleanup(end.close)

    def probe(self, ranks):
        words = [PROBE, self.folder, self.elsewhere, self.network.getsockname()[1], self.base / "socket", self.victim.pid]
        command = [str(word) for word in words]
        if ranks > 1:
            command = ["mpiexec", "--oversubscribe", "-n", str(ranks), *command]
        environment = {**os.environ, **program.ENVIRONMENT, "OMPI_MCA_orte_tmpdir_base": str(self.base / "mpi")}
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, env=environment, cwd=self.folder)
        self.assertEqual((done.returncode, done.stderr), (0, ""), done)
        self.assertEqual((self.elsewhere / "secret").read_text(), "of somebody else")
        self.assertEqual(os.listdir(self.elsewhere), ["secret"])
        self.assertIsNone(self.victim.poll())
        lines = [line.split() for line in done.stdout.splitlines()]
        shared = [line[3] for line in lines if line[2] == "shared-memory"]
        self.assertEqual([os.path.exists(folder) for folder in shared], [False] * ranks)
        return [line for line in lines if line[2] != "shared-memory"]

    def judge(self, ranks):
        found = {}
        for rank, where, what, answer in self.probe(ranks):
            if where == "thread" and what in OF_MAIN_ONLY:
                continue
            self.assertEqual(answer == "done", what in ALLOWED, (rank, where, what, answer))
            if answer != "done":
                self.assertIn(answer, {"EACCES", "EPERM", "EXDEV", "ENOSYS"}, (rank, where, what))
            found.setdefault((int(rank), where), set()).add(what)
        self.assertEqual(set(found), {(rank, where) for rank in range(ranks) for where in ("main", "thread")})
        for rank in range(ranks):
            self.assertEqual(found[rank, "main"], ALLOWED | REFUSED)

    def test_one_rank(self):
        self.judge(1)

    def test_two_ranks(self):
        self.judge(2)

    def test_without_sandbox_all_of_it_works(self):
        """Or the refusals above would say nothing of the sandbox."""
        self.assertTrue((self.folder / "link").read_text())
        os.kill(self.victim.pid, 0)
        for family, address in (
            (socket.AF_INET, self.network.getsockname()),
            (socket.AF_UNIX, str(self.base / "socket")),
            (socket.AF_UNIX, b"\0sweepvi"),
        ):
            with socket.socket(family) as end:
                end.connect(address)


if __name__ == "__main__":
    unittest.main()
