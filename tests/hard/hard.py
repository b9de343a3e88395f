"""Runs hard cases and prints what came of them: `hard.py` the quick ones, `hard.py --full` all of them, on all rank
counts and with all solvers, and 200 random systems. With words after it, only the cases whose group or name contains one of
them. `hard.py --seed SEED`: only 200 random systems from this seed.
"""

import argparse
import math
import sys
import time
from collections import Counter
from concurrent.futures import ThreadPoolExecutor

import random_runs
import suite
from cases import CASES

program = suite.program


def plan(full, words):
    """(case, ranks, solver) of every run."""
    for case in CASES:
        if words and not any(word in f"{case.group} {case.name}" for word in words):
            continue
        if full or words:
            yield from ((case, ranks, solver) for ranks in case.ranks for solver in case.solvers)
        elif case.quick:
            yield case, case.ranks[0], case.solvers[0]


def attempt(job):
    """(verdicts, certificate, penetration) of one run; says at once what is wrong."""
    case, ranks, solver = job
    with program.temporary_folder() as folder:
        try:
            run = suite.Run(case, ranks, solver, folder)
            verdicts, summary = run.verdicts(), run.summary
        except Exception as error:  # a run that hangs, or a judge that cannot judge, is a wrong end too
            verdicts, summary = [(f"{type(error).__name__}: {error}"[-600:], math.inf, 0)], {}
    for what, value, limit in wrong(verdicts):
        text = f"{what} = {value:.3g}, more than {limit:.3g}" if math.isfinite(value) else what
        print(f"FAILED {case.group}: {case.name}, {ranks} ranks, {solver}: {text}", file=sys.stderr, flush=True)
    return verdicts, summary.get("max_residual"), summary.get("max_penetration")


def wrong(verdicts):
    return [(what, value, limit) for what, value, limit in verdicts if not value <= limit]


def number(value):
    return "" if value is None else "0" if value == 0 else f"{value:.1e}"


def measured(results):
    """The worst of each number that judges have taken, certificates aside: 'x 1e-15, mu 2e-14'."""
    worst = {}
    for verdicts, *_ in results:
        for what, value, _ in verdicts:
            if what != "certificate" and math.isfinite(value):
                worst[what] = max(worst.get(what, 0.0), value)
    return ", ".join(f"{what} {number(value)}" for what, value in worst.items())


def row(cases, title, jobs, results):
    """A line of the table: the worst numbers of all runs."""
    solved = [result for (case, *_), result in zip(jobs, results) if case.code == 0]
    certificate, penetration = (number(max((r[k] for r in solved if r[k] is not None), default=None)) for k in (1, 2))
    named = Counter(case.code for case in cases if case.code)
    ends = [f"exit {code}" + (f": {n}" if len(cases) > 1 else "") for code, n in sorted(named.items())]
    ranks = "/".join(map(str, sorted({ranks for _, ranks, _ in jobs})))
    solvers = len({solver for *_, solver in jobs})
    return f"| {title} | {ranks} x {solvers} | {certificate} | {penetration} | {', '.join([*filter(None, [measured(solved)]), *ends])} |"


def main(full, words=(), out=sys.stdout):
    """Runs them; returns how many runs ended otherwise than they should."""
    begin = time.monotonic()
    jobs = list(plan(full, words))
    rank_counts = sorted({ranks for _, ranks, _ in jobs})
    results = {}
    for ranks in rank_counts:  # as many runs at a time as there are processors for
        group = [job for job in jobs if job[1] == ranks]
        with ThreadPoolExecutor(max(1, program.PROCESSORS // ranks)) as pool:
            for job, result in zip(group, pool.map(attempt, group)):
                results[job[0].group, job[0].name, job[1], job[2]] = result
    print("| group | case | right is | ranks x solvers | certificate | penetration | measured |", file=out)
    print("|---|---|---|---|---|---|---|", file=out)
    result_of = lambda job: results[job[0].group, job[0].name, job[1], job[2]]
    for case in CASES:
        mine = [job for job in jobs if job[0] is case]
        if mine:
            print(row([case], f"{case.group} | {case.name} | {case.right}", mine, list(map(result_of, mine))), file=out)
    print("\n| group | cases | ranks x solvers | certificate | penetration | worst of what was measured |", file=out)
    print("|---|---|---|---|---|---|", file=out)
    for group in dict.fromkeys(job[0].group for job in jobs):
        mine = [job for job in jobs if job[0].group == group]
        cases = list({id(job[0]): job[0] for job in mine}.values())
        print(row(cases, f"{group} | {len(cases)}", mine, list(map(result_of, mine))), file=out)
    bad = sum(1 for job in jobs if wrong(result_of(job)[0]))
    print(f"\n{len(jobs)} runs of {len({id(job[0]) for job in jobs})} cases, {bad} wrong, {time.monotonic() - begin:.0f} s", file=out)
    return bad


def random_systems(seed, count=200, out=sys.stdout):
    """Of each kind, hybrid for each tolerance and with rows of 1e-3 to 1 s; returns how many ended otherwise than they should."""
    bad = random_runs.main("steps", seed, count, out=out)
    for tolerance, step in ((1e-4, 1.0), (1e-8, 0.125), (1e-12, 1e-3)):
        for bouncing in (False, True):
            bad += random_runs.main("impacts" if bouncing else "events", seed, count, out=out, tolerance=tolerance, step=step, bouncing=bouncing)
    return bad


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--full", action="store_true", help="all cases, rank counts and solvers")
    parser.add_argument("words", nargs="*", help="only cases with one of these in their group or name")
    parser.add_argument("--seed", help="random systems only, from this seed")
    given = parser.parse_args()
    bad = 0 if given.seed else main(given.full, given.words)
    if given.seed or given.full and not given.words:
        bad += random_systems(given.seed or "full")
    sys.exit(1 if bad else 0)
