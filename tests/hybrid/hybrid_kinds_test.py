# ranks: 1
# timeout: 300
"""What the scheme hybrid has to hold on models of every kind: outputs from states, any number of events at one time, contacts
that others open, components of different units, branches with D, no drift, an error that is estimated; on one and two ranks."""

import json
import math
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

IMPACT, LIFT_OFF = 0, 1
ROUNDING = 2.0**-53

PAPER65_A = [[0, 1, 0, 0, 0], [0, 0, 1, 0, 0], [-1, -1, -1, 0, 1], [0, 0, 0, 0, 1], [1, 0, 0, -1, 0]]
PAPER65_LIFT_OFF = 6.199615848871525286
PAPER65_END = [2.038074313834594676, 0.453192855214661465, -1.056047929937494749, 2.615870338795054074, 0.624221522682221825]


def toml(value):
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key} = {toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, (list, tuple, np.ndarray)):
        return "[" + ", ".join(map(toml, value)) + "]"
    return json.dumps(value) if isinstance(value, (str, bool)) else repr(float(value)) if not isinstance(value, int) else str(value)


class HybridKinds(unittest.TestCase):
    def setUp(self):
        self.folder = program.temporary_folder()
        self.addCleanup(self.folder.cleanup)
        self.path = Path(self.folder.name)

    def run_model(self, model, end, step, tolerance=None, ranks=1, code=0, every=1):
        """Datasets of a run; self.summary, self.events."""
        time = {"scheme": "hybrid", "end": end, "step": step}
        if tolerance:
            time["tolerance"] = tolerance
        tables = {"time": time, "model": model, "output": {"every": every}}
        scene = self.path / "scene.toml"
        scene.write_text("".join(f"[{name}]\n" + "".join(f"{key} = {toml(value)}\n" for key, value in keys.items()) for name, keys in tables.items()))  # fmt: skip
        outcome = program.run(
            "run", scene, "-o", self.path / "out.h5", "--force", "--summary", self.path / "s.json", ranks=ranks, cwd=self.path, timeout=100,
        )  # fmt: skip
        self.assertEqual(outcome.code, code, outcome)
        if code != 0:
            return outcome
        self.summary = json.loads((self.path / "s.json").read_text())
        with h5py.File(self.path / "out.h5") as file:
            data = {name: file[name][:] for name in ("t", "x", "w", "mu", "level", "solver/error")}
            data.update({name: file[name][:] for name in ("z", "energy") if name in file})
            self.events = file["events"][:] if "events" in file else np.zeros(0)
        self.check_outputs(model, data)
        return data

    def check_outputs(self, model, data):
        """w is C x + w0 in every row, up to rounding of that sum."""
        x = data["x"]
        if model["kind"] == "linear" and "D" not in model:
            C, w0 = np.array(model["C"], float), np.array(model.get("w0", np.zeros(len(model["C"]))), float)
        elif model["kind"] == "lagrangian":
            H = np.array(model["H"], float)
            C, w0 = np.hstack([H, np.zeros_like(H)]), np.array(model.get("g0", np.zeros(len(H))), float)
        else:
            return
        # What rows are computed from has been as large as any row so far.
        sizes = np.maximum.accumulate(np.abs(x)) @ np.abs(C).T + np.abs(w0)
        self.assertTrue(np.all(np.abs(data["w"] - (x @ C.T + w0)) <= 100 * ROUNDING * sizes))

    def check_error(self, data, distance):
        """The largest error of a component relative to its size is at most ten times its estimate at the end."""
        self.assertLessEqual(distance, 10 * data["solver/error"].max())

    def both(self, *arguments, **settings):
        """By the default tolerance on one rank, by a small one on two."""
        for tolerance, ranks in ((None, 1), (1e-12, 2)):
            with self.subTest(tolerance=tolerance, ranks=ranks):
                yield self.run_model(*arguments, tolerance=tolerance, ranks=ranks, **settings)

    # Outputs and series -------------------------------------------------------------------------------

    def test_no_event_is_invented(self):
        """x^(r) = +-x, r even, has the solution -cos t; w = 1.01 - cos t never meets its wall, whatever r is. Its
        unstable modes grow as exp(cos(pi/6) t): not longer than rounding stays small."""
        for r, end in ((2, 1000.0), (6, 20.0)):
            A = np.diag(np.ones(r - 1), 1)
            A[-1, 0] = (-1) ** (r // 2)
            x0 = [(-1, 0, 1, 0)[k % 4] for k in range(r)]
            model = {"kind": "linear", "A": A, "B": [[0]] * (r - 1) + [[1]], "C": [[1] + [0] * (r - 1)], "x0": x0, "w0": [1.01]}
            for data in self.both(model, end, end / 200):
                self.assertEqual(len(self.events), 0)
                error = np.abs(data["x"][:, 0] + np.cos(data["t"])).max()
                # cos t is known to the rounding of t times its slope; series add one rounding each.
                self.assertLessEqual(error, 1e-7 if r > 2 else 2 * end * ROUNDING * 10)

    def test_outputs_do_not_drift(self):
        """q'' = k (p - q), the motor pulled from its wall: w is q for ever."""
        for count in (1, 4):
            model = {"kind": "chain", "element": "flexible", "count": count, "force": 2}
            data = self.run_model(model, 300.0, 1.0)
            states = data["x"].reshape(len(data["t"]), -1)
            np.testing.assert_array_equal(np.sort(data["w"], axis=1) >= 0, True)
            q = states[:, [j for j in range(states.shape[1])]]
            for a in range(count):
                self.assertTrue(np.any(np.all(np.abs(q - data["w"][:, [a]]) <= 1e-12 * (1 + np.abs(q)), axis=0)))

    def test_components_of_different_units(self):
        """x'' = -sin(6 pi t) + lambda on its wall: leaves at 1/6 s, beside a constant of any size that nothing reads, in any unit."""
        omega = 6 * math.pi
        t = 1.0
        # At rest until f > 0, at pi/omega; from then x' = (cos(omega t) + 1)/omega, until f is negative and it falls.
        start = math.pi / omega
        velocity = lambda t: (math.cos(omega * t) - math.cos(omega * start)) / omega
        position = (math.sin(omega * t) - math.sin(omega * start)) / omega**2 + (t - start) / omega
        for beside in (0.0, 1e9, 1e15):
            for unit in (1.0, 1e-9):
                model = {
                    "kind": "linear", "A": [[0, 1, 0], [0, 0, 0], [0, 0, 0]], "B": [[0], [1], [0]], "C": [[1, 0, 0]],
                    "f": [0, {"offset": 0, "amplitude": -unit, "frequency": 3}, 0], "x0": [0, 0, beside],
                }  # fmt: skip
                data = self.run_model(model, t, 1.0)
                np.testing.assert_allclose(data["x"][-1] / unit, [position, velocity(t), beside / unit], rtol=1e-13, atol=1e-14)

    # Events -------------------------------------------------------------------------------------------

    def test_many_at_one_time(self):
        """Modes of a chain: x_i(t) = sin(pi i/(N + 1)) times the solution of AB (65), where a1 takes up the coupling."""
        for count, ranks in ((60, 2), (200, 1)):
            shape = np.sin(np.pi * np.arange(1, count + 1) / (count + 1))
            coupling = 0.7
            a1 = -1 + 2 * coupling * (1 - math.cos(math.pi / (count + 1)))
            x0 = np.zeros((count, 5))
            x0[:, 0] = shape
            model = {"kind": "chain", "element": "jerk", "count": count, "coupling": coupling, "a1": a1, "x0": x0.ravel()}
            with self.subTest(count=count, ranks=ranks):
                data = self.run_model(model, 10.0, 0.5, tolerance=1e-12, ranks=ranks)
                x = data["x"][-1].reshape(count, 5)
                error = np.abs(x - np.outer(shape, PAPER65_END)).max()
                self.assertLessEqual(error, 1e-12)
                times = self.events["t"][self.events["kind"] == LIFT_OFF]
                self.assertEqual(len(times), count)
                np.testing.assert_allclose(times, PAPER65_LIFT_OFF, rtol=0, atol=1e-12)

    def test_many_in_one_interval(self):
        """A mass between elastic walls hits one each second; rows say nothing about it."""
        model = {"kind": "lagrangian", "M": [[1.0]], "K": [[0.0]], "H": [[1.0], [-1.0]], "q0": [0.0], "v0": [2.0], "g0": [1.0, 1.0], "e": 1.0}  # fmt: skip
        ends = []
        for step in (2000.0, 10.0, 0.75):
            data = self.run_model(model, 1500.0, step, tolerance=1e-12, every=1000)
            self.assertEqual(self.summary["hybrid"]["events"], 1500)
            ends.append((data["x"][-1].tolist(), data["solver/error"][-1]))
            np.testing.assert_allclose(data["x"][-1], [0.0, 2.0], rtol=0, atol=1e-10)
            self.check_error(data, np.abs(data["x"][-1] - [0.0, 2.0]).max() / 2)
        self.assertEqual(ends[0][0], ends[1][0])  # the same bits
        self.assertEqual(ends[0][0], ends[2][0])

    def test_a_contact_that_an_impact_elsewhere_opens(self):
        """A rod (m = 1, J = 2, half length 1, g = 1) rests on end 1, end 2 falls: impact at t = 1 with w2' = -2/3, and
        p1 = 0: H M^-1 H' = [[3/2, 1/2], [1/2, 3/2]] gives p2 = (1 + e)(2/3)/(3/2), w1'+ = p2/2, w2'+ = e 2/3: both leave."""
        for e in (0.5, 0.25):
            model = {
                "kind": "lagrangian", "M": [[1, 0], [0, 2]], "K": [[0, 0], [0, 0]], "H": [[1, -1], [1, 1]], "f": [-1, 0],
                "q0": [1 / 6, 1 / 6], "v0": [0, 0], "e": e,
            }  # fmt: skip
            p2 = (1 + e) * (2 / 3) / 1.5
            for data in self.both(model, 1.25, 0.1):
                s = data["t"][-1] - 1.0  # before any of them lands again
                np.testing.assert_allclose(data["w"][-1], [0.5 * p2 * s - s * s / 2, e * (2 / 3) * s - s * s / 2], rtol=0, atol=1e-13)
                self.assertEqual(sorted((int(e["constraint"]), int(e["kind"])) for e in self.events), [(0, LIFT_OFF), (1, IMPACT), (1, LIFT_OFF)])

    # Bounds -------------------------------------------------------------------------------------------

    def test_bounds_that_are_the_same(self):
        """u_0 = sin t, and u_1' = -u_0 between -1 and 1: -1 is met where cos t = -0.3, and left at pi. lambda_0 = cos t - u_1."""
        wave = {"amplitude": 1.0, "frequency": 0.5 / math.pi}
        turned = {"amplitude": -1.0, "frequency": 0.5 / math.pi, "phase": math.pi}
        hit = math.acos(-0.3)
        for upper, start in ((wave, 0.0), (turned, 0.5)):
            model = {
                "kind": "sweeping", "A": [[0, 1], [-1, 0]], "u0": [start, 0.3], "lower": [wave, -1], "upper": [upper, 1],
            }  # fmt: skip
            for data in self.both(model, 6.0, 0.1):
                t = data["t"]
                u = np.where(t < hit, np.cos(t) - 0.7, np.where(t < math.pi, -1.0, np.cos(t)))
                after = slice(1 if start else 0, None)
                np.testing.assert_allclose(data["x"][after], np.stack([np.sin(t), u], axis=1)[after], rtol=0, atol=1e-12)
                integral = 0.7 * np.minimum(t, hit) + np.clip(np.sin(t) + t - math.sin(hit) - hit, 0, None) * (t <= math.pi)
                integral += (t > math.pi) * (math.pi - math.sin(hit) - hit)
                np.testing.assert_allclose(np.cumsum(data["mu"][:, 0].ravel())[1:], (integral - start)[1:], rtol=0, atol=1e-12)
                told = [(int(e["constraint"]), int(e["kind"])) for e in self.events if e["t"] > 0]
                self.assertEqual(told, [(1, IMPACT), (1, LIFT_OFF)])

    def test_bounds_that_meet(self):
        """Between cos t - 1 and 1 - cos t, which meet at 0 and 2 pi: pushed to a bound with force 1 a component stays there, as
        sin t <= 1; one that is not pushed stays where it is."""
        wave = {"offset": -1.0, "amplitude": 1.0, "frequency": 0.5 / math.pi, "phase": 0.5 * math.pi}
        above = {"offset": 1.0, "amplitude": -1.0, "frequency": 0.5 / math.pi, "phase": 0.5 * math.pi}
        model = {"kind": "sweeping", "u0": [0.0] * 3, "f": [1.0, -1.0, 0.0], "lower": [wave] * 3, "upper": [above] * 3}
        for data in self.both(model, 12.0, 0.1):
            bound = 1 - np.cos(data["t"])
            np.testing.assert_allclose(data["x"], np.stack([bound, -bound, 0 * bound], axis=1), rtol=0, atol=1e-13)
            self.assertFalse([e for e in self.events if e["t"] > 0])
        # They cross at pi.
        wave, above = ({"amplitude": s, "frequency": 0.5 / math.pi} for s in (-1.0, 1.0))
        model = {"kind": "sweeping", "u0": [0.0], "lower": [wave], "upper": [above]}
        self.assertIn("K(t) is empty", self.run_model(model, 6.0, 0.1, code=2).err)
        # Between two rows, which nobody looks at before the run.
        self.assertIn("bounds of component 0 meet or cross", self.run_model(model, 7.2, 7.2, code=3).err)

    def test_contacts_that_depend_on_each_other(self):
        """Opposite faces that move together hold u_i = sin t, whatever pushes; only the difference of their measures is known."""
        for count, ranks in ((1, 2), (3, 1), (60, 1)):
            wave, back = ({"amplitude": s, "frequency": 0.5 / math.pi} for s in (1.0, -1.0))
            rows = np.zeros((2 * count, count))
            rows[range(0, 2 * count, 2), range(count)] = 1
            rows[range(1, 2 * count, 2), range(count)] = -1
            push = (-1.0) ** np.arange(count) * 3
            model = {"kind": "sweeping", "u0": [0.0] * count, "G": rows, "g": [wave, back] * count, "f": push}
            with self.subTest(count=count, ranks=ranks):
                data = self.run_model(model, 6.0, 0.5, tolerance=1e-12, ranks=ranks)
                np.testing.assert_allclose(data["x"], np.sin(data["t"])[:, None] * np.ones(count), rtol=0, atol=1e-13)
                mu = np.cumsum(data["mu"].reshape(len(data["t"]), count, 2), axis=0)
                np.testing.assert_allclose(mu[..., 0] - mu[..., 1], np.sin(data["t"])[:, None] - push * data["t"][:, None], rtol=0, atol=1e-11)

    # Masses -------------------------------------------------------------------------------------------

    def test_energy_between_two_walls(self):
        model = {"kind": "lagrangian", "M": [[1]], "K": [[1.2]], "H": [[1], [-1]], "g0": [1, 1], "q0": [0], "v0": [1.5], "e": 1.0}
        for data in self.both(model, 200.0, 10.0):
            # A rounding or two of each of 134 impacts.
            self.assertLessEqual(np.abs(data["energy"][:, :2].sum(axis=1) - 1.125).max(), 134 * 8 * ROUNDING)

    def test_heavy_on_light(self):
        """A heavy mass falls on a light one that lies on the floor: both rest, and w is what the positions say."""
        for ratio in (1.0, 1e6, 1e12):
            model = {
                "kind": "lagrangian", "M": [[1, 0], [0, ratio]], "K": [[0, 0], [0, 0]], "H": [[1, 0], [-1, 1]], "g0": [0, -1],
                "f": [-9.81, -9.81 * ratio], "q0": [0.01, 1.02], "v0": [0, 0], "e": 0,
            }  # fmt: skip
            for data in self.both(model, 1.0, 0.1):
                np.testing.assert_allclose(data["x"][-1], [0, 1, 0, 0], rtol=0, atol=1e-14)

    # Relative degree 0 --------------------------------------------------------------------------------

    def test_diode_with_knee(self):
        """lambda = max(0, E - V)/D against a sine, in closed form; and between two limits."""
        omega, gain, resistance = 2 * math.pi, 10.0, 1e-3
        A = [[0, omega], [-omega, 0]]
        for wmax in (math.inf, 3.0):
            model = {"kind": "linear", "A": A, "B": [[0], [0]], "C": [[-gain, 0]], "D": [[resistance]], "w0": [1.0], "x0": [0, 1]}
            if wmax < math.inf:
                model["wmax"] = [wmax]
            for data in self.both(model, 1.0, 0.01):
                t = data["t"]
                free = 1.0 - gain * np.sin(omega * t)  # w where lambda = 0
                np.testing.assert_allclose(data["w"][1:, 0], np.clip(free, 0, wmax)[1:], rtol=0, atol=1e-12)
                # Measures are integrals of lambda: those of max(0, -free) - max(0, free - wmax).
                fine = np.linspace(0, 1, 400001)
                wave = 1.0 - gain * np.sin(omega * fine)
                force = (np.maximum(0, -wave) - np.maximum(0, wave - wmax)) / resistance
                sums = np.concatenate([[0], np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(fine))])
                np.testing.assert_allclose(np.cumsum(data["mu"].ravel()), np.interp(t, fine, sums), rtol=0, atol=2e-6)
                self.assertEqual(len(self.events), 2 if wmax == math.inf else 4)

    def test_degrees_0_and_1_together(self):
        """x' = -x - 1 + lambda_1 + lambda_0/2, w_1 = x, w_0 = x - 1/2 + lambda_0: lambda_0 = max(0, 1/2 - x) holds x only below 0,
        where lambda_1 = 3/4 is left at x = 0."""
        model = {
            "kind": "linear", "A": [[-1]], "B": [[1, 0.5]], "C": [[1], [1]], "D": [[0, 0], [0, 1]], "w0": [0, -0.5], "x0": [1], "f": [-1],
        }  # fmt: skip
        for data in self.both(model, 2.0, 0.05):
            t, x = data["t"], data["x"][:, 0]
            # Until 1/2: x = 2 e^-t - 1. Then x' = -3/2 x - 3/4: x = e^(-3(t - s)/2) - 1/2, to 0.
            s = math.log(4 / 3)
            hit = s + math.log(2) / 1.5
            exact = np.where(t < s, 2 * np.exp(-t) - 1, np.where(t < hit, np.exp(-1.5 * (t - s)) - 0.5, 0.0))
            np.testing.assert_allclose(x, exact, rtol=0, atol=1e-14)
            np.testing.assert_allclose([e["t"] for e in self.events], [s, hit], rtol=0, atol=1e-13)
            self.assertAlmostEqual(data["mu"][:, 0].sum(), 0.75 * (2.0 - hit), delta=1e-13)

    def test_bridge_of_diodes(self):
        """Four ideal diodes in a bridge between a resonator and a resistor R, D singular in parts: seen from the resonator they are
        R, x' = [-1/(R C), -1/C; 1/L, 0] x. All four change where the voltage vanishes, with no current anywhere."""
        A = np.array([[0, -1e6], [1e2, 0]])
        model = {
            "kind": "linear", "A": A, "B": [[0, 0, -1e6, 1e6], [0, 0, 0, 0]], "C": [[0, 0], [0, 0], [-1, 0], [1, 0]],
            "D": [[1e-3, 1e-3, -1, 0], [1e-3, 1e-3, 0, -1], [1, 0, 0, 0], [0, 1, 0, 0]], "x0": [10.0, 0.0],
        }  # fmt: skip
        damped = A - np.array([[1e3, 0], [0, 0]])
        values, vectors = np.linalg.eig(damped)
        start = np.linalg.solve(vectors, np.array([10.0, 0.0]))
        for data in self.both(model, 5e-3, 1e-4):
            exact = np.real(np.exp(np.outer(data["t"], values)) * start @ vectors.T)
            np.testing.assert_allclose(data["x"], exact, rtol=0, atol=1e-10)
            self.assertTrue((data["w"][1:] >= 0).all() and (data["mu"] >= 0).all())  # the first row: where lambda is 0
            zeros = np.flatnonzero(np.diff(np.sign(np.real(np.exp(np.outer(np.linspace(0, 5e-3, 4001), values)) * start @ vectors.T)[:, 0])))
            self.assertEqual(len({round(e["t"], 12) for e in self.events}), len(zeros))

    # The estimate -------------------------------------------------------------------------------------

    def test_estimate_follows_an_unstable_motion(self):
        """x'' = x from a state that is not representable: rounding grows as e^t, and so does what is told."""
        model = {"kind": "linear", "A": [[0, 1], [1, 0]], "B": [[0], [1]], "C": [[1, 0]], "x0": [0.1, -0.1], "w0": [1.0]}
        data = self.run_model(model, 20.0, 1.0)
        error = np.abs(data["x"][-1] - 0.1 * math.exp(-20.0)).max() / 0.1
        self.assertGreater(data["solver/error"][-1], 1e6 * data["solver/error"][1])
        self.check_error(data, error)
        self.assertAlmostEqual(self.summary["hybrid"]["error"], data["solver/error"][-1])

    def test_estimate_counts_the_end_of_an_accumulation(self):
        """A ball whose impacts accumulate: the velocity with which it is put to rest is below a hundredth of the tolerance."""
        for tolerance in (1e-4, 1e-8):
            model = {"kind": "lagrangian", "M": [[1]], "K": [[0]], "H": [[1]], "q0": [1], "v0": [0], "f": [-10], "e": 0.8}
            data = self.run_model(model, 5.0, 0.01, tolerance=tolerance)
            self.assertEqual(self.summary["hybrid"]["closed"], 1)
            t, x = data["t"], data["x"]
            flights, v = [(0.0, 1.0, 0.0)], math.sqrt(20.0)
            time = v / 10
            while v > 1e-17:
                v *= 0.8
                flights.append((time, 0.0, v))
                time += 2 * v / 10
            flights = np.array(flights)[np.searchsorted([f[0] for f in flights], t, side="right") - 1]
            since = t - flights[:, 0]
            exact = np.where(t < time, flights[:, 1] + flights[:, 2] * since - 5 * since**2, 0.0)
            error = np.abs(x[:, 0] - exact).max()
            self.assertLessEqual(error, tolerance)
            self.assertLessEqual(error, 10 * data["solver/error"].max())


if __name__ == "__main__":
    unittest.main()
