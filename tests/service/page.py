"""Opens the status page in a headless Chromium, once, with a finished job: part `page` of scripts/check."""

import re
import subprocess
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import program


def show(server, folder, address):
    """The page after its scripts have worked for a while, and what the browser complains about."""
    command = ["chromium", "--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={folder / 'browser'}", "--enable-logging=stderr",
               "--window-size=1100,1600", "--virtual-time-budget=8000", "--timeout=20000"]
    outcome = subprocess.run([*command, "--dump-dom", server.url + address], capture_output=True, text=True, timeout=90, check=False)
    return outcome.stdout, re.findall(r".*(?:CONSOLE|Refused to|ERR_).*", outcome.stderr)


def main(folder, verdict):
    with daemon.Daemon(folder) as server:
        number = server.submit(name="<b>ball</b> & more.toml").json["id"]
        server.wait(number)
        running = server.submit(daemon.LONG, set=["time.end=1e5"]).json["id"]
        server.wait_for_progress(running)
        text, complaints = show(server, folder, f"/#{number}")
        print(f"{len(text)} characters")
        verdict.expect(f"{number}: &lt;b&gt;ball&lt;/b&gt; &amp; more.toml, done" in text, "the job, its name as text")
        verdict.expect(len(re.findall(r'<tr class="job', text)) == 2, "both jobs in the list")
        verdict.expect(re.search(r"<progress [^>]*max=\"10000000\"", text), "live progress of the one that runs")
        verdict.expect(re.search(r'<img id="picture"[^>]* src="blob:', text) and not re.search(r'<img id="picture"[^>]* hidden', text),
                       "a picture of the result")
        verdict.expect('"steps": 20' in text, "its summary")
        verdict.expect("result.h5: 20 steps" in text, "its log")
        verdict.expect(not complaints, f"no complaints of the browser: {complaints[:3]}")
        verdict.expect(not re.search(r'(?:src|href)="(?!blob:|data:)', text), "nothing from elsewhere")
        server.ask("POST", f"/v1/jobs/{running}/cancel")
        server.wait(running)


if __name__ == "__main__":
    result = program.Verdict()
    with program.temporary_folder() as temporary:
        main(Path(temporary), result)
    result.exit()
