"""Starts the daemon and talks to it, for the Python tests. Every answer is held against openapi.json."""

import contextlib
import fcntl
import http.client
import json
import os
import re
import socket
import sqlite3
import subprocess
import sys
import time
import uuid
from pathlib import Path

import jsonschema

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

SERVE = str(Path(program.PROGRAM).parent / "sweepvi-serve")
DOCUMENT = json.loads((program.SOURCE / "src/service/openapi.json").read_text())
VALIDATORS = {}
AT_REST = {"done", "failed", "cancelled", "interrupted"}

BALL = """title = "falling ball"
[time]
end = 2.0
step = 0.1
[model]
kind = "linear"
A = [[0, 1], [0, 0]]
B = [[0], [1]]
C = [[1, 0]]
f = [0, -1]
x0 = [1, 0]
"""

# Takes seconds.
LONG = """[time]
end = 6000.0
step = 1e-2
[model]
kind = "chain"
element = "jerk"
count = 30
coupling = 0.5
force = {offset = -0.1, amplitude = 0.3, frequency = 0.4}
[output]
every = 50
"""


def operation(method, path):
    """The entry of the document for a request, and its path as written there."""
    path = path.split("?")[0]
    for template, operations in DOCUMENT["paths"].items():
        if re.fullmatch(re.sub(r"\{id\}", r"[0-9]{1,18}", template), path):
            return operations.get("get" if method == "HEAD" else method.lower())
    return None


def complaint(method, path, answer):
    """Why an answer is not what the document says; empty if it is."""
    entry = operation(method, path)
    if entry is None:
        return "" if answer.status >= 400 else f"{method} {path}: {answer.status}, but the document has no such thing"
    if str(answer.status) not in entry["responses"]:
        return f"{method} {path}: {answer.status} is not in the document: {answer.body[:300]!r}"
    content = entry["responses"][str(answer.status)].get("content", {})
    kind = (answer.headers.get("Content-Type") or "").split(";")[0]
    if content and kind not in content:
        return f"{method} {path}: {answer.status} with {kind}, the document has {list(content)}"
    schema = content.get(kind, {}).get("schema")
    if schema is None or method == "HEAD":
        return ""
    key = json.dumps(schema)
    if key not in VALIDATORS:
        VALIDATORS[key] = jsonschema.Draft202012Validator({**schema, "components": DOCUMENT["components"]})
    errors = [error.message for error in VALIDATORS[key].iter_errors(json.loads(answer.body))]
    return f"{method} {path}: {answer.status}: {errors}" if errors else ""


class Answer:
    def __init__(self, response):
        self.status = response.status
        self.headers = response.headers
        self.body = response.read()

    @property
    def json(self):
        return json.loads(self.body)


class UnixConnection(http.client.HTTPConnection):
    def __init__(self, path, timeout):
        super().__init__("localhost", timeout=timeout)
        self.path = path

    def connect(self):
        self.sock = socket.socket(socket.AF_UNIX)
        self.sock.settimeout(self.timeout)
        self.sock.connect(self.path)


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


class Daemon:
    """One data folder, and the daemon that works there; it may be killed and started anew."""

    def __init__(self, folder, *words, listen=None, token=None, env=None, started=True):
        self.folder = Path(folder)
        self.data = self.folder / "data"
        self.listen = listen or f"127.0.0.1:{free_port()}"
        self.words = words
        self.token = token
        self.environment = {**os.environ, **program.ENVIRONMENT, **(env or {})}
        self.grace = 5
        self.errors_to = self.folder / "daemon.log"
        self.process = None
        self.wrong = []  # answers that the document does not have
        if started:
            self.start()

    def start(self):
        self.errors = open(self.errors_to, "a")
        # Under the address sanitizer everything takes terabytes of address space.
        roomy = ["--check-memory", "0"] if "ASAN_OPTIONS" in os.environ else []
        command = [SERVE, "serve", "--data", self.data, "--listen", self.listen, "--grace", self.grace, *roomy, *self.words]
        self.process = subprocess.Popen(
            [str(word) for word in command],
            env=self.environment,
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=self.errors,
            text=True,
        )
        line = self.process.stdout.readline()
        if not line:
            raise AssertionError("the daemon did not start: " + (self.folder / "daemon.log").read_text())

    def kill(self):
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()
        self.errors.close()

    def end(self):
        """Asks it to end, and all that it runs."""
        if self.process.poll() is None:
            self.process.terminate()
            try:
                self.process.wait(timeout=15)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
                raise AssertionError("the daemon does not end when asked to") from None
            finally:
                self.process.stdout.close()
                self.errors.close()
        left = [path for path in self.data.glob("jobs/*/attempt-*") if not (path / "ending.json").exists()]
        for attempt in left:
            (attempt / "stop").touch()
        deadline = time.monotonic() + 10
        while any(supervised(attempt) for attempt in left) and time.monotonic() < deadline:
            time.sleep(0.05)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.end()

    @property
    def url(self):
        return self.listen if self.listen.startswith("unix:") else "http://" + self.listen

    def connection(self, timeout=60):
        if self.listen.startswith("unix:"):
            return UnixConnection(self.listen[5:], timeout)
        return http.client.HTTPConnection(*self.listen.rsplit(":", 1), timeout=timeout)

    def ask(self, method, path, body=None, headers=None, connection=None, token=True):
        own = connection or self.connection()
        headers = dict(headers or {})
        if self.token and token:
            headers.setdefault("Authorization", "Bearer " + self.token)
        try:
            own.request(method, path, body, headers)
            answer = Answer(own.getresponse())
        finally:
            if connection is None:
                own.close()
        wrong = complaint(method, path, answer)
        if wrong:
            self.wrong.append(wrong)
        return answer

    def submit(self, scene=BALL, files=None, key=None, headers=None, connection=None, **description):
        description = {"scene": scene, **description} if scene is not None else description
        headers = {**({"Idempotency-Key": key} if key else {}), **(headers or {})}
        if files is None:
            body = json.dumps(description)
            headers.setdefault("Content-Type", "application/json")
        else:
            body, kind = form(description, files)
            headers.setdefault("Content-Type", kind)
        return self.ask("POST", "/v1/jobs", body, headers, connection)

    def job(self, number):
        return self.ask("GET", f"/v1/jobs/{number}").json

    def home(self, number):
        """The folder of a job: its name is drawn at random, and the queue knows it."""
        with contextlib.closing(sqlite3.connect(f"file:{self.data}/queue.db?mode=ro", uri=True)) as queue:
            row = queue.execute("SELECT folder FROM jobs WHERE id = ?", (number,)).fetchone()
        return self.data / "jobs" / row[0] if row else None

    def wait(self, number, states=AT_REST, timeout=200):
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            job = self.job(number)
            if job["state"] in states:
                return job
            time.sleep(0.05)
        raise AssertionError(f"job {number} is still {job['state']}: {job}")

    def wait_for_progress(self, number, timeout=100):
        """Until it has taken steps."""
        deadline = time.monotonic() + timeout
        while time.monotonic() < deadline:
            job = self.job(number)
            if job["progress"] or job["state"] in AT_REST:
                return job
            time.sleep(0.05)
        raise AssertionError(f"job {number} does not move: {job}")

    def fetch(self, number, file):
        answer = self.ask("GET", f"/v1/jobs/{number}/result")
        assert answer.status == 200, answer.body
        Path(file).write_bytes(answer.body)
        return file

    def client(self, *words, **how):
        """`sweepvi WORDS` against this daemon."""
        environment = {"SWEEPVI_SERVER": self.url}
        if self.token:
            environment["SWEEPVI_TOKEN_FILE"] = str(self.folder / "token")
        return program.run(*words, env=environment, cwd=self.folder, timeout=how.pop("timeout", 60), **how)

    def memory(self):
        """Resident [B]."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return 1024 * int(re.search(r"VmRSS:\s+(\d+)", status)[1])

    def log(self):
        return (self.folder / "daemon.log").read_text()


def form(description, files):
    """multipart/form-data with the description and files, by name."""
    mark = uuid.uuid4().hex
    parts = [b'Content-Disposition: form-data; name="job"\r\n\r\n' + json.dumps(description).encode()]
    for name, data in files.items():
        head = f'Content-Disposition: form-data; name="file"; filename="{name}"\r\n\r\n'
        parts.append(head.encode() + data)
    body = b"".join(b"--" + mark.encode() + b"\r\n" + part + b"\r\n" for part in parts)
    return body + b"--" + mark.encode() + b"--\r\n", "multipart/form-data; boundary=" + mark


def supervised(attempt):
    """Whether the supervisor of an attempt is still there: it holds the lock."""
    try:
        with open(attempt / "claim") as claim:
            fcntl.flock(claim, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except FileNotFoundError:
        return False
    except BlockingIOError:
        return True
    return False


def processes_of(folder):
    """Numbers of processes that belong to jobs in a data folder, without their supervisors."""
    return processes_with(b"SWEEPVI_ATTEMPT=" + str(folder).encode())


def processes_with(mark):
    """Numbers of processes with this text in the environment that they began with."""
    found = []
    for entry in Path("/proc").iterdir():
        if not entry.name.isdigit():
            continue
        try:
            environment = (entry / "environ").read_bytes()
        except OSError:
            continue
        if mark in environment:
            found.append(int(entry.name))
    return found


def supervisors_of(folder):
    """Numbers of the supervisors of attempts in a data folder."""
    return processes_with(b"SWEEPVI_SUPERVISOR=" + str(folder).encode())


def signal_ranks(folder, number):
    """Sends a signal to every rank of every job in a data folder (not to their launchers)."""
    sent = 0
    for process in processes_of(folder):
        try:
            name = Path(f"/proc/{process}/exe").resolve().name
            if name == "sweepvi":
                os.kill(process, number)
                sent += 1
        except (OSError, ProcessLookupError):
            pass
    return sent


