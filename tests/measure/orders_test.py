# ranks: 1
# timeout: 240
"""Every scheme has its order, from both sides, in smooth phases and across events, against exact solutions."""

import itertools
import sys
import unittest
from pathlib import Path

import numpy as np

sys.path[:0] = [str(Path(__file__).resolve().parent), str(Path(__file__).resolve().parents[1] / "app")]
import program
from orders_cases import CASES, SMOOTH, TOLERANCES, TOLERATED
from orders_exact import follow, of_model
from orders_models import scene_text

# For matrices of a few rows; in natural order, where multipliers come last, no pivot is 0. Those of the Euler schemes in
# contact are too close to singular for it.
PETSC_LU = ["-pc_factor_mat_solver_type", "petsc", "-pc_factor_mat_ordering_type", "natural"]
# The tolerance bounds the errors of the run's intervals, each relative to the state; later ones let them grow, AB (65) by
# 1.87 a cycle, and an event that comes late by dt is worth the jump of a velocity or a force times dt.
GROWTH = 10.0
ROUNDING = 1e-10  # of some hundred steps; smaller errors have no order
# Where hybrid takes a scene, it ends where the exact solution does: both are good to 1e-12 of a state of order 1.
EXACT = 1e-11


def at_the_end(end, state):
    """A trajectory of which nothing but the end is looked at."""
    return [[0.0] * (len(state) + 1), [end, *state]]


def takes_hybrid(case):
    return not case.exact and not np.any(case.model.get("D", 0))


class Orders(unittest.TestCase):
    def setUp(self):
        folder = program.temporary_folder()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def study(self, name, model, end, time, words, exact):
        """The rows of `sweepvi study` against the rows t, x of `exact`."""
        scene, summary, table = (self.folder / f"{name}.{kind}" for kind in ("toml", "json", "csv"))
        scene.write_text(scene_text({"end": end, "step": end / 10, **time}, model))
        lines = [",".join(["t"] + ["x"] * (len(exact[0]) - 1)), *(",".join(repr(float(x)) for x in row) for row in exact)]
        table.write_text("\n".join(lines) + "\n")
        words = ["--repeats", 1, "--summary", summary, "--reference", table, *words]
        outcome = program.run("study", scene, *words, cwd=self.folder, timeout=60)
        self.assertEqual(outcome.code, 0, outcome)
        return program.read_json(summary)["runs"]

    def exact(self, case):
        if case.exact:
            return at_the_end(case.end, case.exact)
        rows, events = follow(of_model(case.model), case.end)
        self.assertEqual(events > 0, case.steps is not SMOOTH, "events?")
        return rows

    def orders(self, number, case):
        """The slope of log(error) over log(h) for each scheme and norm, through the means of the groups of steps."""
        counts = [count for group in case.steps for count in group]
        words = ["--steps", ",".join(repr(case.end / count) for count in counts)]
        if "zd-euler" not in case.schemes:
            words += PETSC_LU
        schemes = [*case.schemes, "hybrid"] if takes_hybrid(case) else case.schemes
        words += ["--schemes", ",".join(schemes)] + (["--tolerances", "1e-12"] if "hybrid" in schemes else [])
        if case.components:
            words += ["--components", ",".join(map(str, case.components))]
        rows = self.study(f"case{number}", case.model, case.end, {"scheme": case.schemes[0], **case.time}, words, self.exact(case))
        for row in (row for row in rows if row["scheme"] == "hybrid"):
            self.assertLess(row["final"], EXACT)
        for scheme, norm in itertools.product(case.schemes, case.norms):
            own = [row for row in rows if row["scheme"] == scheme]
            self.assertEqual([row["steps"] for row in own], counts)
            groups = np.array([(row["h"], row[norm]) for row in own]).reshape(len(case.steps), -1, 2).mean(axis=1)
            self.assertGreater(groups[:, 1].min(), ROUNDING, "there is no error to measure an order of")
            yield scheme, norm, groups[0, 1], groups[-1, 1], np.polyfit(*np.log(groups).T, 1)[0]

    def test_orders(self):
        for number, case in enumerate(CASES):
            with self.subTest(case.name):
                for scheme, norm, coarse, fine, order in self.orders(number, case):
                    what = f"{case.name:52} {scheme:17} {norm:10} {coarse:8.1e} {fine:8.1e}"
                    line = f"{what} {order:7.3f}   {case.band.low} ... {case.band.high}"
                    print(line, flush=True)
                    self.assertTrue(case.band.low <= order <= case.band.high, f"{line}\n{case.band.why}")

    def test_hybrid_follows_its_tolerance(self):
        words = ["--schemes", "hybrid", "--tolerances", ",".join(map(repr, TOLERANCES))]
        for number, case in enumerate(TOLERATED):
            with self.subTest(case.name):
                time = {"scheme": "hybrid", "step": case.end}
                rows = self.study(f"hybrid{number}", case.model, case.end, time, words, at_the_end(case.end, case.exact))
                errors = [row["final"] for row in rows]
                work = [self.coefficients(f"hybrid{number}", tolerance) for tolerance in (TOLERANCES[0], TOLERANCES[-1])]
                print(f"{case.name:52} hybrid " + " ".join(f"{error:8.1e}" for error in errors) + f"   {work} coefficients", flush=True)
                self.assertEqual([row["tolerance"] for row in rows], list(TOLERANCES))
                size = np.linalg.norm(case.exact)
                for tolerance, error in zip(TOLERANCES, errors):
                    self.assertLessEqual(error, GROWTH * tolerance * max(size, 1.0))
                # It is the tolerance that decides. Numbers of terms are whole, each worth a digit: half of the eight digits are
                # asked for, down to rounding (a bound that moves faster than the point asks for more terms than the point).
                self.assertLess(errors[-1], max(1e-4 * errors[0], 1e-14 * size))
                self.assertLess(work[0], work[1])

    def coefficients(self, name, tolerance):
        """Taylor coefficients of a whole run."""
        summary = self.folder / "work.json"
        words = ["--set", f"time.tolerance={tolerance!r}", "-o", self.folder / "work.h5", "--force", "--summary", summary]
        outcome = program.run("run", self.folder / f"{name}.toml", *words, cwd=self.folder, timeout=60)
        self.assertEqual(outcome.code, 0, outcome)
        return program.read_json(summary)["hybrid"]["coefficients"]


if __name__ == "__main__":
    unittest.main()
