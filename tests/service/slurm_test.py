# ranks: 2
# labels: long
# timeout: 900
"""The launcher for Slurm against a real Slurm of one node (scripts/slurm_node; its packages: scripts/setup check)."""

import os
import subprocess
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import going_on
import program

SCENE = daemon.LONG.replace("count = 30", "count = 60")  # must outlast a job that is cancelled while it waits


def slurm(*words):
    return subprocess.run(words, capture_output=True, text=True, check=False).stdout


def names():
    """Jobs that Slurm has now, by name and state."""
    return dict(line.split() for line in slurm("squeue", "-h", "-o", "%j %T").splitlines())


def await_(condition, text, timeout=90):
    deadline = time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, f"not in {timeout} s: {text}"
        time.sleep(0.2)


def try_it(folder, verdict):
    (folder / "scene.toml").write_text(SCENE)
    whole = {}
    for ranks in (1, 2):
        whole[ranks] = folder / f"whole{ranks}.h5"
        outcome = program.run("run", "scene.toml", "-o", whole[ranks], ranks=ranks, cwd=folder, timeout=120)
        assert outcome.code == 0, outcome
    with daemon.Daemon(folder, "--launcher", "slurm", "--cores", 6) as server:
        for ranks in (1, 2):
            begin = time.monotonic()
            number = server.submit(SCENE, ranks=ranks).json["id"]
            job = server.wait(number, timeout=120)
            verdict.expect(job["state"] == "done", f"{ranks} ranks: {job['state']} {job['message']} ({time.monotonic() - begin:.1f} s)")
            same = going_on.same_bits(whole[ranks], server.fetch(number, folder / "r.h5"))
            verdict.expect(same == [], f"{ranks} ranks: data as from the command line, bit for bit {same}")

        number = server.submit(SCENE, ranks=2).json["id"]
        server.wait_for_progress(number, timeout=90)
        waiting = server.submit(daemon.BALL, ranks=2).json["id"]
        await_(lambda: len(names()) == 2, "two jobs in Slurm")
        states = sorted(names().values())
        verdict.expect(states == ["PENDING", "RUNNING"], f"one runs, one waits in Slurm's queue: {states}")
        server.ask("POST", f"/v1/jobs/{waiting}/cancel")
        job = server.wait(waiting, timeout=60)
        verdict.expect((job["state"], job["exit"]) == ("cancelled", None), f"cancelled in Slurm's queue: {job['state']} {job['message']}")
        server.ask("POST", f"/v1/jobs/{number}/cancel")
        job = server.wait(number, timeout=60)
        verdict.expect((job["state"], job["exit"], job["checkpoint"]) == ("cancelled", 4, True), f"cancelled: {job['message']}")
        await_(lambda: not names(), "Slurm's queue is empty")
        server.ask("POST", f"/v1/jobs/{number}/resume")
        job = server.wait(number, timeout=120)
        verdict.expect((job["state"], job["attempt"]) == ("done", 2), f"resumed: {job['state']} {job['message']}")
        same = going_on.same_bits(whole[2], server.fetch(number, folder / "r.h5"))
        verdict.expect(same == [], f"what was cancelled and resumed: the same bits {same}")

        # The daemon dies while one runs and one waits.
        running = server.submit(SCENE, ranks=2).json["id"]
        server.wait_for_progress(running, timeout=90)
        waiting = server.submit(daemon.BALL, ranks=2).json["id"]
        await_(lambda: len(names()) == 2, "two jobs in Slurm")
        server.kill()
        server.start()
        for one in (running, waiting):
            job = server.wait(one, timeout=120)
            verdict.expect((job["state"], job["attempt"]) == ("done", 1), f"after kill -9: {job['state']}, attempt {job['attempt']}")

        # An administrator ends it.
        number = server.submit(SCENE, ranks=1, set=["output.checkpoint=0.1"]).json["id"]
        server.wait_for_progress(number, timeout=90)
        slurm("scancel", "--full", "--signal=KILL", "--name=" + next(iter(names())))
        slurm("scancel", "--name=" + next(iter(names()), "none"))
        job = server.wait(number, timeout=90)
        verdict.expect(job["state"] == "interrupted" and job["checkpoint"], f"ended by scancel: {job['state']}: {job['message']}")
        print(slurm("sacct", "-n", "-X", "-P", "--format=JobName,State,ExitCode"))
        verdict.expect(server.wrong == [], f"answers as documented: {server.wrong[:2]}")

    with daemon.Daemon(folder, "--launcher", "slurm", "--launcher-words", "--partition=nowhere") as server:
        number = server.submit().json["id"]
        job = server.wait(number)
        verdict.expect(job["state"] == "failed" and "partition" in job["message"], f"sbatch refuses: {job['message']}")


if __name__ == "__main__":
    result = program.Verdict()
    node = str(program.SOURCE / "scripts/slurm_node")
    with program.temporary_folder() as temporary:
        cluster, work = Path(temporary) / "slurm", Path(temporary) / "work"
        work.mkdir()
        try:
            subprocess.run([node, "start", cluster], check=True, stdin=subprocess.DEVNULL, timeout=120)
            os.environ["SLURM_CONF"] = str(cluster / "slurm.conf")
            try_it(work, result)
        finally:
            subprocess.run([node, "stop", cluster], check=False)
            time.sleep(3)
    result.exit()
