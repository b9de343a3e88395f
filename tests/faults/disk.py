"""Small disks for the fault tests: a file system in memory, seen by this process and those it starts only."""

import contextlib
import os
import subprocess
import sys

INSIDE = "SWEEPVI_OWN_MOUNTS"


def enter_own_mounts():
    """Starts the script again where it may mount file systems; False where the system does not let it."""
    if os.environ.get(INSIDE):
        return True
    own = ["unshare", "--user", "--map-root-user", "--mount", "--propagation", "private"]
    try:
        allowed = subprocess.run([*own, "true"], capture_output=True).returncode == 0
    except FileNotFoundError:
        allowed = False
    if allowed:
        os.environ[INSIDE] = "1"
        os.execvp("unshare", [*own, sys.executable, *sys.argv])
    return False


def mount(*words):
    subprocess.run(["mount", *map(str, words)], check=True)


@contextlib.contextmanager
def small_disk(folder, size):
    """A disk of `size` bytes at the folder."""
    mount("-t", "tmpfs", "-o", f"size={size}", "tmpfs", folder)
    try:
        yield
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


def resize(folder, size):
    mount("-o", f"remount,size={size}", folder)


def read_only(folder, yes=True):
    mount("-o", "remount,ro" if yes else "remount,rw", folder)
