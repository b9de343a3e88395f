# ranks: 1
# timeout: 120
"""Requests whose ends or hosts two readers could see differently, names that only look like ours, and connections that
say nothing: refused, refused, and no burden to others."""

import json
import socket
import sys
import threading
import time
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import hostile
import program
from service_test import InService

BODY = json.dumps({"scene": daemon.BALL}).encode()


class Requests(InService):
    def raw(self, data, timeout=10):
        """Statuses of all answers on one connection, and how long they took [s]."""
        host, port = self.daemon.listen.rsplit(":", 1)
        begin, statuses = time.monotonic(), []
        with socket.create_connection((host, int(port)), timeout=timeout) as connection:
            connection.sendall(data)
            with connection.makefile("rb") as stream:
                while answer := hostile.read_answer(stream):
                    statuses.append(answer[0])
        return statuses, time.monotonic() - begin

    def head(self, *headers, method="POST", path="/v1/jobs", host=("Host: localhost",), end="Connection: close"):
        lines = [f"{method} {path} HTTP/1.1", *host, "Content-Type: application/json", *headers, *([end] if end else [])]
        return "\r\n".join(lines).encode() + b"\r\n\r\n"

    def jobs(self):
        return len(self.daemon.ask("GET", "/v1/jobs").json["jobs"])

    def test_one_end_of_a_request(self):
        length = len(BODY)
        self.assertEqual(self.raw(self.head(f"Content-Length: {length}") + BODY)[0], [201])
        chunk = f"{length:x}\r\n".encode() + BODY + b"\r\n0\r\n\r\n"
        self.assertEqual(self.raw(self.head("Transfer-Encoding: chunked") + chunk)[0], [201])
        before = self.jobs()
        for headers in (
            [f"Content-Length: {length}", f"Content-Length: {length}"],
            [f"Content-Length: {length}", "content-length: 0"],
            [f"Content-Length: {length}, {length}"],
            [f"Content-Length: +{length}"],
            [f"Content-Length: {length} x"],
            ["Content-Length: 0x10"],
            ["Content-Length: -1"],
            ["Content-Length: 99999999999999999999"],
            ["Content-Length:"],
            [f"Content-Length : {length}"],
            [f"Content-Length: {length}", "Transfer-Encoding: chunked"],
            ["Transfer-Encoding: chunked", "Transfer-Encoding: chunked"],
            ["Transfer-Encoding: gzip, chunked"],
            ["Transfer-Encoding: xchunked"],
            [f"Content-Length: {length}", "X: a\r\n b"],
            [f"Content-Length: {length}", "X: a\x0bb"],
            [f"Content-Length: {length}", "no colon"],
            [f"Content-Length: {length}\nX: y"],
            [f"Content-Length: {length}", *[f"X{i}: y" for i in range(200)]],
        ):
            statuses, seconds = self.raw(self.head(*headers) + BODY)
            self.assertEqual(len(statuses), 1, headers)
            self.assertIn(statuses[0], (400, 431), headers)
            self.assertLess(seconds, 5, headers)
        # What is behind a refused head is not another request.
        smuggled = self.head("Content-Length: 5", "Transfer-Encoding: chunked", end=None) + b"0\r\n\r\n" + self.head(method="GET")
        self.assertEqual(self.raw(smuggled)[0], [400])
        self.assertEqual(self.jobs(), before)

    def test_requests_without_a_body_are_answered_at_once(self):
        number = self.accepted(self.daemon.submit())
        self.daemon.wait(number)
        for path, status in (("/v1/jobs", 400), (f"/v1/jobs/{number}/cancel", 409), (f"/v1/jobs/{number}/resume", 409)):
            statuses, seconds = self.raw(self.head(path=path))
            self.assertEqual(statuses, [status], path)
            self.assertLess(seconds, 3, path)

    def test_one_host_and_ours(self):
        port = self.daemon.listen.rsplit(":", 1)[1]
        for host in ("localhost", "LocalHost:80", f"127.0.0.1:{port}", "127.1.2.3", "[::1]", f"[0:0:0:0:0:0:0:1]:{port}",
                     "[::ffff:127.0.0.1]"):
            self.assertEqual(self.raw(self.head(method="GET", host=[f"Host: {host}"]))[0], [200], host)
            self.assertEqual(self.raw(self.head(f"Origin: http://{host}", method="GET", host=[f"Host: {host}"]))[0], [200], host)
        for host in ("127.evil.com", "127.0.0.1.evil.com", "127.0.0.1.", "127.1", "localhost.evil.com", "evil.com", "evil.com:127.0.0.1",
                     "localhost:80.evil.com", "127.0.0.1@evil.com", "evil.com#127.0.0.1", "[::1].evil.com", "[::1", "[127.0.0.1]", "::1",
                     "0.0.0.0", "[::]", "2130706433", "0x7f.0.0.1", "127.0.0.256", ""):
            for headers in ([], [f"Origin: http://{host}"]):
                request = self.head(*headers, f"Content-Length: {len(BODY)}", host=[f"Host: {host}"]) + BODY
                self.assertEqual(self.raw(request)[0], [403], host)
        for hosts in ([], ["Host: localhost", "Host: evil.com"], ["Host: localhost", "host: localhost"]):
            self.assertEqual(self.raw(self.head(method="GET", host=hosts))[0], [400], hosts)
        self.assertEqual(self.jobs(), 0)
        for listen in ("127.evil.com:0", "localhost.evil.com:0", "127.0.0.1.evil.com:0"):  # no loopback: a token is needed
            outcome = program.run("serve", "--data", self.folder / "other", "--listen", listen)
            self.assertEqual(outcome.code, 2, outcome)
            self.assertIn("token", outcome.err)

    def test_idle_connections_give_way(self):
        """More of them than there are threads, after a request and before the first, while others ask for the status."""
        host, port = self.daemon.listen.rsplit(":", 1)
        greeting = self.head(method="GET", path="/healthz", end=None)
        for count, start in ((72, greeting), (200, b""), (200, greeting), (100, b"GET /healthz HTTP/1.1\r\nHost: loc")):
            idle, times = [], []
            for _ in range(count):
                connection = socket.create_connection((host, int(port)))
                connection.sendall(start)
                idle.append(connection)
            for _ in range(20):
                begin = time.monotonic()
                self.assertEqual(self.daemon.ask("GET", "/healthz").status, 200)
                times.append(time.monotonic() - begin)
                time.sleep(0.01)
            for connection in idle:
                connection.close()
            times.sort()
            print(f"{count} idle after {start[:12]!r}: status median {times[10] * 1e3:.1f} ms, slowest {times[-1] * 1e3:.0f} ms")
            # Who has said half a head has a second for the rest of it: others wait that long, once.
            self.assertLess(times[10], 0.1)
            self.assertLess(times[-1], 5.0)

    def test_connections_that_are_in_use_do_not(self):
        """Each of many clients that ask again and again on one connection keeps it, while there are threads for them."""
        dropped = []

        def client():
            connection = self.daemon.connection()
            for _ in range(20):
                try:
                    self.daemon.ask("GET", "/healthz", connection=connection)
                except OSError as error:
                    dropped.append(error)
                    return
                time.sleep(0.05)
            connection.close()

        pool = [threading.Thread(target=client) for _ in range(40)]
        for thread in pool:
            thread.start()
        for thread in pool:
            thread.join()
        self.assertEqual(dropped, [])


if __name__ == "__main__":
    unittest.main()
