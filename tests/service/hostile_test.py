# ranks: 1
# timeout: 120
"""Requests that mean harm: a few thousand; hostile_full_test.py sends a hundred thousand."""

import os
import stat
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import hostile
import program

TOKEN = "correct-horse-battery-staple"


def access(folder, verdict):
    token = folder / "token"
    token.write_text(TOKEN)
    token.chmod(0o644)
    outcome = program.run("serve", "--data", folder / "d", "--listen", "127.0.0.1:0", "--token-file", token)
    verdict.expect(outcome.code == 2 and "others may read it" in outcome.err, "a token that others may read")
    token.write_text("short")
    token.chmod(0o600)
    outcome = program.run("serve", "--data", folder / "d", "--listen", "127.0.0.1:0", "--token-file", token)
    verdict.expect(outcome.code == 2 and "16 characters" in outcome.err, "a token that is too short")
    verdict.expect(not (folder / "d").exists(), "nothing was made")
    token.write_text(TOKEN)
    # To the network only with a token, and with a word about TLS.
    words = ["--token-file", token, "--max-body", "100K", "--max-jobs", "3", "--max-disk", "2M"]
    with daemon.Daemon(folder, *words, listen="0.0.0.0:%d" % daemon.free_port(), token=TOKEN) as server:
        verdict.expect("TLS" in server.log(), "a warning about TLS")
        for path, method in (("/v1/jobs", "GET"), ("/v1/jobs/1", "GET"), ("/v1/jobs/1/cancel", "POST"), ("/v1/jobs", "POST")):
            status = server.ask(method, path, token=False).status
            verdict.expect(status == 401, f"{method} {path} without a token: {status}")
        for wrong in ("Bearer " + TOKEN[:-1], TOKEN, "bearer " + TOKEN, "Bearer"):
            status = server.ask("GET", "/v1/jobs", headers={"Authorization": wrong}, token=False).status
            verdict.expect(status == 401, f"{wrong!r}: {status}")
        verdict.expect(server.ask("GET", "/v1/jobs").status == 200, "with the token")
        status = server.ask("GET", "/v1/jobs", headers={"Origin": "http://evil.example"}).status
        verdict.expect(status == 403, "a web page from elsewhere")
        status = server.submit("x" * 200000).status
        verdict.expect(status == 413, f"a body that is too long: {status}")
        hostile.forbidden_options(server, verdict)
        hostile.slow_clients(server, 40, verdict, wait_for_end=False)
        ids = [server.submit(key=str(i)).json.get("id") for i in range(2)]
        for number in ids:
            server.wait(number)
        verdict.expect(server.submit().status == 429, "more jobs than are kept")
        server.ask("DELETE", f"/v1/jobs/{ids[0]}")
        big = server.submit(set=["time.step=1e-4"])
        server.wait(big.json["id"])
        server.ask("DELETE", f"/v1/jobs/{ids[1]}")
        status = server.submit().status
        verdict.expect(status == 507, f"more disk than there is: {status}")
        mode = stat.S_IMODE(os.stat(server.data).st_mode)
        verdict.expect(mode == 0o700, f"the data folder is its owner's: {mode:o}")
        verdict.expect(not server.wrong, f"answers as documented: {server.wrong[:3]}")


def unix_socket(folder, verdict):
    path = folder / "socket"
    with daemon.Daemon(folder, listen=f"unix:{path}") as server:
        verdict.expect(stat.S_IMODE(os.stat(path).st_mode) == 0o600, "the socket is its owner's")
        outcome = server.client("jobs")
        verdict.expect(outcome.code == 0, f"the client finds it: {outcome}")
        server.kill()
        server.start()
        verdict.expect(server.ask("GET", "/healthz").status == 200, "a daemon that comes back takes the old name")


def loopback(folder, verdict):
    with daemon.Daemon(folder) as server:
        status = server.ask("GET", "/v1/jobs", headers={"Host": "evil.example"}).status
        verdict.expect(status == 403, "a name that was made to mean 127.0.0.1")


if __name__ == "__main__":
    result = program.Verdict()
    for part in (access, unix_socket, loopback):
        with program.temporary_folder() as temporary:
            part(Path(temporary), result)
    with program.temporary_folder() as temporary:
        hostile.survive(Path(temporary), 3000, "quick", result)
    result.exit()
