# ranks: 2
# labels: long
# timeout: 3000
"""A thousand small jobs from sixteen clients at once, and a daemon that is killed twenty times meanwhile.
usage: load_test.py [JOBS KILLS]"""

import http.client
import random
import sys
import threading
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import program

CLIENTS = 16


def quantiles(times):
    times = sorted(times)
    return times[len(times) // 2] * 1e3, times[int(len(times) * 0.99)] * 1e3


class Load:
    def __init__(self, server, jobs, kills):
        self.server, self.jobs = server, jobs
        # When so many have been done, it is killed.
        self.moments = sorted(random.Random(1).sample(range(int(0.95 * jobs)), kills))
        self.numbers, self.submits, self.asks, self.retries = {}, [], [], 0
        self.lock = threading.Lock()
        self.kills = 0

    def insist(self, work, times):
        """Again until there is an answer: while the daemon is down, and where its death cut one off."""
        while True:
            begin = time.monotonic()
            try:
                answer = work()
            except (ConnectionError, http.client.HTTPException, OSError):
                with self.lock:
                    self.retries += 1
                time.sleep(0.05)
                continue
            with self.lock:
                times.append(time.monotonic() - begin)
            return answer

    def client(self, number):
        for i in range(number, self.jobs, CLIENTS):
            scene = daemon.BALL.replace("x0 = [1, 0]", f"x0 = [{1 + i / self.jobs}, 0]")
            answer = self.insist(lambda scene=scene, i=i: self.server.submit(scene, key=f"job {i}"), self.submits)
            if answer.status not in (200, 201):
                raise AssertionError(f"{answer.status}: {answer.body}")
            with self.lock:
                self.numbers.setdefault(i, set()).add(answer.json["id"])
            one = random.choice([n for ids in list(self.numbers.values()) for n in ids])
            for _ in range(3):
                self.insist(lambda one=one: self.server.ask("GET", f"/v1/jobs/{one}"), self.asks)

    def killer(self):
        while True:
            counts = self.insist(lambda: self.server.ask("GET", "/v1/jobs?limit=0"), []).json["counts"]
            if self.kills < len(self.moments) and counts["done"] >= self.moments[self.kills]:
                time.sleep(random.random() * 0.3)
                self.server.kill()
                self.kills += 1
                time.sleep(random.random() * 0.5)
                self.server.start()
            if counts["done"] + counts["failed"] + counts["interrupted"] >= self.jobs:
                return
            time.sleep(0.2)

    def run(self):
        threads = [threading.Thread(target=self.client, args=(number,)) for number in range(CLIENTS)]
        threads.append(threading.Thread(target=self.killer))
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()


def throughput(server, number, seconds=3.0):
    """Status requests per second that sixteen clients get, on connections that stay open."""
    count, times, lock = [0], [], threading.Lock()
    until = time.monotonic() + seconds

    def client():
        own = []
        connection = server.connection()
        while time.monotonic() < until:
            begin = time.monotonic()
            connection.request("GET", f"/v1/jobs/{number}")
            connection.getresponse().read()
            own.append(time.monotonic() - begin)
        connection.close()
        with lock:
            times.extend(own)
            count[0] += len(own)

    threads = [threading.Thread(target=client) for _ in range(CLIENTS)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return count[0] / seconds, quantiles(times)


def main(jobs, kills, verdict):
    with program.temporary_folder() as temporary, daemon.Daemon(temporary) as server:
        warm = server.submit().json["id"]
        server.wait(warm)
        server.ask("DELETE", f"/v1/jobs/{warm}")
        before = server.memory()
        load, begin = Load(server, jobs, kills), time.monotonic()
        load.run()
        seconds = time.monotonic() - begin
        after = server.memory()
        counts = server.ask("GET", "/v1/jobs?limit=0").json["counts"]
        print(f"{jobs} jobs from {CLIENTS} clients in {seconds:.0f} s, {load.kills} times killed, {load.retries} requests sent again")
        print("submit: median {:.0f} ms, 99 % {:.0f} ms".format(*quantiles(load.submits)))
        print("status: median {:.1f} ms, 99 % {:.1f} ms (while jobs run)".format(*quantiles(load.asks)))
        print(f"memory of the daemon: {before / 2**20:.1f} MB before, {after / 2**20:.1f} MB after (the last one started)")
        verdict.expect(load.kills == kills, f"killed {load.kills} times")
        verdict.expect(counts["done"] == jobs and sum(counts.values()) == jobs, f"all done, none lost: {counts}")
        ids = [number for numbers in load.numbers.values() for number in numbers]
        verdict.expect(len(ids) == jobs == len(set(ids)), "each key is one job")
        twice, bad = [], []
        for number in ids:
            folder = server.home(number)
            if (folder / "log").read_text().count("result.h5: ") != 1:
                twice.append(number)
            ran = [path for path in folder.glob("attempt-*") if (path / "ending.json").exists()]
            if len(ran) != 1 or not (folder / "result.h5").exists():
                bad.append(number)
        verdict.expect(not twice, f"none was run twice: {twice}")
        verdict.expect(not bad, f"each has one ending and a result: {bad}")
        verdict.expect(not server.wrong, f"answers as documented: {server.wrong[:3]}")
        rate, (median, most) = throughput(server, ids[0])
        print(f"status, nothing else going on: {rate:.0f} requests/s, median {median:.1f} ms, 99 % {most:.1f} ms")


if __name__ == "__main__":
    verdict = program.Verdict()
    given = [int(word) for word in sys.argv[1:3]] or [1000, 20]
    main(*given, verdict)
    verdict.exit()
