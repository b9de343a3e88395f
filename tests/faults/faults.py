"""Runs that are killed, stopped and starved at random moments, and what is left of them.

A case is run once undisturbed. Then it is run again and disturbed, taken up where it broke off, disturbed again, until
it is done: its file must then hold the same bits (all but the times the run took)."""

import contextlib
import multiprocessing
import os
import random
import signal
import subprocess
import sys
import time
import uuid
from dataclasses import dataclass, field, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))
import h5py
import program
import same_bits

FILE = "out.h5"
CHECKPOINT = f"{FILE}.checkpoint"
# Names of a run; others are those of files being written.
USUAL = {FILE, f"{FILE}.partial", CHECKPOINT, f"{CHECKPOINT}.reserve"}
MARK = "SWEEPVI_FAULT_RUN"  # in the environment of every process of one run
DEADLINE = 120  # s: an undisturbed run of a case takes a second or two


@dataclass
class Case:
    """A scene with settings that make it a matter of a second, and often written."""

    name: str
    scene: str
    settings: tuple
    options: tuple = ()

    def often(self, seconds=0.01):
        """With a checkpoint every so many seconds; the default in tests is one after nearly every step."""
        return replace(self, settings=(*self.settings, f"output.checkpoint={seconds}"))

    def words(self):
        sets = [word for setting in self.settings for word in ("--set", setting)]
        return ["run", program.SOURCE / "examples" / self.scene, *sets, *self.options]


CASES = [
    Case("jerk chain", "jerk_chain/scene.toml", ("model.count=40", "time.step=4e-2", "output.every=1")),
    Case("flexible chain", "flexible_chain/scene.toml", ("model.count=9", "time.step=4e-3", "output.every=7")),
    Case(
        "falling column",
        "falling_column/scene.toml",
        ("model.count=20", "time.step=2e-2", "time.end=6", "output.every=7"),
    ),
    Case("forced chain", "forced_chain/scene.toml", ("time.step=4e-2", "output.every=1", "output.blocks=[0, 7, 19]")),
    Case("impact chain", "zi_chain/scene.toml", ("model.count=60", "time.step=2e-3", "output.every=1")),
    Case("moving polygon", "moving_polygon/scene.toml", ("output.every=1",)),
    Case("sweeping chain", "sweeping_chain/scene.toml", ("time.step=4e-3", "output.every=7")),
    Case("tracking", "zi_tracking/scene.toml", ("time.step=2e-3", "output.every=1")),
    Case("elastic bar", "elastic_bar/scene.toml", ("time.step=1e-2", "output.every=7")),
    Case("primal-dual", "shared_input/scene.toml", ("time.step=5e-3", "output.every=1")),
]


class Run:
    """One run of the program, and all its processes."""

    def __init__(self, words, ranks, folder, env=None):
        self.command = [program.PROGRAM, *map(str, words)]
        if ranks > 1:
            self.command = ["mpiexec", "--oversubscribe", "-n", str(ranks), *self.command]
        self.mark = uuid.uuid4().hex
        self.session = program.temporary_folder()
        self.log = open(Path(self.session.name) / "printed", "w+b")
        self.launched = ranks > 1
        self.process = subprocess.Popen(
            self.command,
            cwd=folder,
            env={
                **os.environ,
                **program.ENVIRONMENT,
                "OMPI_MCA_orte_tmpdir_base": self.session.name,
                MARK: self.mark,
                **(env or {}),
            },
            stdin=subprocess.DEVNULL,
            stdout=self.log,
            stderr=self.log,
            start_new_session=True,
        )

    def pids(self):
        """All live processes of the run, mpiexec included."""
        wanted = f"{MARK}={self.mark}".encode()
        found = []
        for entry in Path("/proc").iterdir():
            if not entry.name.isdigit():
                continue
            try:
                if wanted in (entry / "environ").read_bytes() and (entry / "stat").read_text().split()[2] != "Z":
                    found.append(int(entry.name))
            except OSError:  # it has just ended
                pass
        return found

    def rank_pids(self):
        return [pid for pid in self.pids() if not self.launched or pid != self.process.pid]

    def signal(self, pids, number):
        for pid in pids:
            try:
                os.kill(pid, number)
            except ProcessLookupError:
                pass

    def wait(self, seconds=DEADLINE):
        """The exit code. A process that is still there after `seconds` is an AssertionError."""
        try:
            code = self.process.wait(timeout=seconds)
            end = time.monotonic() + 30  # ranks whose launcher was killed
            while self.pids() and time.monotonic() < end:
                time.sleep(0.02)
            assert not self.pids(), f"ranks are left behind by {self}"
            return code
        except subprocess.TimeoutExpired:
            raise AssertionError(f"did not end within {seconds} s: {self}\n{self.err()}") from None
        finally:
            self.signal(self.pids(), signal.SIGKILL)
            self.process.wait()

    def err(self):
        self.log.flush()
        return (Path(self.session.name) / "printed").read_text(errors="replace")

    def close(self):
        self.log.close()
        self.session.cleanup()

    def __str__(self):
        return " ".join(self.command)


def undisturbed(case, ranks, folder):
    """Runs a case; its file and the seconds it took."""
    folder = Path(folder)
    start = time.monotonic()
    run = Run([*case.words(), "-o", FILE], ranks, folder)
    code, err = run.wait(), run.err()
    run.close()
    assert code == 0, f"{run}: exit {code}\n{err}"
    return folder / FILE, time.monotonic() - start


def restart_words(folder):
    """How a run that broke off is taken up: from its checkpoint, or from the start where it has none yet."""
    return ["--restart", CHECKPOINT] if (Path(folder) / CHECKPOINT).exists() else []


@dataclass
class Kill:
    """How a run is killed."""

    whom: str  # one rank | all | mpiexec
    when: str  # any time | at a checkpoint | at the start


@dataclass
class Tally:
    """What came of the disturbances."""

    runs: int = 0
    kills: int = 0
    resumed: int = 0  # from a checkpoint
    afresh: int = 0  # no checkpoint yet
    late: int = 0  # the run was done before
    by: dict = field(default_factory=dict)

    def count(self, kill):
        self.kills += 1
        key = f"{kill.whom}, {kill.when}".replace("all, ", "all of them, ")
        self.by[key] = self.by.get(key, 0) + 1


def wait_for_moment(run, kill, seconds, folder, draw):
    """Returns at the moment to kill, or when the run has ended."""
    if kill.when == "at a checkpoint":
        end = time.monotonic() + draw.uniform(0.0, seconds)
        while run.process.poll() is None and time.monotonic() < end:
            time.sleep(1e-3)
        while run.process.poll() is None and not set(os.listdir(folder)) - USUAL:
            time.sleep(1e-4)
        time.sleep(draw.uniform(0.0, 2e-3))
        return
    span = 0.3 * seconds if kill.when == "at the start" else 1.05 * seconds
    end = time.monotonic() + draw.uniform(0.0, span)
    while run.process.poll() is None and time.monotonic() < end:
        time.sleep(1e-3)


def strike(run, kill, draw):
    """Kills. False if there was nobody left to kill."""
    ranks = run.rank_pids()
    if kill.whom == "mpiexec" and run.launched:
        run.signal([run.process.pid], signal.SIGKILL)
    elif kill.whom == "one rank" and ranks:
        run.signal([draw.choice(ranks)], signal.SIGKILL)
    else:
        run.signal(run.pids(), signal.SIGKILL)
    return bool(ranks)


def no_half_file(folder, expected):
    """A file with its final name is a whole one."""
    path = Path(folder) / FILE
    if path.exists():
        wrong = same_bits.differences(path, expected)
        assert not wrong, f"{FILE} was there before the run was done, and differs in {wrong}"


def kill_until_done(case, ranks, expected, seconds, kills, seed, tally, read=False):
    """Runs a case, kills it as `kills` say, one after the other, takes it up each time, and at last lets it finish."""
    draw = random.Random(seed)
    tally.runs += 1
    with program.temporary_folder() as folder, Reader(folder) if read else contextlib.nullcontext():
        pending = list(kills)
        while True:
            words = restart_words(folder)
            run = Run([*case.words(), "-o", FILE, *words], ranks, folder)
            kill = pending.pop(0) if pending else None
            if kill:
                wait_for_moment(run, kill, seconds, folder, draw)
                if strike(run, kill, draw):
                    tally.count(kill)
            code, err = run.wait(), run.err()
            run.close()
            no_half_file(folder, expected)
            if (Path(folder) / FILE).exists():
                tally.late += 1 if kill else 0
                return
            there = f"{run}: exit {code}, there are {sorted(os.listdir(folder))}\n{err}"
            assert kill and code != 0, there
            tally.resumed += 1 if restart_words(folder) else 0
            tally.afresh += 0 if restart_words(folder) else 1


def status(path):
    with h5py.File(path) as file:
        text = file.attrs["status"]
        return text.decode() if isinstance(text, bytes) else text


class Reader:
    """Somebody who looks at the files of a run, and holds them, all the time. A process of its own: HDF5 shares what it
    knows of a file between all who have it open in one process, and would show a finished file as it was before."""

    def __init__(self, folder):
        paths = [Path(folder) / name for name in sorted(USUAL)]
        self.process = multiprocessing.get_context("fork").Process(target=self.look, args=(paths,), daemon=True)

    @staticmethod
    def look(paths):
        while True:
            for path in paths:
                try:
                    with open(path, "rb") as held, h5py.File(path, locking=True) as file:
                        held.read(1 << 12)
                        list(file)
                        time.sleep(0.05)
                except OSError:  # not there, or not yet whole
                    time.sleep(0.01)

    def __enter__(self):
        self.process.start()
        return self

    def __exit__(self, *_):
        self.process.kill()
        self.process.join()


@dataclass
class Stops:
    """What came of the signals."""

    signals: int = 0
    stopped: int = 0  # in order, exit 4
    early: int = 0  # before the program could know: nothing is there
    late: int = 0  # it was done


def signal_until_done(case, ranks, expected, seconds, signals, seed, stops):
    """Runs a case and stops it by `signals`, two at once where one of them is a pair, until it is done."""
    draw = random.Random(seed)
    with program.temporary_folder() as folder:
        path = Path(folder) / FILE
        pending = list(signals)
        while True:
            before = path.read_bytes() if path.exists() else None
            words = ["--restart", FILE] if before else []
            numbers = pending.pop(0) if pending else ()
            # On SIGTERM and SIGINT mpiexec ends the ranks itself, and says 1: it must wait until they have written
            # all. (It then waits that long in any case.)
            relayed = ranks == 1 or set(numbers) <= {signal.SIGUSR1}
            env = {} if relayed else {"OMPI_MCA_odls_base_sigkill_timeout": "5"}
            run = Run([*case.words(), "-o", FILE, *words], ranks, folder, env)
            # Half of the time of a small run by mpiexec goes before the program starts and after it has ended.
            first, last = (0.0, 1.0) if ranks == 1 else (0.2, 0.8)
            end = time.monotonic() + draw.uniform(first, last) * seconds
            while run.process.poll() is None and time.monotonic() < end:
                time.sleep(1e-3)
            for number in numbers if run.process.poll() is None else ():
                stops.signals += 1
                run.signal([run.process.pid], number)
                time.sleep(draw.choice([0.0, 1e-3, 0.05]))
            code, err = run.wait(), run.err()
            run.close()
            after = path.read_bytes() if path.exists() else None
            if after is not None and status(path) == "done":
                wrong = same_bits.differences(path, expected)
                assert not wrong, f"{run}: the file differs in {wrong}"
                assert code == 0 or not relayed, f"{run}: exit {code} with a file that is done\n{err}"
                stops.late += 1 if numbers else 0
                return
            assert numbers and code != 0, f"{run}: exit {code}\n{err}"
            if after is not None and (after != before or code == 4):
                assert status(path) == "stopped", status(path)
                assert code == 4 or not relayed, f"{run}: exit {code}\n{err}"
                stops.stopped += 1
            else:
                assert code < 0 or ranks > 1, f"{run}: exit {code} without a file\n{err}"
                assert (Path(folder) / CHECKPOINT).exists() == (before is not None), f"{run}: exit {code}\n{err}"
                stops.early += 1
