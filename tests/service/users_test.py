# ranks: 1
"""Several users with tokens and limits of their own: what others have handed in is as if it were not there."""

import os
import sqlite3
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import program
from daemon import BALL, LONG

TOKENS = {"alice": "a" * 32, "bob": "b" * 32, "root": "c" * 32}
FILE = f"""# name, token, limits
alice {TOKENS["alice"]} max-jobs=3
bob   {TOKENS["bob"]}   max-disk=1K

root  {TOKENS["root"]}  admin
"""


class Users(unittest.TestCase):
    def setUp(self):
        temporary = program.temporary_folder()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)
        self.write(FILE)

    def write(self, text):
        path = self.folder / "users"
        path.write_text(text)
        path.chmod(0o600)

    def start(self):
        self.daemon = daemon.Daemon(self.folder, "--token-file", self.folder / "users")
        self.addCleanup(self.daemon.end)
        self.addCleanup(lambda: self.assertEqual(self.daemon.wrong, []))

    def ask(self, user, method, path, *rest, **more):
        self.daemon.token = TOKENS.get(user, user)
        return self.daemon.ask(method, path, *rest, **more)

    def submit(self, user, *rest, code=201, **more):
        self.daemon.token = TOKENS[user]
        answer = self.daemon.submit(*rest, **more)
        self.assertEqual(answer.status, code, answer.body)
        return answer.json

    def test_each_sees_his_own(self):
        self.start()
        hers, his = self.submit("alice", key="k")["id"], self.submit("bob", BALL + "\n", key="k")["id"]
        self.assertEqual(self.submit("alice", key="k", code=200)["id"], hers)
        self.daemon.token = TOKENS["root"]
        for number in (hers, his):
            self.assertEqual(self.daemon.wait(number)["state"], "done")
        for user, own, other in (("alice", hers, his), ("bob", his, hers)):
            self.assertEqual(self.ask(user, "GET", f"/v1/jobs/{own}").json["owner"], user)
            listed = self.ask(user, "GET", "/v1/jobs").json
            self.assertEqual(([job["id"] for job in listed["jobs"]], listed["counts"]["done"]), ([own], 1))
            self.assertEqual(self.ask(user, "GET", f"/v1/jobs/{own}/result").status, 200)
            absent = self.ask(user, "GET", "/v1/jobs/999999").body.replace(b"999999", str(other).encode())
            for method, path in (
                *(("GET", part) for part in ("", "/result", "/log", "/picture", "/events")),
                ("POST", "/cancel"),
                ("POST", "/resume"),
                ("DELETE", ""),
            ):
                answer = self.ask(user, method, f"/v1/jobs/{other}{path}")
                self.assertEqual((answer.status, answer.body), (404, absent), (user, method, path))
        self.assertEqual([job["id"] for job in self.ask("root", "GET", "/v1/jobs").json["jobs"]], [his, hers])
        for token in ("", "x" * 32, TOKENS["alice"][:-1], TOKENS["alice"] + "a", "nobody"):
            self.assertEqual(self.ask(token, "GET", "/v1/jobs", token=bool(token)).status, 401, token)
        self.assertEqual(self.ask("bob", "DELETE", f"/v1/jobs/{his}").status, 204)
        self.assertEqual(self.ask("root", "DELETE", f"/v1/jobs/{hers}").status, 204)

    def test_one_cannot_stop_another(self):
        self.start()
        number = self.submit("alice", LONG)["id"]
        self.assertEqual(self.ask("bob", "POST", f"/v1/jobs/{number}/cancel").status, 404)
        self.assertIn(self.ask("alice", "GET", f"/v1/jobs/{number}").json["state"], ("queued", "running"))
        self.assertEqual(self.ask("root", "POST", f"/v1/jobs/{number}/cancel").status, 202)
        self.assertEqual(self.daemon.wait(number)["state"], "cancelled")

    def test_limits(self):
        self.start()
        numbers = [self.submit("alice")["id"] for _ in range(3)]
        self.assertIn("as many as you may keep", self.submit("alice", code=429)["error"])
        self.daemon.token = TOKENS["root"]
        self.daemon.wait(numbers[0])
        self.assertEqual(self.ask("alice", "DELETE", f"/v1/jobs/{numbers[0]}").status, 204)
        self.submit("alice")
        first = self.submit("bob")["id"]
        self.daemon.wait(first)
        self.assertIn("your jobs together", self.submit("bob", code=507)["error"])
        self.submit("root")

    def test_owners_are_kept(self):
        """When the queue is lost, and when there were no users before."""
        self.start()
        number = self.submit("alice")["id"]
        self.daemon.wait(number)
        self.daemon.kill()
        (self.daemon.data / "queue.db").unlink()
        self.daemon.start()
        self.daemon.wait(number)
        self.assertEqual(self.ask("bob", "GET", f"/v1/jobs/{number}").status, 404)
        self.assertEqual(self.ask("alice", "GET", f"/v1/jobs/{number}").json["state"], "done")
        self.daemon.kill()
        with sqlite3.connect(self.daemon.data / "queue.db") as queue:  # as version 2 had it
            queue.execute("ALTER TABLE jobs DROP COLUMN owner")
            queue.execute("PRAGMA user_version = 2")
        queue.close()
        self.daemon.start()
        self.assertEqual(self.ask("alice", "GET", f"/v1/jobs/{number}").status, 404)
        self.assertEqual(self.ask("root", "GET", f"/v1/jobs/{number}").json["state"], "done")

    def test_files_that_are_refused(self):
        for text, fragment in (
            ("", "expected a word"),
            ("alice short", "16 characters"),
            ("Alice " + "a" * 32, "a name has"),
            (f"alice {'a' * 32} max-jobs=0", "expected a number from 1"),
            (f"alice {'a' * 32} max-jobs=many", "expected a number"),
            (f"alice {'a' * 32} superuser", "expected admin"),
            (f"alice {'a' * 32}\nalice {'b' * 32}", "users:2: a name or a token"),
            (f"alice {'a' * 32}\nbob {'a' * 32}", "users:2: a name or a token"),
        ):
            self.write(text)
            outcome = program.run("serve", "--data", self.folder / "data", "--token-file", self.folder / "users")
            self.assertEqual(outcome.code, 2, outcome)
            self.assertIn(fragment, outcome.err)
            self.assertNotIn("a" * 32, outcome.err)
        self.write(FILE)
        os.chmod(self.folder / "users", 0o644)
        outcome = program.run("serve", "--data", self.folder / "data", "--token-file", self.folder / "users")
        self.assertEqual(outcome.code, 2, outcome)
        self.assertFalse((self.folder / "data").exists())


if __name__ == "__main__":
    unittest.main()
