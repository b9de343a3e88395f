# Disks that fill up at any point of a run, and disks that may only be read: exit 5 with the reason, no half file; and
# once there is room the run goes on from its last checkpoint to the same bits.
#
# ranks: 2
# labels: long
# timeout: 1200
import contextlib
import os
import time

import disk
import faults
import program
import same_bits

CASE = faults.Case("jerk chain", "jerk_chain/scene.toml", ("model.count=600", "time.step=4e-2", "output.every=1"))
PARTS = 0.0005, 0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.98, 1.0, 1.02, 1.05  # of what the run needs


def run(case, words, ranks, folder):
    run = faults.Run([*case.words(), "-o", faults.FILE, *words], ranks, folder)
    code, err = run.wait(), run.err()
    run.close()
    return code, err


def fill(case, ranks, expected, part, verdict):
    """Whether the run went on from a checkpoint that it left when the disk was full."""
    size = int(part * expected.stat().st_size)
    name = f"{ranks} ranks, a disk of {size} bytes, {part} of the file"
    with program.temporary_folder() as folder, disk.small_disk(folder, size):
        code, err = run(case, [], ranks, folder)
        path = faults.Path(folder) / faults.FILE
        if code == 0:
            verdict.expect(not same_bits.differences(path, expected), f"{name}: enough")
            return False
        left = sorted(os.listdir(folder))
        tells = "no room for" in err or "No space left" in err
        tells = tells and (faults.CHECKPOINT in left) == (f"--restart {faults.CHECKPOINT}" in err)
        verdict.expect(code == 5 and tells and not path.exists(), f"{name}: exit {code}, left {left}")
        if code != 5 or not tells:
            print(err)
        disk.resize(folder, 4 * expected.stat().st_size + 2**22)
        words = faults.restart_words(folder)
        code, err = run(case, words, ranks, folder)
        same = code == 0 and not same_bits.differences(path, expected)
        verdict.expect(same, f"{name}: goes on {'from a checkpoint' if words else 'from the start'}, exit {code}")
        verdict.expect(os.listdir(folder) == [faults.FILE], f"{name}: {sorted(os.listdir(folder))} in the end")
        return bool(words)


def fill_for_a_while(ranks, verdict):
    """Somebody else takes all that is left, and gives it back: the run goes on in the room it has, its checkpoints, too."""
    case = faults.Case("tracking", "zi_tracking/scene.toml", ("time.step=5e-4", "output.every=7")).often()
    with program.temporary_folder() as own, program.temporary_folder() as folder, disk.small_disk(folder, 2**24):
        expected, _ = faults.undisturbed(case, ranks, own)
        run = faults.Run([*case.words(), "-o", faults.FILE], ranks, folder)
        checkpoint, others = faults.Path(folder) / faults.CHECKPOINT, faults.Path(folder) / "others"
        while run.process.poll() is None and not checkpoint.exists():
            time.sleep(1e-3)
        with open(others, "wb", buffering=0) as file, contextlib.suppress(OSError):
            while True:
                file.write(bytes(2**12))
        versions = set()
        while run.process.poll() is None and len(versions) < 3:
            with contextlib.suppress(FileNotFoundError):
                versions.add(checkpoint.stat().st_mtime_ns)
            time.sleep(1e-3)
        others.unlink()
        code, err = run.wait(), run.err()
        run.close()
        same = code == 0 and not same_bits.differences(faults.Path(folder) / faults.FILE, expected)
        verdict.expect(same, f"{ranks} ranks, a disk that is full for a while: exit {code}")
        verdict.expect(len(versions) == 3, f"{ranks} ranks: {len(versions)} checkpoints meanwhile")
        if code != 0:
            print(err)


def refuse_read_only(ranks, expected, verdict):
    with program.temporary_folder() as folder, disk.small_disk(folder, 2 * expected.stat().st_size + 2**20):
        disk.read_only(folder)
        code, err = run(CASE, [], ranks, folder)
        found = code == 5 and not os.listdir(folder) and "Read-only" in err
        verdict.expect(found, f"{ranks} ranks, a read-only disk: exit {code}")
        if not found:
            print(err)


def main():
    if not disk.enter_own_mounts():
        print("skipped: this system lets nobody mount a small disk (unshare --user --mount)")
        return
    verdict = program.Verdict()
    for ranks in 1, 2:
        with program.temporary_folder() as folder:
            expected, _ = faults.undisturbed(CASE, ranks, folder)
            for part in PARTS:
                fill(CASE.often(), ranks, expected, part, verdict)
            # None was written before.
            left = sum(fill(CASE, ranks, expected, part, verdict) for part in (0.75, 0.85, 0.95))
            verdict.expect(left == 3, f"{ranks} ranks: {left} of 3 full disks left a checkpoint that was not due")
            refuse_read_only(ranks, expected, verdict)
        fill_for_a_while(ranks, verdict)
    verdict.exit()


if __name__ == "__main__":
    main()
