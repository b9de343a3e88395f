"""The wall chain with Siconos and with sweepvi: the same trajectory, seconds per step. See scripts/scaling, which calls this."""

import argparse
import csv
import json
import os
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

import h5py
import numpy as np

SCENE = "examples/scaling/siconos/wall_chain.toml"
TOLERANCE = {"dense": 1e-8, "single": 1e-5}  # the same scheme; another one, h^2 apart (3e-7 to 7e-6 at h = 1e-3 and 5e-3)


def arguments():
    parser = argparse.ArgumentParser(prog="scripts/scaling siconos", description="The wall chain next to Siconos.")
    parser.add_argument("program", help=argparse.SUPPRESS)
    parser.add_argument("sizes", nargs="?", default="10,30,100,300,1000,3000", help="numbers of masses (default: %(default)s)")
    parser.add_argument("--dense-up-to", type=int, default=300, metavar="N", help="for one dense system (default: %(default)s; 1000 takes 150 s a step)")
    parser.add_argument("--steps", type=int, default=800, help="of --step seconds from rest, contacts from 0.45 s on (default: %(default)s)")
    parser.add_argument("--step", type=float, default=1e-3, help="default: %(default)s")
    parser.add_argument("--rounds", type=int, default=1, help="default: %(default)s")
    parser.add_argument("--csv", default="out/scaling_siconos.csv", help="default: %(default)s")
    given = parser.parse_args()
    given.sizes = [round(float(word)) for word in given.sizes.split(",")]
    return given


def sweepvi(verb, n, given, *words):
    end = given.steps * given.step
    command = [os.environ["SWEEPVI"], verb, SCENE, "--set", f"model.count={n}", "--set", f"time.step={given.step}", "--set", f"time.end={end}"]
    subprocess.run([*command, *words], check=True, stdout=subprocess.DEVNULL)


def siconos(form, n, given, folder):
    """Seconds of each step, and all states."""
    path = Path(folder) / "trajectory"
    printed = subprocess.run([given.program, form, str(n), str(given.steps), str(given.step), str(path)], check=True, capture_output=True, text=True).stdout
    return [float(line) for line in printed.splitlines()], np.fromfile(path).reshape(given.steps + 1, 2 * n)


def measure(n, given):
    """A row: seconds per step, mean and median of each, and how far the trajectories are apart."""
    row = {"N": n}
    forms = [form for form in TOLERANCE if form != "dense" or n <= given.dense_up_to]
    with tempfile.TemporaryDirectory() as folder:
        sweepvi("run", n, given, "-o", f"{folder}/x.h5")
        with h5py.File(f"{folder}/x.h5") as file:
            ours = file["/x"][:]
        seconds = {name: [] for name in ["sweepvi", *forms]}
        for _ in range(given.rounds):
            sweepvi("bench", n, given, "--warmup", "0", "--count", str(given.steps), "--summary", f"{folder}/b.json")
            found = json.loads(Path(f"{folder}/b.json").read_text())
            seconds["sweepvi"].append((found["seconds_stepping"] / found["steps"], found["seconds_per_step"]))
            row["contacts_changed"] = found["contact_changes"]
            for form in forms:
                times, theirs = siconos(form, n, given, folder)
                seconds[form].append((statistics.fmean(times), statistics.median(times)))
                row[f"{form}_differs"] = float(abs(theirs - ours).max())
    for name, found in seconds.items():
        row[f"{name}_mean"], row[f"{name}_median"] = (statistics.median(one[i] for one in found) for i in (0, 1))
    return row


def number(row, key, form="{:.2e}"):
    return form.format(row[key]) if key in row else "-"


def main():
    given = arguments()
    print(f"Wall chain, theta = 1/2, detection at the midpoint, {given.steps} steps of {given.step:g} s: seconds per step, mean (median)\n")
    print("| N | sweepvi | Siconos, one dense system | Siconos, N systems | faster of the two / sweepvi | dense differs by | N systems by | contacts changed |")
    print("|---|---|---|---|---|---|---|---|")
    rows, wrong = [], []
    for n in given.sizes:
        row = measure(n, given)
        rows.append(row)
        best = min(row[f"{form}_mean"] for form in TOLERANCE if f"{form}_mean" in row)
        times = [f"{number(row, name + '_mean')} ({number(row, name + '_median')})" if f"{name}_mean" in row else "-" for name in ("sweepvi", "dense", "single")]
        print(f"| {n} | " + " | ".join(times) + f" | {best / row['sweepvi_mean']:.3g} | {number(row, 'dense_differs', '{:.1e}')} |"
              f" {number(row, 'single_differs', '{:.1e}')} | {row['contacts_changed']:.3g} |", flush=True)  # fmt: skip
        wrong += [f"N = {n}, {form}: trajectories differ by {row[form + '_differs']:.1e}, more than {most:g}"
                  for form, most in TOLERANCE.items() if row.get(f"{form}_differs", 0) > most]  # fmt: skip
    Path(given.csv).parent.mkdir(parents=True, exist_ok=True)
    with open(given.csv, "w", newline="") as file:
        keys = list(dict.fromkeys(key for row in rows for key in row))
        table = csv.DictWriter(file, keys)
        table.writeheader()
        table.writerows(rows)
    print(f"\n{given.csv} has all of it")
    if wrong:
        sys.exit("\n".join(wrong))


if __name__ == "__main__":
    main()
