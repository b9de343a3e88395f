# ranks: 2
# labels: long
# timeout: 1800
"""A hundred thousand requests that mean harm, and clients who never come to their end."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent))
import daemon
import hostile
import program

if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 100200
    result = program.Verdict()
    with program.temporary_folder() as temporary:
        hostile.survive(Path(temporary), count, "long", result)
    with program.temporary_folder() as temporary:
        folder = Path(temporary)
        (folder / "token").write_text("correct-horse-battery-staple")
        (folder / "token").chmod(0o600)
        with daemon.Daemon(folder, "--token-file", folder / "token", token="correct-horse-battery-staple") as server:
            hostile.slow_clients(server, 60, result, wait_for_end=True)
    result.exit()
