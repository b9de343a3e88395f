"""Times the scenes of examples/scaling. See scripts/scaling, which calls this."""

import argparse
import csv
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

FOLDER = Path("examples/scaling")
SCENES = ["jerk", "flexible", "wall", "contact", "zi", "lattice"]
OURS = "ours"
# Of several rounds: the median; what is counted is the same in all of them.
TIMES = ["seconds_per_step", "seconds_least", "seconds_most", "matmult_seconds", "matmults_per_step", "seconds_setup", "seconds_warmup"]
COUNTS = ["steps", "unknowns", "constraints", "form", "linear_solves", "factorizations", "snes_iterations", "predictor_hits",
          "contact_changes", "contact_changes_least", "closed_contacts", "max_residual", "peak_rss_bytes", "bytes_per_unknown"]  # fmt: skip


@dataclass
class Case:
    """A scene of a size on some ranks with a setting, and what came of it."""

    scene: str
    n: int
    ranks: int
    setting: str
    options: str
    status: str = ""
    rounds: list = field(default_factory=list)

    def words(self):
        words = ["--set", f"model.count={self.n}"]
        if self.scene == "lattice":
            side = math.isqrt(self.n)
            words += ["--set", f"model.shape=[{side},{side}]"]
        return words + self.options.split()

    def __getitem__(self, key):
        found = [one[key] for one in self.rounds if one.get(key) is not None]
        if not found:
            return None
        return statistics.median(found) if key in TIMES else found[0]

    def per_step(self, key):
        return None if self[key] is None else self[key] / self["steps"]


def sizes(text):
    return [round(float(word)) for word in text.split(",")]


def arguments():
    parser = argparse.ArgumentParser(prog="scripts/scaling", description="Times the steps of the scenes of examples/scaling.")
    parser.add_argument("scenes", nargs="?", default=",".join(SCENES), help="names with commas between (default: all)")
    parser.add_argument("sizes", nargs="?", default="1e2,1e3,1e4,1e5,1e6", help="numbers of elements (default: %(default)s)")
    parser.add_argument("--ranks", default="1,2", help="default: %(default)s")
    parser.add_argument("--settings", default="", metavar="NAME,...", help="of examples/scaling/settings.toml, by a part of the name (default: all)")
    parser.add_argument("--no-weak", action="store_true", help="leave out p ranks with p times as many elements (ours only)")
    parser.add_argument("--warmup", type=int, default=5, help="steps before those that are timed (default: %(default)s)")
    parser.add_argument("--count", type=int, default=20, help="steps to time, ten times as many below 1e4 elements (default: %(default)s)")
    parser.add_argument("--rounds", type=int, default=3, help="of all settings in turn (default: %(default)s)")
    parser.add_argument("--limit", type=float, default=60.0, metavar="SECONDS", help="for a setting in a round; what will not fit is not tried (default: %(default)s)")
    parser.add_argument("--csv", default="out/scaling.csv", help="default: %(default)s; pictures go into its folder")
    given = parser.parse_args()
    given.scenes, given.sizes = given.scenes.split(","), sizes(given.sizes)
    given.ranks = [int(word) for word in given.ranks.split(",")]
    for scene in given.scenes:
        if scene not in SCENES:
            parser.error(f"there is no scene '{scene}'; known: {', '.join(SCENES)}")
    chosen = [word for word in given.settings.split(",") if word]
    with open(FOLDER / "settings.toml", "rb") as file:
        known = [(one["name"], one["options"]) for one in tomllib.load(file)["setting"]]
    given.settings = [one for one in known if not chosen or any(word in one[0] for word in chosen)]
    if not given.settings:
        parser.error(f"no setting has one of '{','.join(chosen)}' in its name; known: {', '.join(name for name, _ in known)}")
    return given


def bench(case, given):
    """One round of a case: the summary of `sweepvi bench`, or what there is of it."""
    count = given.count * (10 if case.n < 10_000 else 1)
    with tempfile.TemporaryDirectory() as folder:
        summary = Path(folder) / "b.json"
        words = [os.environ["SWEEPVI"], "bench", str(FOLDER / f"{case.scene}.toml"), "--warmup", str(given.warmup), "--count", str(count),
                 "--wall-limit", str(given.limit), "--summary", str(summary), *case.words()]  # fmt: skip
        if case.ranks > 1:
            words = ["mpiexec", "--oversubscribe", "-n", str(case.ranks), *words]
        process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
        try:
            _, complaint = process.communicate(timeout=2 * given.limit + 10)
        except subprocess.TimeoutExpired:
            process.terminate()  # mpiexec ends its ranks
            process.communicate()
            return {"status": "too slow"}
        if not summary.exists():
            lines = [line for line in complaint.splitlines() if line.startswith("sweepvi: ")] or [f"exit {process.returncode}"]
            return {"status": f"failed: {lines[0].removeprefix('sweepvi: ')}"}
        found = json.loads(summary.read_text())
    if found["status"] == "stopped":
        found["status"] = "done" if found["steps"] > 0 else "too slow"
    elif found["status"] == "failed":
        found["status"] = f"failed: {found['failure']}"
    return found


def run_size(cases, given, costs):
    """All rounds of the cases of one scene and size. `costs` remembers who was too slow at a smaller one."""
    for turn in range(given.rounds):
        for case in cases:
            key = (case.scene, case.ranks, case.setting)
            size, cost = costs.get(key, (case.n, 0.0))
            if turn == 0 and cost * case.n / size > 4 * given.limit:  # to be tried it need not fit, but get somewhere
                case.status = "too slow"
            if case.status not in ("", "done"):
                continue
            begin = time.monotonic()
            found = bench(case, given)
            case.status = found["status"]
            spent = time.monotonic() - begin
            if turn == 0:
                costs[key] = (case.n, math.inf if case.status == "too slow" else spent)
            if case.status == "done":
                case.rounds.append(found)
            print(f"  {case.scene} {case.n}, {case.ranks} rank(s), {case.setting}: {case.status}, {spent:.1f} s", file=sys.stderr, flush=True)


def write_csv(path, cases):
    with open(path, "w", newline="") as file:
        table = csv.writer(file)
        table.writerow(["scene", "N", "ranks", "setting", "options", "status", "rounds", *TIMES, *COUNTS])
        for case in cases:
            head = [case.scene, case.n, case.ranks, case.setting, case.options, case.status, len(case.rounds)]
            table.writerow(head + [case[key] for key in TIMES + COUNTS])


def size_text(n):
    exponent = int(math.log10(n))
    return f"1e{exponent}" if n == 10**exponent else f"{n:g}" if n < 1e6 else f"{n:.3g}"


def number(value, form="{:.3g}"):
    return "-" if value is None else form.format(value)


def table(head, rows):
    print("| " + " | ".join(head) + " |")
    print("|" + "---|" * len(head))
    for row in rows:
        print("| " + " | ".join(row) + " |")
    print()


def exponent(points):
    """Slope of the line through log(seconds) over log(N), least squares."""
    xs, ys = [math.log(n) for n, _ in points], [math.log(seconds) for _, seconds in points]
    mean_x, mean_y = statistics.fmean(xs), statistics.fmean(ys)
    return sum((x - mean_x) * (y - mean_y) for x, y in zip(xs, ys)) / sum((x - mean_x) ** 2 for x in xs)


def cell(case):
    if case is None:
        return ""
    if case["seconds_per_step"] is None:
        return case.status.split(":")[0] or "-"
    return f"{1e3 * case['seconds_per_step']:.3g} ({number(case['matmults_per_step'])})"


def print_scene(scene, cases, given):
    here = {(case.n, case.ranks, case.setting): case for case in cases if case.scene == scene}
    names = [name for name, _ in given.settings]
    print(f"**{scene}**: milliseconds per step (MatMults per step)\n")
    keys = sorted({(n, ranks) for n, ranks, _ in here}, key=lambda key: (key[1], key[0]))
    rows = [[size_text(n), str(ranks), *(cell(here.get((n, ranks, name))) for name in names)] for n, ranks in keys]
    table(["N", "ranks", *names], [row for row in rows if any(row[2:])])
    for case in here.values():
        if case.status.startswith("failed"):
            print(f"{case.setting}, N = {size_text(case.n)}, {case.ranks} rank(s) {case.status}\n")
    if OURS not in names:
        return
    print(f"{scene}, {OURS}: counts per step, memory\n")
    rows = []
    for n, ranks in keys:
        case = here.get((n, ranks, OURS))
        if case is None or case["seconds_per_step"] is None:
            continue
        spread = f"{1e3 * case['seconds_least']:.3g} to {1e3 * case['seconds_most']:.3g}"
        changes = f"{number(case['contact_changes'])} ({case['contact_changes_least']})"
        rows.append([size_text(n), str(ranks), spread, number(case["matmult_seconds"], "{:.2e}"), changes, number(case["closed_contacts"], "{:.0f}"),
                     *(number(case.per_step(key)) for key in ("linear_solves", "factorizations", "snes_iterations", "predictor_hits")),
                     number(case["max_residual"], "{:.1e}"), number(case["bytes_per_unknown"], "{:.0f}"), number(case["seconds_setup"])])  # fmt: skip
    table(["N", "ranks", "ms, least to most", "s per MatMult", "contacts changed (least)", "closed", "solves", "factorizations", "Newton", "hits",
           "certificate", "B/unknown", "set-up, s"], rows)  # fmt: skip

    def seconds(n, ranks):
        case = here.get((n, ranks, OURS))
        return None if case is None else case["seconds_per_step"]

    points = [(n, seconds(n, 1)) for n in given.sizes if n >= 1000 and seconds(n, 1)]
    if len(points) > 1:
        print(f"{scene}, {OURS}: seconds per step grow like N^{exponent(points):.2f} from {size_text(points[0][0])} to {size_text(points[-1][0])}, one rank\n")
    rows = []
    for ranks in [ranks for ranks in given.ranks if ranks > 1]:
        for n in given.sizes:
            one, several, weak = seconds(n, 1), seconds(n, ranks), seconds(ranks * n, ranks)
            if one and (several or weak):
                rows.append([size_text(n), str(ranks), number(several and one / several, "{:.2f}"), number(weak and one / weak, "{:.2f}")])
    if rows:
        print(f"{scene}, {OURS}: times as fast on more ranks (strong); share of the speed kept with N elements on each (weak)\n")
        table(["N", "ranks", "strong", "weak"], rows)


def draw(path, scene, cases, given):
    import drawing
    from drawing import plt

    with plt.rc_context(drawing.STYLE):
        figure, axes = plt.subplots(figsize=(5.2, 3.6))
        for colour, (name, _) in zip(drawing.COLOURS, given.settings):
            for ranks, line in zip(given.ranks, ["o-", "s--", "^:"]):
                points = sorted((case.n, case["seconds_per_step"]) for case in cases
                                if (case.scene, case.ranks, case.setting) == (scene, ranks, name) and case["seconds_per_step"])  # fmt: skip
                if points:
                    label = name if ranks == given.ranks[0] else f"{name}, {ranks} ranks"
                    axes.loglog(*zip(*points), line, color=colour, markersize=3, label=label)
        points = sorted((case.n, case["matmult_seconds"]) for case in cases
                        if (case.scene, case.ranks, case.setting) == (scene, 1, given.settings[0][0]) and case["matmult_seconds"])  # fmt: skip
        if points:
            axes.loglog(*zip(*points), ":", color=drawing.MUTED, label="one MatMult")
        axes.set(title=f"{scene}: a step", xlabel="elements", ylabel="seconds")
        if axes.lines:
            axes.legend()
        figure.tight_layout()
        figure.savefig(path, dpi=160)
        plt.close(figure)


def main():
    given = arguments()
    info = subprocess.run([os.environ["SWEEPVI"], "info"], capture_output=True, text=True, check=True).stdout
    print("```\n" + info + "```\n")
    cases, costs = [], {}
    Path(given.csv).parent.mkdir(parents=True, exist_ok=True)
    for scene in given.scenes:
        wanted = {}
        for n in given.sizes:
            n = math.isqrt(n) ** 2 if scene == "lattice" else n
            for ranks in given.ranks:
                wanted.setdefault(n, []).extend((ranks, *setting) for setting in given.settings)
                if ranks > 1 and not given.no_weak and scene != "lattice":
                    wanted.setdefault(ranks * n, []).extend((ranks, *setting) for setting in given.settings if setting[0] == OURS)
        for n in sorted(wanted):
            here = [Case(scene, n, *rest) for rest in dict.fromkeys(wanted[n])]
            run_size(here, given, costs)
            cases += here
            write_csv(given.csv, cases)
        print_scene(scene, cases, given)
        draw(Path(given.csv).parent / f"scaling_{scene}.png", scene, cases, given)
        sys.stdout.flush()
    print(f"{given.csv} has all of it; pictures are beside it")


if __name__ == "__main__":
    main()
