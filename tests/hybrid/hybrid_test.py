# ranks: 1
# timeout: 200
"""The scheme hybrid against event-driven solutions with 50 digits, closed forms and the schemes it falls back to."""

import json
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import going_on
import program

REFERENCE = program.SOURCE / "tests" / "reference"
EXAMPLES = program.SOURCE / "examples"
IMPACT, LIFT_OFF = 0, 1

PAPER65_IMPACT, PAPER65_LIFT_OFF = 4.345147830371428265, 6.199615848871525286
PAPER65_END = [2.038074313834594676, 0.453192855214661465, -1.056047929937494749, 2.615870338795054074, 0.624221522682221825]


class Hybrid(unittest.TestCase):
    def setUp(self):
        self.folder = program.temporary_folder()
        self.addCleanup(self.folder.cleanup)
        self.path = Path(self.folder.name)

    def run_scene(self, scene, *words, tolerance=1e-12, name="out", ranks=1, **settings):
        keys = {"time.scheme": "hybrid", "time.tolerance": tolerance, "output.every": 1}
        keys.update({key.replace("__", "."): value for key, value in settings.items()})
        sets = [f"--set={key}={value}" for key, value in keys.items() if value is not None]
        out = self.path / f"{name}.h5"
        outcome = program.run(
            "run", scene, "-o", out, "--force", "--summary", self.path / "s.json", *sets, *words, ranks=ranks, cwd=self.path,
            timeout=60,
        )  # fmt: skip
        self.assertEqual(outcome.code, 0, outcome)
        self.summary = json.loads((self.path / "s.json").read_text())
        return h5py.File(out)

    def events(self, file):
        """(t, constraint, kind) of first contacts and lift-offs, those of one instant in the file's order."""
        table = file["events"][:]
        return [(e["t"], int(e["constraint"]), int(e["kind"])) for e in table if e["kind"] == LIFT_OFF or e["level"] == 1]

    def check_events(self, file, expected, tolerance=1e-10):
        """Impacts and lift-offs of the reference; a bounce is both at once."""
        found = self.events(file)
        times = np.array([t for t, _, kind in found if kind == IMPACT])
        sites = [a for _, a, kind in found if kind == IMPACT]
        impacts = [e for e in expected if e["kind"] == "impact"]
        self.assertEqual(sites[: len(impacts)], [e["site"] for e in impacts])
        np.testing.assert_allclose(times[: len(impacts)], [float(e["t"]) for e in impacts], rtol=0, atol=tolerance)
        for event in expected:
            if event["kind"] == "impact":
                continue
            error = min(abs(t - float(event["t"])) for t, a, kind in found if a == event["site"] and kind == LIFT_OFF)
            self.assertLessEqual(error, tolerance)

    # Acceptance: 1e-10 at a tolerance of 1e-12 --------------------------------------------------------

    def test_paper65(self):
        with self.run_scene(EXAMPLES / "paper65" / "scene.toml", time__step=0.05) as file:
            self.assertLessEqual(np.linalg.norm(file["x"][-1] - PAPER65_END), 1e-10)
            expected = [
                {"t": PAPER65_IMPACT, "site": 0, "kind": "impact"},
                {"t": PAPER65_LIFT_OFF, "site": 0, "kind": "liftoff"},
            ]
            self.check_events(file, expected)
            # Two rows at each event: the graph is filled in.
            t = file["t"][:]
            self.assertEqual(np.count_nonzero(np.diff(t) == 0.0), 2)
            self.assertEqual(file["w"][:].min(), 0.0)
        self.assertEqual(self.summary["hybrid"]["steps"], 0)
        self.assertEqual(self.summary["hybrid"]["events"], 2)
        self.assertEqual(self.summary["hybrid"]["resets"], 1)
        # A series of at most 40 terms for each interval and event, one product with A each.
        self.assertLessEqual(self.summary["hybrid"]["expansions"], 202)
        self.assertLessEqual(self.summary["hybrid"]["coefficients"], 15 * 202)

    def test_jerk_chains(self):
        for count in (2, 3):
            with self.subTest(count), self.run_scene(EXAMPLES / "jerk_chain" / "scene.toml", model__count=count) as file:
                reference = json.loads((REFERENCE / f"jerk_chain_N{count}_events.json").read_text())
                self.check_events(file, reference["events"])
                exact = np.loadtxt(REFERENCE / f"jerk_chain_N{count}.csv", delimiter=",", skiprows=1)
                self.assertLessEqual(np.linalg.norm(file["x"][-1] - exact[-1, 1:]), 1e-10)

    def test_flexible_chains(self):
        # N = 2 has impacts that shrink super-linearly, down to flights that the clock cannot tell.
        for count in (1, 2):
            scene = EXAMPLES / "flexible_chain" / "single.toml"
            with self.subTest(count), self.run_scene(scene, model__count=count, time__step=0.01, time__end=5) as file:
                reference = json.loads((REFERENCE / f"flexible_N{count}_events.json").read_text())
                # The last two of N = 2 are one instant, closer to the one before than the clock tells well.
                self.check_events(file, reference["events"][:4])
                exact = np.loadtxt(REFERENCE / f"flexible_N{count}.csv", delimiter=",", skiprows=1)
                t, z = file["t"][:], file["z"][:]
                last = np.searchsorted(t, exact[:, 0] + 1e-12, side="right") - 1  # right limits, as the reference
                away = np.min(np.abs(exact[:, :1] - [[float(e["t"]) for e in reference["events"]]]), axis=1) > 1e-6
                np.testing.assert_allclose(z[last][away], exact[away, 1:], rtol=0, atol=1e-9)

    def test_error_follows_the_tolerance(self):
        errors = []
        for tolerance in (1e-2, 1e-4, 1e-6, 1e-8):
            with self.run_scene(EXAMPLES / "paper65" / "scene.toml", tolerance=tolerance, time__step=5.0) as file:
                errors.append(np.linalg.norm(file["x"][-1] - PAPER65_END))
            self.assertLessEqual(errors[-1], 10.0 * tolerance)  # growth 1.9 a cycle, |x| up to 3
        self.assertLess(errors[-1], 1e-4 * errors[0] + 1e-9)

    def test_events_of_what_rests(self):
        """A state that rests is exact whatever is left out of its series; what ends its rest is not. x'' = f + lambda with
        f = 3 sin(pi t/2) - 2 in contact, let go at f = 0; a point met by its bound 2 sin(pi t/2) - 1/2."""
        wave = "amplitude = 3, frequency = 0.25, phase = 0"
        held = f"A = [[0, 1], [0, 0]]\nB = [[0], [1]]\nC = [[1, 0]]\nx0 = [0, 0]\nf = [0, {{offset = -2, {wave}}}]\n"
        met = "u0 = [0]\nlower = [{offset = -0.5, amplitude = 2, frequency = 0.25, phase = 0}]\n"
        for kind, keys, event in (("linear", held, np.arcsin(2 / 3)), ("sweeping", met, np.arcsin(1 / 4))):
            scene = self.path / f"{kind}.toml"
            scene.write_text(f'[time]\nend = 0.9\nstep = 0.9\nscheme = "hybrid"\n[model]\nkind = "{kind}"\n{keys}')
            for step in (0.9, 0.3, 0.01):
                with self.subTest(kind, step=step), self.run_scene(scene, time__step=step) as file:
                    # Rounding of the series at the root, over the slope there, which is above 1.
                    np.testing.assert_allclose([t for t, _, _ in self.events(file)], [event / (np.pi / 2)], rtol=0, atol=1e-13)
                self.assertEqual(self.summary["hybrid"]["steps"], 0)

    # Accumulation -------------------------------------------------------------------------------------

    def bounces(self, height, velocity, gravity, e):
        """(time, height, velocity) at the start of each flight, and the time of rest."""
        flights = [(0.0, height, velocity)]
        fall = np.sqrt(velocity**2 + 2 * gravity * height)
        t, v = (velocity + fall) / gravity, e * fall
        while v > 1e-17:
            flights.append((t, 0.0, v))
            t, v = t + 2 * v / gravity, v * e
        return flights, t

    def check_ball_position(self, file, height, velocity, gravity, e):
        flights, rest = self.bounces(height, velocity, gravity, e)
        starts = np.array([flight[0] for flight in flights])
        t, q = file["t"][:], file["x"][:, 0]
        which = np.searchsorted(starts, t, side="right") - 1
        flight = np.array(flights)[which]
        since = t - flight[:, 0]
        exact = np.where(t < rest, flight[:, 1] + flight[:, 2] * since - 0.5 * gravity * since**2, 0.0)
        self.assertLessEqual(np.abs(q - exact).max(), 1e-8)  # asked for, over the whole run
        self.assertTrue(np.all(q >= -1e-8))
        return starts, rest

    def check_ball(self, file, height, velocity, gravity, e):
        starts, rest = self.check_ball_position(file, height, velocity, gravity, e)
        self.assertTrue(np.all(file["x"][:, 0] >= 0.0))
        after = file["x"][:][file["t"][:] > rest + 0.01]
        self.assertGreater(len(after), 100)
        self.assertEqual(np.abs(after).max(), 0.0)
        impacts = np.array([event["t"] for event in file["events"][:] if event["kind"] == IMPACT])[:10]
        np.testing.assert_allclose(impacts, starts[1:11], rtol=0, atol=1e-12)  # each is a root, to rounding
        self.assertGreater(self.summary["hybrid"]["steps"], 0)
        self.assertLess(self.summary["hybrid"]["seconds_stepped"], 0.02)

    def test_bouncing_ball(self):
        for tolerance in (1e-8, 1e-12):
            with self.subTest(tolerance), self.run_scene(EXAMPLES / "ball" / "scene.toml", tolerance=tolerance) as file:
                self.check_ball(file, 1.0, 0.0, 10.0, 0.8)
                energy = file["energy"][:]
                np.testing.assert_allclose(energy.sum(axis=1), energy[0].sum(), rtol=1e-12)

    def test_zhuravlev_ivanov_ball(self):
        with self.run_scene(EXAMPLES / "zi_ball" / "scene.toml", tolerance=1e-8) as file:
            self.check_ball(file, 1.0, 6.0, 9.81, (1 - 0.41) / (1 + 0.41))
            # s and v pass through the impacts: nothing jumps in them between the two rows of an event.
            t, z = file["t"][:], file["z"][:]
            twice = np.flatnonzero(np.diff(t) == 0.0)
            self.assertLessEqual(np.abs(z[twice + 1] - z[twice])[: 10].max(), 1e-12)

    # Other structures ---------------------------------------------------------------------------------

    def test_shared_inputs(self):
        """M is not diagonal; exactly z_b = 3/2 + cos t from pi/3 on, lambda_1 = 1/2."""
        with self.run_scene(EXAMPLES / "shared_input" / "scene.toml", time__step=0.01) as file:
            t, z = file["t"][:], file["z"][:]
            later = t > np.pi / 3 + 1e-9
            self.assertLessEqual(np.abs(z[later, 3] - 1.5 - np.cos(t[later])).max(), 1e-11)
            self.assertEqual(np.abs(z[later, :3]).max(), 0.0)
            mu = file["mu"][:, 0, 2][later][1:]
            np.testing.assert_allclose(mu, 0.5 * np.diff(t[later]), atol=1e-12)

    def test_two_walls(self):
        """Both walls of one constraint, and two opposite rows, are the same motion."""
        with self.run_scene(EXAMPLES / "two_walls" / "scene.toml", name="one") as one:
            with self.run_scene(EXAMPLES / "two_walls" / "rows.toml", name="rows") as rows:
                np.testing.assert_allclose(one["x"][:], rows["x"][:], rtol=0, atol=1e-12)
                self.assertGreater(len(one["events"]), 4)

    def test_the_other_schemes_converge_to_it(self):
        """First order at forcing that varies, and with coupled constraints: the factor between steps is that of the steps."""
        for scene, start in ((EXAMPLES / "forced_contact" / "scene.toml", 1e-2), (EXAMPLES / "shared_input" / "scene.toml", 1e-2)):
            with self.run_scene(scene, time__step=start, name="hybrid") as hybrid:
                t, x = hybrid["t"][:], hybrid["x"][:]
            errors = []
            for step in (start, start / 10):
                with self.run_scene(scene, tolerance=None, time__scheme=None, time__step=step, name="steps") as steps:
                    errors.append(np.abs(steps["x"][-1] - x[-1]).max())
            self.assertGreater(errors[0] / errors[1], 5.0, errors)
            self.assertLess(errors[0] / errors[1], 20.0, errors)

    def test_moving_sets(self):
        """Without a field A u or f of their own, points pushed by sets are where the catching-up algorithm has them, at its
        times, as long as no face turns the push into a slide in between: exactly for a play, and for the polygon."""
        for example in ("play_operator", "moving_polygon", "stop_operator"):
            scene = EXAMPLES / example / "scene.toml"
            with self.subTest(example), self.run_scene(scene, tolerance=1e-12, name="hybrid") as file:
                t, x = file["t"][:], file["x"][:]
                self.assertEqual(file["w"][:].min(), 0.0)
                self.assertEqual(self.summary["hybrid"]["steps"], 0)
                events = [(e["constraint"], e["kind"]) for e in file["events"][:]]
                with self.run_scene(scene, tolerance=None, time__scheme=None, name="steps") as steps:
                    stepped = steps["x"][:]
                    at_steps = x[np.searchsorted(t, steps["t"][:] + 1e-12, side="right") - 1]
                    sides = [(e["constraint"], e["kind"]) for e in steps["events"][:]]
                if example != "stop_operator":  # it has a velocity of its own, and the algorithm's error is h
                    np.testing.assert_allclose(at_steps, stepped, rtol=0, atol=1e-12)
                    self.assertEqual(sorted(set(events)), sorted(set(sides)))

    def test_a_column_that_lands(self):
        """Balls land one after the other on those below, exactly at sqrt(2 (0.1 + 0.05 i)), and stay."""
        count = 12
        scene = self.path / "column.toml"
        scene.write_text(
            f'[time]\nscheme = "hybrid"\nend = 2.0\nstep = 0.02\n[model]\nkind = "chain"\nelement = "contact"\ncount = {count}\n'
        )
        with self.run_scene(scene) as file:
            landing = np.sqrt(2.0 * (0.1 + 0.05 * np.arange(count)))
            impacts = [(e["t"], e["constraint"]) for e in file["events"][:] if e["kind"] == IMPACT]
            self.assertEqual([a for _, a in impacts], list(range(count)))
            np.testing.assert_allclose([t for t, _ in impacts], landing, rtol=0, atol=1e-11)
            np.testing.assert_allclose(file["x"][-1], [*range(count), *np.zeros(count)], rtol=0, atol=1e-11)

    def test_accumulation_across_intervals(self):
        """Recorded every 1e-5 s, the accumulation and what follows it reach over many intervals."""
        with self.run_scene(EXAMPLES / "ball" / "scene.toml", tolerance=1e-6, time__start=0.0, time__end=4.2, time__step=1e-3) as file:
            self.check_ball_position(file, 1.0, 0.0, 10.0, 0.8)
        scene = self.path / "low.toml"  # the last bounces of such a ball alone
        scene.write_text(
            '[time]\nscheme = "hybrid"\nend = 0.02\nstep = 1e-5\ntolerance = 1e-6\n[model]\nkind = "lagrangian"\nM = [[1.0]]\n'
            "K = [[0.0]]\nH = [[1.0]]\nq0 = [1e-5]\nv0 = [0.0]\nf = [-10.0]\ne = [0.8]\n"
        )
        with self.run_scene(scene, tolerance=1e-6) as file:
            self.check_ball_position(file, 1e-5, 0.0, 10.0, 0.8)

    def test_position_beyond_the_wall(self):
        scene = self.path / "beyond.toml"
        scene.write_text(
            '[time]\nscheme = "hybrid"\nend = 1.0\nstep = 0.1\n[model]\nkind = "lagrangian"\nM = [[2.0]]\n'
            "K = [[0.0]]\nH = [[1.0]]\nq0 = [-0.5]\nv0 = [-1.0]\nf = [-1.0]\ne = [0.5]\n"
        )
        with self.run_scene(scene) as file:
            later = file["t"][1:]
            x = file["x"][1:]
            flying = later < 2.0  # put onto the wall, leaves with 0.5 m/s, comes back after 2 s
            np.testing.assert_allclose(x[flying, 0], 0.5 * later[flying] - 0.25 * later[flying] ** 2, atol=1e-12)

    def test_inconsistent_start(self):
        """AB example 1: x0 = (-1, -1, 0) is projected at once, and rests."""
        scene = self.path / "start.toml"
        scene.write_text(
            '[time]\nscheme = "hybrid"\nend = 1.0\nstep = 0.1\n[model]\nkind = "linear"\nA = [[0,1,0],[0,0,1],[0,0,0]]\n'
            "B = [[0],[0],[1]]\nC = [[1,0,0]]\nx0 = [-1,-1,0]\n"
        )
        with self.run_scene(scene) as file:
            self.assertEqual(np.abs(file["x"][1:]).max(), 0.0)
            np.testing.assert_allclose(file["mu"][1].ravel(), [1.0, 1.0, 0.0], atol=1e-15)

    # The run ------------------------------------------------------------------------------------------

    def test_ranks_agree(self):
        rows = []
        for ranks in (1, 2, 3):
            with self.run_scene(EXAMPLES / "flexible_chain" / "scene.toml", ranks=ranks, model__count=8, time__step=0.01) as file:
                rows.append((file["t"][:], file["x"][:]))
        for t, x in rows[1:]:
            self.assertEqual(len(t), len(rows[0][0]))
            np.testing.assert_allclose(t, rows[0][0], rtol=0, atol=1e-10)
            np.testing.assert_allclose(x, rows[0][1], rtol=0, atol=1e-7)  # jumps in p' follow the times of impacts

    def test_goes_on_to_the_same_bits(self):
        scene = EXAMPLES / "flexible_chain" / "scene.toml"
        words = ["run", scene, "--set=time.scheme=hybrid", "--set=time.tolerance=1e-10", "--set=time.step=2e-4", "--set=model.count=9"]
        whole = program.run(*words, "-o", "whole.h5", cwd=self.path, timeout=100)
        self.assertEqual(whole.code, 0, whole)
        code, err = going_on.interrupted(self.path, [*words, "-o", "part.h5"])
        self.assertEqual(code, 4, err)
        again = program.run(*words, "-o", "again.h5", "--restart", "part.h5", cwd=self.path, timeout=100)
        self.assertEqual(again.code, 0, again)
        self.assertEqual(going_on.same_bits(self.path / "whole.h5", self.path / "again.h5"), [])

    def test_bad_scenes(self):
        scene = EXAMPLES / "paper65" / "scene.toml"
        for settings, text in (
            (["time.tolerance=1e-6"], "goes with the scheme"),
            (["time.scheme=hybrid", "time.tolerance=0"], "expected 1e-15 to 0.1"),
        ):
            outcome = program.run("run", scene, *[f"--set={s}" for s in settings], cwd=self.path)
            self.assertEqual(outcome.code, 2, outcome)
            self.assertIn(text, outcome.err)
        outcome = program.run("run", EXAMPLES / "zi_regulator" / "scene.toml", "--set=time.scheme=hybrid", cwd=self.path)
        self.assertEqual(outcome.code, 2, outcome)
        self.assertIn("takes no regulator", outcome.err)
        full_mass = "model.M=[[2,1],[1,2]]", "model.K=[[1,0],[0,1]]", "model.H=[[1,0]]", "model.q0=[1,1]", "model.v0=[0,0]"
        sets = [f"--set={s}" for s in (*full_mass, "model.f=[0,0]", "time.scheme=hybrid")]
        outcome = program.run("run", EXAMPLES / "ball" / "scene.toml", *sets, cwd=self.path)
        self.assertEqual(outcome.code, 2, outcome)
        self.assertIn("diagonal", outcome.err)


if __name__ == "__main__":
    unittest.main()
