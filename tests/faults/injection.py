"""File calls that fail, one by one: a run with checkpoints, a job's life, and a daemon's start are gone through again and
again, and each time another of their file calls fails (fault_injection.cpp), in one of the ways of FAULTS.

Whatever failed: nothing that was whole, promised or computed before is lost, nothing is done twice, what is told is true, and
once nothing fails any more everything goes on to the same bits."""

import contextlib
import errno
import mmap
import os
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import threading
import time
import uuid
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "service"))
import daemon
import faults
import program
import same_bits
from faults import CHECKPOINT, FILE

LIBRARY = Path(os.environ["SWEEPVI_BUILD"]) / "tests/fault_injection.so"
SHORT = 0  # half of what is written is not, and then the disk is full


@dataclass(frozen=True)
class Fault:
    name: str
    error: int
    all_later: bool


EIO = Fault("EIO once", errno.EIO, False)
FULL = Fault("ENOSPC from then on", errno.ENOSPC, True)
HALF = Fault("half a write, then ENOSPC", SHORT, True)
FAULTS = EIO, FULL, HALF


class Control:
    """What fault_injection.cpp counts and fails, of all processes that have the environment."""

    LAYOUT = "=QQQQq256s"

    def __init__(self, folder, *programs):
        self.folder, self.programs = Path(folder).resolve(), programs
        self.file = tempfile.NamedTemporaryFile(prefix="sweepvi_")
        self.file.write(bytes(struct.calcsize(self.LAYOUT)))
        self.file.flush()
        self.memory = mmap.mmap(self.file.fileno(), 0)

    def environment(self):
        return {
            "LD_PRELOAD": str(LIBRARY),
            "SWEEPVI_INJECT_CONTROL": self.file.name,
            "SWEEPVI_INJECT_FOLDER": str(self.folder),
            "SWEEPVI_INJECT_PROGRAMS": ",".join(self.programs),
        }

    def arm(self, number, fault):
        """Lets call `number` from now on fail."""
        self.disarm()
        self.memory[32:40] = struct.pack("=q", fault.error)
        self.memory[24:32] = struct.pack("=Q", fault.all_later)
        self.memory[16:24] = struct.pack("=Q", number)

    def disarm(self):
        """Nothing fails any more, and the count begins anew."""
        self.memory[16:24] = bytes(8)
        self.memory[:] = bytes(len(self.memory))

    def read(self):
        return struct.unpack(self.LAYOUT, self.memory[:])

    @property
    def calls(self):
        return self.read()[0]

    @property
    def failed(self):
        return self.read()[1]

    @property
    def what(self):
        return self.read()[5].rstrip(b"\0").decode(errors="replace")


class Outcomes:
    """What came of the calls that failed: so many of each kind, and what was wrong."""

    def __init__(self, name):
        self.name, self.kinds, self.wrong, self.lock = name, Counter(), [], threading.Lock()

    def count(self, kind):
        with self.lock:
            self.kinds[kind] += 1

    @contextlib.contextmanager
    def judged(self, number, control):
        """What is asserted within belongs to the call `number`."""
        try:
            yield
        except AssertionError as error:
            with self.lock:
                self.wrong.append(f"call {number} ({control.what}): {error}")

    def report(self, verdict):
        kinds = ", ".join(f"{kind} {count}" for kind, count in sorted(self.kinds.items()))
        verdict.expect(not self.wrong, f"{self.name}: {sum(self.kinds.values())} calls failed: {kinds}")
        for text in self.wrong:
            print("   ", text, flush=True)


def complaints(err):
    """What the program said, without what MPI adds; once where all ranks said it."""
    said = [re.sub(r"\[rank [0-9]+\] ", "", line) for line in err.splitlines() if line.startswith("sweepvi: ")]
    return list(dict.fromkeys(said))


# ---- runs with checkpoints ----

CASE = faults.Case(
    "jerk chain",
    "jerk_chain/scene.toml",
    ("model.count=12", "time.step=0.1", "time.end=1", "output.every=1", "output.checkpoint=1e-9"),
)
OTHER = faults.Case("an earlier result", CASE.scene, (*CASE.settings[1:], "model.count=9"))
MORE = ["--summary", "summary.json", "--progress", "progress"]
BESIDE = {"summary.json", "progress"}


class Runs:
    """A run whose folder and words are given; each time in a copy of the folder."""

    def __init__(self, name, template, words, ranks, expected):
        self.name, self.template, self.words, self.ranks, self.expected = name, Path(template), words, ranks, expected
        self.before = program.content(template)

    def run(self, folder, words, env=None):
        return program.run(*CASE.words(), "-o", FILE, *MORE, *words, ranks=self.ranks, cwd=folder, env=env, timeout=30)

    def whole(self, folder):
        path = Path(folder) / FILE
        return path.exists() and not same_bits.differences(path, self.expected)

    def go_through(self, numbers, fault, verdict):
        outcomes = Outcomes(f"{self.name}, {self.ranks} rank{'s'[: self.ranks - 1]}, {fault.name}")
        kept = program.run_all(lambda number: self.fail(number, fault, outcomes), numbers, ranks=self.ranks)
        first = min((number for number, checkpoint in zip(numbers, kept) if checkpoint), default=None)
        if self.ranks == 1 and first is not None:  # else the calls of ranks come in no order
            lost = [number for number, checkpoint in zip(numbers, kept) if number > first and checkpoint is False]
            if lost:
                outcomes.wrong.append(f"call {first} left a checkpoint, and {lost} left none")
        outcomes.report(verdict)

    def fail(self, number, fault, outcomes):
        """Whether there is something to go on from; None where the run was done, or did not come so far."""
        with program.temporary_folder() as folder:
            shutil.copytree(self.template, folder, dirs_exist_ok=True)
            control = Control(folder, "sweepvi")
            control.arm(number, fault)
            with outcomes.judged(number, control):
                try:
                    outcome = self.run(folder, self.words, control.environment())
                except AssertionError:
                    # Open MPI has one rank close what the other waits to open.
                    if self.ranks == 1 or not control.what.startswith("open "):
                        raise
                    outcomes.count("ranks wait in MPI_File_open")
                    return None
                if control.failed == 0:
                    outcomes.count("(no such call)")
                    assert outcome.code == 0 and self.whole(folder), outcome
                    return None
                outcomes.count("harmless" if outcome.code == 0 else f"exit {outcome.code}")
                return self.judge(folder, outcome, control)

    def judge(self, folder, outcome, control):
        left = set(os.listdir(folder))
        told = complaints(outcome.err)
        there = f"exit {outcome.code}, left {sorted(left)}, said {told[-2:]}"
        failures = [line for line in told if "The run goes on" not in line and "warning" not in line]
        # What could not be removed is told, and stays.
        removal = control.what.startswith(("unlink", "remove"))
        assert outcome.code in (0, 5), there
        if outcome.code == 0:
            assert self.whole(folder) and not failures, there
            assert left <= {FILE, *BESIDE} or removal, there
            assert CHECKPOINT not in left or told, there
            return None
        assert len(failures) == 1, there
        whole = self.whole(folder)
        old = FILE in self.before and program.content(folder).get(FILE) == self.before[FILE]
        assert whole or old or FILE not in left, f"{FILE} is neither the new one nor what it was; {there}"
        left = {name for name in left if ".locktest." not in name}  # Open MPI's
        known = {FILE, f"{FILE}.partial", CHECKPOINT, *BESIDE, *self.before}
        if "--restart" in self.words:
            known.add(f"{FILE}.restart")
        if self.ranks > 1:  # it had to be left in the middle, as if it were killed
            known.add(f"{CHECKPOINT}.reserve")
        assert left <= known or removal, f"unknown files; {there}"
        if CHECKPOINT in left:
            assert CHECKPOINT in failures[0] or "--restart" in self.words, f"{CHECKPOINT} is not told; {there}"
            words = ["--restart", CHECKPOINT]
        else:
            assert whole or CHECKPOINT not in self.before, f"the checkpoint is gone; {there}"
            words = self.words if "--restart" in self.words and not whole else ["--force"]
        again = self.run(folder, words)
        now = sorted(os.listdir(folder))
        now = [name for name in now if ".locktest." not in name]
        assert again.code == 0 and self.whole(folder), f"does not go on; {there}: {complaints(again.err)}, {again.code}"
        assert set(now) <= {FILE, *BESIDE}, f"in the end there are {now}; {there}"
        return whole or CHECKPOINT in left


KINDS = "a run", "a run over an earlier result", "going on from a checkpoint", "going on from a stopped file"


@contextlib.contextmanager
def runs(*ranks, kinds=KINDS):
    """Runs of all kinds, each in a folder of its own."""
    with contextlib.ExitStack() as stack:

        def folder():
            return Path(stack.enter_context(program.temporary_folder()))

        result = []
        for n in ranks:
            expected, _ = faults.undisturbed(CASE, n, folder())
            fresh = Runs(KINDS[0], folder(), [], n, expected)
            for kind in kinds:
                template, words = folder(), []
                if kind == KINDS[1]:
                    faults.undisturbed(OTHER, n, template)
                    words = ["--force"]
                elif kind == KINDS[2]:
                    control = Control(template, "sweepvi")
                    control.arm(150, FULL)
                    outcome = fresh.run(template, [], control.environment())
                    assert (template / CHECKPOINT).exists(), outcome
                    words = ["--restart", CHECKPOINT]
                elif kind == KINDS[3]:
                    outcome = fresh.run(template, ["--wall-limit", "1e-9"])
                    assert outcome.code == 4 and (template / FILE).exists(), outcome
                    (template / CHECKPOINT).unlink()
                    words = ["--restart", FILE]
                result.append(Runs(kind, template, words, n, expected))
        yield result


# ---- the service ----

SQUEEZE = """[time]
end = 1.0
step = 0.1
[model]
kind = "sweeping"
u0 = [0.0]
G = [[1], [-1]]
g = [-1, {offset = -1, amplitude = 2.5, frequency = 0.25}]
"""
PROGRAMS = "sweepvi-serve", "sweepvi"


class Jobs:
    """A daemon with its data folder, and what it has promised."""

    def __init__(self, folder, started=True):
        self.folder = Path(folder).resolve()
        self.control = Control(self.folder / "data", *PROGRAMS)
        self.server = daemon.Daemon(self.folder, env=self.control.environment(), started=started)
        self.expected = self.folder / "expected.h5"
        (self.folder / "ball.toml").write_text(daemon.BALL)
        outcome = program.run("run", "ball.toml", "-o", self.expected, cwd=self.folder)
        assert outcome.code == 0, outcome

    def end(self):
        self.control.disarm()
        self.server.end()

    def state(self, number):
        """None where it cannot be told now."""
        answer = self.server.ask("GET", f"/v1/jobs/{number}")
        assert answer.status == 200 or answer.status >= 500, answer.body
        return answer.json if answer.status == 200 else None

    def at_rest(self, number, seconds):
        deadline = time.monotonic() + seconds
        while time.monotonic() < deadline:
            job = self.state(number)
            if job and job["state"] in daemon.AT_REST:
                return job
            time.sleep(0.05)
        return None

    def listed(self):
        jobs = self.server.ask("GET", "/v1/jobs?limit=1000").json["jobs"]
        numbers = [job["id"] for job in jobs]
        assert len(numbers) == len(set(numbers)), f"listed twice: {numbers}"
        return {job["id"]: job["state"] for job in jobs}

    def right(self, number):
        answer = self.server.ask("GET", f"/v1/jobs/{number}/result")
        assert answer.status == 200, answer.body
        path = self.folder / "result.h5"
        path.write_bytes(answer.body)
        wrong = same_bits.differences(path, self.expected)
        assert not wrong, f"the result of job {number} differs in {wrong}"

    def to_its_end(self, number, seconds=30):
        """A job at rest that did not come to its end is told why, and resumed until it has."""
        job = self.at_rest(number, seconds)
        assert job, f"job {number} does not come to an end: {self.state(number)}"
        outcome = job["state"]
        if outcome != "done":
            assert job["message"], job
            answer = self.server.ask("POST", f"/v1/jobs/{number}/resume")
            assert answer.status == 202, answer.body
            job = self.at_rest(number, seconds)
            assert job and job["state"] == "done", job
        self.right(number)
        return outcome

    def restart(self):
        self.server.kill()
        self.server.start()

    def agree(self):
        """Queue and folders."""
        homes = {self.server.home(number).name for number in self.listed()}
        there = set(os.listdir(self.server.data / "jobs"))
        assert homes == there, f"folders without a job: {there - homes}, jobs without a folder: {homes - there}"
        assert not (self.server.data / "quarantine").exists(), "something was set aside"

    def live(self, number, fault, outcomes):
        """A job's life while call `number` fails."""
        before = self.listed()
        with outcomes.judged(number, self.control):
            key = uuid.uuid4().hex
            self.control.arm(number, fault)
            answer = self.server.submit(key=key)
            assert answer.status == 201 or answer.status >= 500, answer.body
            promised = answer.json["id"] if answer.status == 201 else None
            if promised:
                job = self.at_rest(promised, 3 if fault.all_later else 20)
                if job and job["state"] == "done":
                    answer = self.server.ask("GET", f"/v1/jobs/{promised}/result")
                    assert answer.status == 200 or answer.status >= 500, answer.body
            failed, what = self.control.failed, self.control.what
            self.control.disarm()
            answer = self.server.submit(key=key)
            assert answer.status in (200, 201), answer.body
            one = answer.json["id"]
            assert promised in (None, one), f"job {promised} is now {one}"
            state = self.to_its_end(one)
            outcomes.count("(no such call)" if not failed else f"job {state}" if promised else "refused")
            assert set(self.listed()) == {*before, one}, f"{self.listed()}"
            self.restart()
            assert self.listed() == {**before, one: "done"}, f"{self.listed()}"
            self.agree()
            self.right(one)
            assert not self.server.wrong, self.server.wrong
            self.remove(one)

    def remove(self, one):
        answer = self.server.ask("DELETE", f"/v1/jobs/{one}")
        assert answer.status == 204, answer.body

    def be_removed(self, number, fault, outcomes):
        """A job is deleted while call `number` fails: it is gone, or still there."""
        with outcomes.judged(number, self.control):
            answer = self.server.submit()
            one = answer.json["id"]
            self.to_its_end(one)
            self.control.arm(number, fault)
            answer = self.server.ask("DELETE", f"/v1/jobs/{one}")
            assert answer.status == 204 or answer.status >= 500, answer.body
            failed, what = self.control.failed, self.control.what
            self.control.disarm()
            outcomes.count("(no such call)" if not failed else f"answer {answer.status}")
            if answer.status >= 500:
                self.right(one)
            self.restart()
            self.agree()
            still = one in self.listed()
            assert still == (answer.status >= 500), f"{what}: answer {answer.status}, job {one} in {self.listed()}"
            if answer.status >= 500:
                self.right(one)
                self.remove(one)

    def be_cancelled(self, number, fault, outcomes):
        """A job is cancelled while call `number` fails: it stops, now or once nothing fails any more."""
        with outcomes.judged(number, self.control):
            one = self.server.submit(daemon.LONG).json["id"]
            self.server.wait_for_progress(one)
            self.control.arm(number, fault)
            answer = self.server.ask("POST", f"/v1/jobs/{one}/cancel")
            assert answer.status == 202 or answer.status >= 500, answer.body
            self.at_rest(one, 1)
            failed = self.control.failed
            self.control.disarm()
            if answer.status >= 500:
                answer = self.server.ask("POST", f"/v1/jobs/{one}/cancel")
                assert answer.status == 202, answer.body
            job = self.at_rest(one, 15)
            assert job and job["state"] in ("cancelled", "failed", "interrupted"), self.state(one)
            outcomes.count("(no such call)" if not failed else f"job {job['state']}")
            self.remove(one)


def lives(numbers, fault, verdict, stage="live"):
    """Two daemons share the calls."""
    names = {"live": "a job's life", "be_removed": "a job is deleted", "be_cancelled": "a job is cancelled"}
    outcomes = Outcomes(f"{names[stage]}, {fault.name}")

    def work(part):
        with program.temporary_folder() as folder:
            jobs = Jobs(folder)
            try:
                for number in part:
                    getattr(jobs, stage)(number, fault, outcomes)
            finally:
                jobs.end()

    program.run_all(work, [numbers[::2], numbers[1::2]])
    outcomes.report(verdict)


class Starts:
    """A data folder with a job in each state, and daemons that start on copies of it."""

    def __init__(self, folder):
        self.template = Path(folder).resolve()
        server = daemon.Daemon(self.template)
        self.states = {}
        try:
            done = server.submit().json["id"]
            failed = server.submit(SQUEEZE).json["id"]
            interrupted = server.submit(daemon.LONG, wall_limit=0.3).json["id"]
            cancelled = server.submit(daemon.LONG).json["id"]
            for number in done, failed, interrupted:
                server.wait(number)
            server.ask("POST", f"/v1/jobs/{cancelled}/cancel")
            server.wait(cancelled)
            lost = server.submit(daemon.LONG, ranks=2).json["id"]
            waits = server.submit().json["id"]
            server.wait_for_progress(lost)
            self.states = {number: server.job(number)["state"] for number in (done, failed, interrupted, cancelled)}
            assert sorted(self.states.values()) == ["cancelled", "done", "failed", "interrupted"], self.states
            self.states |= {lost: "interrupted", waits: "done"}
        finally:
            server.kill()
            for process in supervisors(server.data) + daemon.processes_of(server.data):
                with contextlib.suppress(ProcessLookupError):
                    os.kill(process, signal.SIGKILL)
        unfinished = server.data / "jobs/0123abcd"
        unfinished.mkdir()
        (unfinished / "unfinished").touch()

    def go_through(self, numbers, fault, verdict):
        outcomes = Outcomes(f"a daemon's start, {fault.name}")
        program.run_all(lambda number: self.fail(number, fault, outcomes), numbers)
        outcomes.report(verdict)

    def fail(self, number, fault, outcomes):
        with program.temporary_folder() as folder:
            shutil.copytree(self.template / "data", Path(folder) / "data", symlinks=True)
            jobs = Jobs(folder, started=False)
            server = jobs.server
            try:
                with outcomes.judged(number, jobs.control):
                    jobs.control.arm(number, fault)
                    started = self.start(server)
                    if started:
                        time.sleep(0.3)
                        listed = server.ask("GET", "/v1/jobs?limit=1000")
                        assert listed.status == 200 or listed.status >= 500, listed.body
                        if listed.status == 200:
                            assert {job["id"] for job in listed.json["jobs"]} == set(self.states), listed.body
                        if not fault.all_later:
                            self.settle(jobs)
                    kind = "started" if started else f"exit {server.process.returncode}"
                    outcomes.count(kind if jobs.control.failed else "(no such call)")
                    jobs.control.disarm()
                    if started:
                        number = server.submit().json["id"]
                        jobs.to_its_end(number)
                        jobs.remove(number)
                        jobs.restart()
                    else:
                        server.start()
                    self.settle(jobs)
                    jobs.agree()
                    assert not server.wrong, server.wrong
            finally:
                jobs.end()

    @staticmethod
    def start(server):
        try:
            server.start()
            return True
        except AssertionError:
            code = server.process.wait(timeout=10)
            assert code in (2, 5), f"exit {code}: {server.log()}"
            assert len(complaints(server.log())) == 1, server.log()
            return False

    def settle(self, jobs):
        """All jobs come to be what they should."""
        for number, state in self.states.items():
            job = jobs.at_rest(number, 30)
            assert job, f"job {number} does not come to rest: {jobs.state(number)}"
            if job["state"] != state:  # the one that ran while a call failed
                assert state == "done" and job["message"], f"job {number} was {state}: {job}"
                jobs.to_its_end(number)
        listed = jobs.listed()
        assert listed == self.states, f"{listed}, expected {self.states}"


def supervisors(data):
    """Those that supervise jobs in a data folder."""
    found = []
    for process in Path("/proc").iterdir():
        with contextlib.suppress(OSError):
            words = (process / "cmdline").read_bytes().split(b"\0")
            if b"supervise" in words and words[-2].startswith(str(data).encode()):
                found.append(int(process.name))
    return found
