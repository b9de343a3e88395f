# ranks: 1
# timeout: 240
"""The service from outside: jobs from submission to result, by HTTP and by the client."""

import base64
import hashlib
import gzip
import json
import subprocess
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import going_on
import program
from daemon import BALL, LONG

CHAIN = """[time]
end = 4.0
step = 2e-2
[model]
kind = "chain"
element = "jerk"
count = 12
coupling = 0.5
force = {offset = -0.1, amplitude = 0.3, frequency = 0.4}
"""
FROM_FILES = """[time]
end = 1.0
step = 0.1
[model]
kind = "linear"
A = "../../A.mtx"
B = {file = "m.h5", dataset = "/B"}
C = [[1, 0]]
f = [0, -1]
x0 = [1, 0]
"""
A_MTX = b"%%MatrixMarket matrix coordinate real general\n2 2 1\n1 2 1.0\n"
PROBLEM = """[problem]
M = [[2, 1], [1, 2]]
q = [-1.0, 2.0]
"""


class InService(unittest.TestCase):
    words = ()

    def setUp(self):
        temporary = program.temporary_folder()
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)
        self.daemon = daemon.Daemon(self.folder, *self.words)
        self.addCleanup(self.daemon.end)
        self.addCleanup(lambda: self.assertEqual(self.daemon.wrong, []))

    def accepted(self, answer, status=201):
        self.assertEqual(answer.status, status, answer.body)
        return answer.json["id"]

    def refused(self, answer, status, *fragments):
        self.assertEqual(answer.status, status, answer.body)
        for fragment in fragments:
            self.assertIn(fragment, answer.json["error"])


class Jobs(InService):
    def test_same_data_as_from_the_command_line(self):
        (self.folder / "scene.toml").write_text(CHAIN)
        for ranks in (1, 2):
            with self.subTest(ranks=ranks):
                local = program.run("run", "scene.toml", "-o", f"local{ranks}.h5", ranks=ranks, cwd=self.folder)
                self.assertEqual(local.code, 0, local)
                outcome = self.daemon.client(
                    "submit", "-n", ranks, "--wait", "run", "scene.toml", "-o", f"remote{ranks}.h5", "--summary", "s.json"
                )
                self.assertEqual(outcome.code, 0, outcome)
                local, remote = (self.folder / f"{kind}{ranks}.h5" for kind in ("local", "remote"))
                self.assertEqual(going_on.same_bits(local, remote), [])
                self.assertGreater(len(going_on.datasets(local)), 5)
                with h5py.File(local) as one, h5py.File(remote) as other:
                    for name in ("scene", "options", "overrides", "ranks"):
                        self.assertEqual(one.attrs[name], other.attrs[name], name)
                self.assertEqual(program.read_json(self.folder / "s.json")["ranks"], ranks)

    def test_matrices_come_with_the_scene_under_any_name(self):
        h5 = self.folder / "m.h5"
        with h5py.File(h5, "w") as file:
            file["B"] = np.array([[0.0], [1.0]])
        np.savez(self.folder / "c.npz", np.array([[1.0, 0.0]]))
        files = {"../../A.mtx": gzip.compress(A_MTX), "m.h5": h5.read_bytes(), "c": (self.folder / "c.npz").read_bytes()}
        number = self.accepted(self.daemon.submit(FROM_FILES.replace("[[1, 0]]", '"c"'), files))
        job = self.daemon.wait(number)
        self.assertEqual(job["state"], "done", job)
        result = self.daemon.fetch(number, self.folder / "result.h5")
        with h5py.File(result) as file:
            self.assertAlmostEqual(file["x"][-1, 0], 1 - 1.1 * 1.0 / 2, places=12)  # implicit Euler, 10 steps of 0.1
        self.assertFalse((self.daemon.data / "A.mtx").exists())
        # What did not come along is not there, even if the daemon could read it.
        self.refused(self.daemon.submit(FROM_FILES, {"m.h5": h5.read_bytes()}), 400, "../../A.mtx", "hand it in")
        secret = self.folder / "secret.mtx"
        secret.write_bytes(A_MTX)
        for name in (str(secret), "/etc/passwd"):
            self.refused(self.daemon.submit(BALL.replace("[[0, 1], [0, 0]]", f'"{name}"')), 400, "hand it in")
            self.refused(self.daemon.submit(set=[f"model.A={name}"]), 400, "hand it in")

    def test_hdf5_files_that_lead_elsewhere_are_refused(self):
        (self.folder / "other.h5").touch()
        with h5py.File(self.folder / "other.h5", "w") as file:
            file["B"] = np.array([[0.0], [1.0]])
        linked, raw = self.folder / "linked.h5", self.folder / "raw.h5"
        with h5py.File(linked, "w") as file:
            file["B"] = h5py.ExternalLink(str(self.folder / "other.h5"), "/B")
        with h5py.File(raw, "w") as file:
            file.create_dataset("B", (2, 1), "f8", external=[(str(self.folder / "other.h5"), 0, 16)])
        for path, fragment in ((linked, "link to another file"), (raw, "data in other files")):
            files = {"../../A.mtx": A_MTX, "m.h5": path.read_bytes()}
            self.refused(self.daemon.submit(FROM_FILES, files), 400, fragment)

    def test_problems_and_studies(self):
        solve = self.accepted(self.daemon.submit(None, problem=PROBLEM))
        study = self.accepted(
            self.daemon.submit(verb="study", steps=[0.1, 0.05], repeats=1, settings='[[setting]]\nname = "own"\n')
        )
        self.assertEqual(self.daemon.wait(solve)["state"], "done")
        with h5py.File(self.daemon.fetch(solve, self.folder / "s.h5")) as file:
            self.assertTrue(np.allclose(file["solution"][()], [0.5, 0.0]))
        job = self.daemon.wait(study)
        self.assertEqual(job["state"], "done", job)
        answer = self.daemon.ask("GET", f"/v1/jobs/{study}/result")
        self.assertEqual(answer.headers["Content-Type"], "text/csv")
        self.assertEqual(len(answer.body.splitlines()), 3, answer.body)
        self.refused(self.daemon.submit(None, problem=PROBLEM.replace("q = [-1.0, 2.0]", "q = [1]")), 400, "problem.q")
        self.refused(self.daemon.submit(verb="study"), 400, "steps")

    def test_what_check_refuses_is_not_queued(self):
        answer = self.daemon.submit(BALL.replace("step = 0.1", "stepp = 0.1"), name="mine.toml")
        self.refused(answer, 400, "mine.toml:", "stepp", "did you mean 'step'")
        self.assertEqual(answer.json["exit"], 2)
        self.assertEqual(self.daemon.ask("GET", "/v1/jobs").json["jobs"], [])
        self.assertEqual(list(self.daemon.data.glob("jobs/*")), [])

    def test_descriptions_are_read_strictly(self):
        self.refused(self.daemon.submit(BALL, ranks=99), 400, "ranks")
        self.refused(self.daemon.submit(BALL, ranks=1.5), 400, "ranks")
        self.refused(self.daemon.submit(BALL, colour=1), 400, "colour", "known are")
        self.refused(self.daemon.submit(None), 400, "scene")
        self.refused(self.daemon.submit(BALL, verb="bench"), 400, "verb")
        self.refused(self.daemon.submit(BALL, set=["nothing"]), 400, "set")
        self.refused(self.daemon.submit(BALL, headers={"Content-Type": "text/plain"}), 415)
        self.refused(self.daemon.submit(BALL, headers={"Content-Encoding": "gzip"}), 415)
        for path in ("/v1/jobs/17", "/v1/jobs/17/result", "/v1/jobs/17/events"):
            self.refused(self.daemon.ask("GET", path), 404, "no job 17")
        self.refused(self.daemon.ask("GET", "/v1/elsewhere"), 404)

    def test_one_key_is_one_job(self):
        first = self.daemon.submit(key="one")
        again = self.daemon.submit(key="one")
        self.assertEqual((first.status, again.status), (201, 200))
        self.assertEqual(first.json["id"], again.json["id"])
        self.refused(self.daemon.submit(BALL + "# other\n", key="one"), 409, "another request")
        self.assertEqual(len(self.daemon.ask("GET", "/v1/jobs").json["jobs"]), 1)

    def test_result_in_parts_with_its_digest(self):
        number = self.accepted(self.daemon.submit())
        job = self.daemon.wait(number)
        path = f"/v1/jobs/{number}/result"
        whole = self.daemon.ask("GET", path)
        data = whole.body
        self.assertEqual(hashlib.sha256(data).hexdigest(), job["result"]["sha256"])
        digest = base64.b64encode(hashlib.sha256(data).digest()).decode()
        self.assertEqual(whole.headers["Repr-Digest"], f"sha-256=:{digest}:")
        for asked, part in (("0-0", data[:1]), ("10-19", data[10:20]), ("5-", data[5:]), ("-7", data[-7:]),
                            ("0-99999999999", data)):
            answer = self.daemon.ask("GET", path, headers={"Range": "bytes=" + asked})
            self.assertEqual((answer.status, answer.body), (206, part), asked)
            self.assertEqual(answer.headers["Repr-Digest"], whole.headers["Repr-Digest"])
        self.assertRegex(answer.headers["Content-Range"], rf"bytes 0-{len(data) - 1}/{len(data)}")
        for asked in (f"{len(data)}-", "-0", "999999999999-"):
            answer = self.daemon.ask("GET", path, headers={"Range": "bytes=" + asked})
            self.assertEqual(answer.status, 416, asked)
            self.assertEqual(answer.headers["Content-Range"], f"bytes */{len(data)}")
        for asked in ("5-2", "x-y", "1-2,4-5", "-", "99999999999999999999-"):
            answer = self.daemon.ask("GET", path, headers={"Range": "bytes=" + asked})
            self.assertIn(answer.status, (200, 416), asked)  # what cannot be read may be left aside
            self.assertEqual(answer.body == data, answer.status == 200)
        tag = whole.headers["ETag"]
        other = self.daemon.ask("GET", path, headers={"Range": "bytes=0-1", "If-Range": '"other"'})
        self.assertEqual((other.status, other.body), (200, data))
        self.assertEqual(self.daemon.ask("GET", path, headers={"If-None-Match": tag}).status, 304)
        self.assertEqual(self.daemon.ask("GET", "/healthz", headers={"Range": "bytes=999-1999"}).status, 200)

    def test_pictures(self):
        number = self.accepted(self.daemon.submit())
        self.daemon.wait(number)
        answer = self.daemon.ask("GET", f"/v1/jobs/{number}/picture")
        self.assertEqual(answer.status, 200, answer.body[:300])
        self.assertTrue(answer.body.startswith(b"\x89PNG"))

    def test_deleting_frees_the_disk(self):
        number = self.accepted(self.daemon.submit())
        self.daemon.wait(number)
        self.assertTrue(self.daemon.home(number).exists())
        self.assertEqual(self.daemon.ask("DELETE", f"/v1/jobs/{number}").status, 204)
        self.assertEqual(list(self.daemon.data.glob("jobs/*")), [])
        self.refused(self.daemon.ask("DELETE", f"/v1/jobs/{number}"), 404)

    def test_events_go_on_after_a_reconnection(self):
        number = self.accepted(self.daemon.submit(LONG, set=["time.end=100"]))
        identifiers, steps = [], []
        last = None
        # Read a few events, hang up, come back with the last identifier.
        for _ in range(200):
            connection = self.daemon.connection()
            connection.request("GET", f"/v1/jobs/{number}/events", headers={"Last-Event-ID": last} if last else {})
            response = connection.getresponse()
            self.assertEqual(response.headers["Content-Type"], "text/event-stream")
            event, count, end = {}, 0, False
            while count < 3 and not end:
                line = response.readline().decode().rstrip("\n")
                if line:
                    event.update([line.split(": ", 1)])
                    continue
                last = event["id"]
                data = json.loads(event["data"])
                if event["event"] == "progress":
                    identifiers.append(int(last))
                    steps.append(data["step"])
                    for key in ("t", "iterations", "residual", "end", "left"):
                        self.assertIn(key, data)
                count += event["event"] == "progress"
                end = event["event"] == "end"
            connection.close()
            if end:
                break
        self.assertTrue(end)
        self.assertEqual(data["state"], "done")
        self.assertEqual(identifiers, sorted(set(identifiers)))
        self.assertEqual(steps, sorted(set(steps)), "an event came twice, or out of order")
        self.assertEqual(steps[-1], 10000)
        lines = (self.daemon.home(number) / "progress").read_text().splitlines()
        self.assertEqual(steps, [json.loads(line)["step"] for line in lines], "an event was lost")

    def test_client(self):
        (self.folder / "a.mtx").write_bytes(A_MTX)
        (self.folder / "scene.toml").write_text(BALL.replace("[[0, 1], [0, 0]]", '"a.mtx"'))
        submitted = self.daemon.client("submit", "--priority", 3, "run", "scene.toml", "--set", "time.step=0.05", "-snes_type",
                                       "vinewtonssls")
        self.assertEqual(submitted.code, 0, submitted)
        number = int(submitted.out)
        watched = self.daemon.client("watch", number)
        self.assertEqual(watched.code, 0, watched)
        self.assertIn("step 40 of 40", watched.err)
        fetched = self.daemon.client("fetch", number, "-o", "r.h5")
        self.assertEqual(fetched.code, 0, fetched)
        self.assertEqual(self.daemon.client("fetch", number, "-o", "r.h5").code, 5)
        with h5py.File(self.folder / "r.h5") as file:
            self.assertEqual(len(file["t"]), 41)
        job = self.daemon.job(number)
        self.assertEqual((job["priority"], job["options"]), (3, ["-snes_type", "vinewtonssls"]))
        self.assertRegex(self.daemon.client("jobs").out, rf"{number}  done .*scene.toml")
        bad = self.daemon.client("submit", "run", "scene.toml", "--set", "time.step=-1")
        self.assertEqual(bad.code, 2, bad)
        self.assertIn("time.step", bad.err)
        self.assertEqual(self.daemon.client("submit", "run", "scene.toml", "-log_view", ":/tmp/x").code, 2)
        self.assertEqual(self.daemon.client("watch", 99).code, 2)
        self.assertEqual(self.daemon.client("submit", "dance").code, 2)
        log = self.daemon.client("fetch", number, "--log")
        self.assertIn("result.h5: 40 steps", log.out)

    def test_every_route_is_in_the_document(self):
        source = (program.SOURCE / "src/service/routes.cpp").read_text()
        document = daemon.DOCUMENT["paths"]
        self.assertEqual(self.daemon.ask("GET", "/openapi.json").json, daemon.DOCUMENT)
        written = sum(len(operations) for operations in document.values())
        self.assertEqual(source.count("server_.Get(") + source.count("server_.Post(") + source.count("server_.Delete("), written)
        for path, operations in document.items():
            for method in operations:
                answer = self.daemon.ask(method.upper(), path.replace("{id}", "1"))
                self.assertNotIn(b"there is nothing here", answer.body, path)


class Alone(unittest.TestCase):
    def test_needs_neither_mpi_nor_petsc(self):
        listed = subprocess.run(["ldd", daemon.SERVE], capture_output=True, text=True, check=True).stdout
        self.assertIn("libsqlite3", listed)
        for library in ("mpi", "petsc", "hdf5", "libsweepvi"):
            self.assertNotIn(library, listed)

    def test_help(self):
        general = program.run("help").out
        for verb in ("serve", "submit", "jobs", "watch", "fetch", "cancel", "resume"):
            self.assertRegex(general, rf"(?m)^  {verb} ")
            own = program.run("help", verb)
            self.assertEqual((own.code, own.out.split()[:3]), (0, ["Usage:", "sweepvi", verb]))
            self.assertEqual(program.run(verb, "--help").out, own.out)

    def test_bad_words(self):
        for words, fragment in (
            (["serve", "--cores", "0"], "--cores"),
            (["serve", "--listen", "0.0.0.0:0"], "token"),
            (["serve", "--colour"], "no option"),
            (["serve", "more"], "unexpected word"),
            (["serve", "--launcher", "cron"], "mpirun or slurm"),
            (["fetch"], "number of a job"),
            (["jobs", "--server", "ftp://x"], "--server"),
        ):
            outcome = program.run(*words)
            self.assertEqual(outcome.code, 2, outcome)
            self.assertIn(fragment, outcome.err)
        outcome = program.run("jobs", "--server", "http://127.0.0.1:1")
        self.assertEqual(outcome.code, 1, outcome)
        self.assertIn("does not answer", outcome.err)


if __name__ == "__main__":
    unittest.main()
