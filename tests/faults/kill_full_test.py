# A hundred kill -9's: of one rank, of all, of mpiexec; at any time, at a checkpoint, at the start, of runs that were
# killed before. Every run is taken up until it is done, and must then hold the bits of a run that nobody killed.
#
# ranks: 2
# labels: long
# timeout: 3600
import os
import random
import sys

import faults
import program

KILLS = int(os.environ.get("SWEEPVI_KILLS", "100"))
WHOM = "one rank", "all", "mpiexec"
WHEN = "any time", "any time", "at a checkpoint", "at a checkpoint", "at the start"


def kill_all(folder, seed, verdict):
    draw = random.Random(seed)
    tally = faults.Tally()
    expected = {}
    while tally.kills < KILLS:
        case, ranks = draw.choice(faults.CASES), draw.choice((1, 2, 3))
        if (case.name, ranks) not in expected:
            own = folder / f"{case.name} {ranks}"
            own.mkdir()
            expected[case.name, ranks] = faults.undisturbed(case, ranks, own)
        file, seconds = expected[case.name, ranks]
        kills = [faults.Kill(draw.choice(WHOM), draw.choice(WHEN)) for _ in range(draw.randint(1, 4))]
        interval, read = draw.choice((0.01, 0.01, 0.2)), draw.random() < 0.3
        name = f"seed {seed}, run {tally.runs + 1}: {case.name}, {ranks} ranks, checkpoints every {interval} s"
        before = tally.kills
        try:
            faults.kill_until_done(case.often(interval), ranks, file, seconds, kills, seed + tally.runs, tally, read)
            verdict.expect(True, f"{name}{', with a reader' if read else ''}: {tally.kills - before} kills")
        except AssertionError as error:
            verdict.expect(False, f"{name}: {kills}\n{error}")
    return tally


def main():
    verdict = program.Verdict()
    seed = int(os.environ.get("SWEEPVI_SEED", "1"))
    with program.temporary_folder() as folder:
        tally = kill_all(faults.Path(folder), seed, verdict)
    if not verdict.failed:
        print(f"\n{tally.kills} kills in {tally.runs} runs, all of which ended with the same bits:")
    for kind, count in sorted(tally.by.items()):
        print(f"  {count:4}  {kind}")
    print(f"  taken up {tally.resumed} times from a checkpoint, {tally.afresh} times from the start")
    verdict.exit()


if __name__ == "__main__":
    main()
