"""Requests that mean harm, and what they may not lead to."""

import json
import os
import random
import socket
import threading
import time

import daemon
import program

FORBIDDEN = [
    ["-log_view", ":/tmp/sweepvi_stolen"], ["-snes_monitor", "ascii:/tmp/sweepvi_stolen"], ["-options_file", "/etc/passwd"],
    ["-ksp_view_mat", "binary:/tmp/sweepvi_stolen"], ["-dll_append", "/tmp/evil.so"], ["-start_in_debugger"],
    ["-on_error_attach_debugger"], ["-malloc_dump"], ["-info", "/tmp/sweepvi_stolen"], ["-options_view"], ["-prefix_push", "x"],
    ["-pc_type", "/tmp/evil.so:make"], ["-snes_type", "a b"], ["-ksp_rtol", "1e-3 -log_view"], ["-SNES_TYPE", "ksponly"],
    ["--output", "/tmp/x"], ["-mat_mumps_ooc_tmpdir", "/tmp"], ["-sweepvi_memory_limit", "1e9"], ["-viewer_socket_machine", "x"],
    ["-snes_type"], ["-saws_port", "1"], ["-fp_trap"], ["-stop_for_debugger"], ["-log_trace", "/tmp/sweepvi_stolen"],
]
SCENE_OPTIONS = ["-log_view :/tmp/sweepvi_stolen", "-options_file /etc/passwd", "-snes_monitor 'ascii:x'", "-ksp_rtol 1 # -info x",
                 "-start_in_debugger", "-pc_type \\n-info x"]
NAMES = ["../../../etc/passwd", "/etc/passwd", "..", ".", "a/../../b", "x\x00y", "con\r\nX: y", "%2e%2e%2f", "\\..\\..\\x", "queue.db",
         "scene.toml", "log", "a" * 300, "", "~", "$(touch /tmp/sweepvi_stolen)", "`id`", ";rm -rf /", "files.json", "\u202e.mtx"]
PATHS = ["/", "/healthz", "/openapi.json", "/v1/jobs", "/v1/jobs/1", "/v1/jobs/1/result", "/v1/jobs/1/log", "/v1/jobs/1/picture",
         "/v1/jobs/1/cancel", "/v1/jobs/1/resume", "/v1/jobs/2", "/v1/jobs/2/result", "/v1/jobs/0", "/v1/jobs/-1",
         "/v1/jobs/999999999999999999999", "/v1/jobs/1/../../../../etc/passwd", "/v1/jobs/%2e%2e/%2e%2e/queue.db", "//etc/passwd",
         "/v1/jobs/1/result/../../queue.db", "/v1/jobs/1%00", "/../../etc/passwd", "*", "http://evil/v1/jobs", "/v1/jobs/1/attempt-1/order.json"]
METHODS = ["GET", "POST", "PUT", "DELETE", "HEAD", "OPTIONS", "PATCH", "TRACE", "CONNECT", "get", "G\x00T", "BREW", "PRI"]
RANGES = ["bytes=0-", "bytes=-1", "bytes=5-2", "bytes=0-0,1-1", "bytes=99999999999999999999-", "bytes=" + "1-2," * 800, "chapters=1", "bytes=-",
          "bytes=18446744073709551615-", "bytes=0-18446744073709551615", "bytes=-9223372036854775808"]


class Fuzzer:
    """Makes requests from a seed; everything it needs to repeat one is that seed."""

    def __init__(self, seed, token):
        self.random = random.Random(seed)
        self.token = token

    def pick(self, *choices):
        return self.random.choice(choices)

    def noise(self, most):
        return bytes(self.random.randrange(256) for _ in range(self.random.randrange(most)))

    def mutated(self, data):
        data = bytearray(data)
        for _ in range(self.random.randrange(1, 6)):
            at = self.random.randrange(len(data) + 1)
            kind = self.random.randrange(5)
            if kind == 0 and at < len(data):
                data[at] = self.random.randrange(256)
            elif kind == 1:
                data[at:at] = self.noise(8)
            elif kind == 2:
                del data[at : at + self.random.randrange(1, 20)]
            elif kind == 3:
                data[at:at] = self.pick(b"\r\n", b"\r\n\r\n", b"\x00", b"%00", b"\n", b": ", b"--", b"\xff" * 4, b"{" * 50, b'"')
            else:
                data[at:at] = data[at : at + self.random.randrange(100)]
        return bytes(data)

    def authorization(self):
        right = "Bearer " + self.token
        wrong = ["Bearer", "Bearer ", "Bearer " + self.token[:-1], "Bearer " + self.token + "x", "bearer", "Basic eDp4", right.upper(),
                 " " * 50, "Bearer " + "a" * 4000, "Bearer \x00"]
        return right if self.random.random() < 0.8 else self.pick(*wrong)

    def value(self, depth=0):
        kind = self.random.randrange(9 if depth < 4 else 6)
        if kind == 0:
            return self.pick(-1, 0, 1, 2, 3, 1e308, -1e-300, 2**63, 2**64, 10**30, 0.5)
        if kind in (1, 2):
            return self.pick(*NAMES, "run", "1e-3", "time.step=1", "\ud83d\ude00", "x" * self.random.randrange(6000))
        if kind == 3:
            return self.pick(None, True, False)
        if kind in (4, 5):
            return self.pick(*FORBIDDEN)
        if kind == 6:
            return [self.value(depth + 1) for _ in range(self.random.randrange(5))]
        return {self.pick("a", "scene", "verb", "ranks", "options"): self.value(depth + 1) for _ in range(self.random.randrange(4))}

    def description(self):
        """Wrong in at least one thing, so that none gets as far as a check."""
        keys = ["verb", "name", "ranks", "priority", "options", "set", "wall_limit", "memory", "steps", "schemes", "settings", "zz"]
        description = {"scene": daemon.BALL}
        for key in self.random.sample(keys, self.random.randrange(1, 4)):
            description[key] = self.value()
        description[self.pick("options", "options", "zzz")] = self.pick(*FORBIDDEN)
        return description

    def body(self):
        kind = self.random.randrange(6)
        if kind == 0:
            return self.noise(3000), self.pick("application/json", "multipart/form-data; boundary=x", "text/plain", "")
        if kind == 1:
            return json.dumps(self.value()).encode(), "application/json"
        if kind == 2:
            return self.mutated(json.dumps(self.description()).encode()[:400]), "application/json"
        if kind == 3:
            return json.dumps(self.description()).encode(), "application/json"
        files = {self.pick(*NAMES).replace('"', ""): self.noise(200) for _ in range(self.random.randrange(3))}
        body, content = daemon.form(self.description(), {})
        mark = content.split("boundary=")[1].encode()
        for name, data in files.items():
            part = b'Content-Disposition: form-data; name="file"; filename="' + name.encode("utf-8", "replace") + b'"\r\n\r\n' + data
            body = b"--" + mark + b"\r\n" + part + b"\r\n" + body
        return (self.mutated(body), content) if kind == 4 else (body, content)

    def request(self):
        method, path = self.pick(*METHODS) if self.random.random() < 0.3 else self.pick("GET", "POST", "DELETE"), self.pick(*PATHS)
        if self.random.random() < 0.2:
            path += "?" + self.pick("limit=5", "limit=-1", "before=x", "state=done", "state=%00", "limit=" + "9" * 400, "a" * 9000, "%" * 50)
        lines = [f"{method} {path} HTTP/{self.pick('1.1', '1.1', '1.1', '1.0', '2.0', 'x')}", f"Host: {self.pick('localhost', '127.0.0.1')}"]
        if self.random.random() < 0.9:
            lines.append("Authorization: " + self.authorization())
        if self.random.random() < 0.3:
            lines.append("Range: " + self.pick(*RANGES))
        if self.random.random() < 0.1:
            lines.append(self.pick("Last-Event-ID: -1", "Last-Event-ID: " + "9" * 50, "Origin: http://evil", "Expect: 100-continue",
                                   "Content-Encoding: gzip", "Transfer-Encoding: chunked", "Idempotency-Key: " + "k" * 500, "X: " + "y" * 9000,
                                   "If-None-Match: *", "Host: evil.example", "Connection: close", "Upgrade: h2c", "\x00: \x00"))
        data = b""
        if path.startswith("/v1") and self.random.random() < 0.6:
            data, content = self.body()
            lines.append("Content-Type: " + content)
            length = len(data) if self.random.random() < 0.9 else self.pick(0, 1, len(data) + 1, 10**12, -1, "x", 2**64)
            lines.append(f"Content-Length: {length}")
        raw = "\r\n".join(lines).encode("utf-8", "replace") + b"\r\n\r\n" + data
        return self.mutated(raw) if self.random.random() < 0.3 else raw


def read_answer(stream):
    """Status and body of an answer; None if the connection was closed instead."""
    line = stream.readline()
    if not line:
        return None
    status = int(line.split()[1])
    length, chunked = 0, False
    while True:
        header = stream.readline()
        if header in (b"\r\n", b""):
            break
        name, _, value = header.partition(b":")
        if name.lower() == b"content-length":
            length = int(value)
        chunked = chunked or (name.lower() == b"transfer-encoding" and b"chunked" in value)
    return status, b"" if chunked else stream.read(length)


def attack(server, requests, seed, threads=6):
    """Sends so many requests. @return how often each status came back (0: none, it hung up)"""
    host, port = server.listen.rsplit(":", 1)
    counts, lock = {}, threading.Lock()

    def one_thread(number):
        fuzzer = Fuzzer(f"{seed}-{number}", server.token)
        own = {}
        for _ in range(requests // threads):
            raw = fuzzer.request()
            # What waits for more of a body gets none: hang up, as a rude client would.
            status = 0
            try:
                with socket.create_connection((host, int(port)), timeout=0.3) as connection:
                    connection.sendall(raw)
                    connection.shutdown(socket.SHUT_WR)
                    connection.settimeout(10)
                    with connection.makefile("rb") as stream:
                        answer = read_answer(stream)
                        head_only = raw.startswith(b"HEAD")
                        if answer and not head_only:
                            status = answer[0]
                        elif answer:
                            status = answer[0]
            except (ConnectionError, socket.timeout, ValueError, IndexError):
                status = 0
            own[status] = own.get(status, 0) + 1
        with lock:
            for status, count in own.items():
                counts[status] = counts.get(status, 0) + count

    pool = [threading.Thread(target=one_thread, args=(number,)) for number in range(threads)]
    for thread in pool:
        thread.start()
    for thread in pool:
        thread.join()
    return counts


def survive(folder, requests, seed, verdict):
    """A daemon under attack: it answers before, during and after, and nothing gets through."""
    token = "correct-horse-battery-staple"
    (folder / "token").write_text(token)
    (folder / "token").chmod(0o600)
    stolen = program.Path("/tmp/sweepvi_stolen")
    stolen.unlink(missing_ok=True)
    # Each thread keeps the stack that it needed at most (cpp-httplib's regular expressions: 1.6 MB): with few
    # threads, all of them have soon.
    with daemon.Daemon(folder, "--token-file", folder / "token", "--threads", 16, token=token) as server:
        first = server.submit().json["id"]
        server.wait(first)
        second = server.submit(daemon.LONG, set=["time.end=1e6"], ranks=2).json["id"]  # there all the time, unless it is cancelled
        attack(server, 3000, "warm-up")
        before, start, process = server.memory(), time.monotonic(), server.process.pid
        counts = attack(server, requests, seed)
        seconds = time.monotonic() - start
        after = server.memory()
        print(f"{sum(counts.values())} requests in {seconds:.1f} s; answers {dict(sorted(counts.items()))}")
        print(f"memory {before / 2**20:.1f} MB before, {after / 2**20:.1f} MB after")
        verdict.expect(server.process.poll() is None and server.process.pid == process, "the daemon lives")
        verdict.expect(server.ask("GET", "/healthz").status == 200, "and answers")
        verdict.expect(not [s for s in counts if s >= 500 and s not in (503, 505, 507)], "no internal error")
        verdict.expect(sum(counts.get(s, 0) for s in (400, 401, 404)) > requests / 4, "most of it was understood, and refused")
        # The address sanitizer keeps what is freed for a while.
        verdict.expect("ASAN_OPTIONS" in os.environ or after - before < 16 * 2**20, "memory does not grow by more than 16 MB")
        jobs = server.ask("GET", "/v1/jobs?limit=1000").json["jobs"]
        options = [o for job in jobs for o in server.job(job["id"])["options"]]
        allowed = {"-snes_type", "vinewtonssls"}
        verdict.expect(not [o for o in options if o not in allowed], f"no option came through: {options}")
        verdict.expect(not stolen.exists(), "no file was written where an option said")
        outside = sorted(path.name for path in folder.iterdir())
        verdict.expect(outside == ["daemon.log", "data", "token"], f"nothing outside the data folder: {outside}")
        inside = sorted(path.name for path in server.data.iterdir())
        verdict.expect(set(inside) <= {"jobs", "lock", "queue.db", "queue.db-shm", "queue.db-wal", "sweepvi-data"}, f"its own files: {inside}")
        known = {server.home(job["id"]).name for job in jobs}
        verdict.expect({path.name for path in (server.data / "jobs").iterdir()} == known, "folders of jobs only, nothing of what was refused")
        verdict.expect(not server.wrong, f"answers as documented: {server.wrong[:3]}")
        server.ask("POST", f"/v1/jobs/{second}/cancel")
        server.wait(second)
    text = server.log()
    verdict.expect("internal" not in text and "terminate" not in text, "nothing in its log: " + text[-300:])


def forbidden_options(server, verdict):
    for words in FORBIDDEN:
        answer = server.submit(options=words)
        verdict.expect(answer.status == 400 and "option" in answer.json["error"], f"{words}: {answer.status}")
    for text in SCENE_OPTIONS:
        for how in (dict(scene=daemon.BALL + f'[petsc]\noptions = "{text}"\n'), dict(set=[f'petsc.options="{text}"'])):
            answer = server.submit(**how)
            verdict.expect(answer.status == 400, f"{text!r} in {list(how)}: {answer.status} {answer.body[:80]}")
    settings = '[[setting]]\nname = "x"\noptions = "-log_view :/tmp/sweepvi_stolen"\n'
    answer = server.submit(verb="study", steps=[0.1], repeats=1, settings=settings)
    verdict.expect(answer.status == 400, f"options of a study's setting: {answer.status} {answer.body[:80]}")
    answer = server.submit(options=["-snes_type", "vinewtonssls"])
    verdict.expect(answer.status == 201, "what is on the list is taken")
    server.wait(answer.json["id"])


def slow_clients(server, count, verdict, wait_for_end):
    """Connections that send a byte now and then, in head and body, while others work."""
    host, port = server.listen.rsplit(":", 1)
    head = f"POST /v1/jobs HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {server.token}\r\nContent-Type: application/json\r\n"
    sockets = []
    for i in range(count):
        connection = socket.create_connection((host, int(port)))
        connection.sendall((head + ("Content-Length: 1000000\r\n\r\n" if i % 2 else "")).encode())
        sockets.append(connection)
    start, slowest = time.monotonic(), 0.0
    open_ones = set(range(count))
    while time.monotonic() - start < (60 if wait_for_end else 2) and open_ones:
        for i in list(open_ones):
            try:
                sockets[i].sendall(b"a")
                sockets[i].setblocking(False)
                if sockets[i].recv(4096) == b"":
                    open_ones.discard(i)
            except BlockingIOError:
                pass
            except OSError:
                open_ones.discard(i)
            finally:
                sockets[i].setblocking(True)
        asked = time.monotonic()
        server.ask("GET", "/healthz")
        slowest = max(slowest, time.monotonic() - asked)
        time.sleep(0.2)
    for connection in sockets:
        connection.close()
    print(f"{count} slow clients: others waited {slowest * 1e3:.0f} ms at most; {len(open_ones)} open after {time.monotonic() - start:.0f} s")
    verdict.expect(slowest < 2.0, "others are served meanwhile")
    if wait_for_end:
        verdict.expect(not open_ones, "slow clients are given up")
