"""The scenes of impact oscillators, examples/zi_*: what their headers promise, and the equations of every step."""
# ranks: 1
# timeout: 200

import json
import unittest

import gallery
import numpy as np
import oscillators
import program

BALL, REGULATOR, CHAIN = "zi_ball/scene.toml", "zi_regulator/scene.toml", "zi_chain/scene.toml"


class ImpactOscillators(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.examples = {
            " ".join([example.scene.removeprefix("examples/"), *example.words[1:]]): example
            for example in gallery.examples()
        }
        folder = program.temporary_folder()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = folder.name

    def run_example(self, name, *more, **options):
        return oscillators.run(self.folder, self.examples[name], *more, **options)

    def promised(self, name, *texts):
        for text in texts:
            self.assertIn(text, self.examples[name].expect)

    def test_ball(self):
        known = json.loads((gallery.REFERENCE / "zi_ball.json").read_text())
        schemes = {scheme["h"]: scheme for scheme in known["scheme"]}
        for words, h, first, impacts, rest, off in (
            ("", 1e-3, "1.372", 7, "2.444", "0.01016"),
            (" --set time.step=1e-4", 1e-4, "1.3718", 10, "2.4626", "0.00065"),
        ):
            name = BALL + words
            self.promised(name, f"{first} s", f"{impacts} in all", f"{rest} s", f"{off} m")
            result = self.run_example(name)
            oscillators.audit(result, 0.41, lambda t, x: -9.81)
            self.assertEqual(len(result.impacts()), impacts)
            self.assertAlmostEqual(result.impacts()["t"][0], float(first), delta=1e-9)
            self.assertAlmostEqual(result.rest()[0], float(rest), delta=1e-9)
            error = abs(result.x[:, 0] - bounces(known, result.t)).max()
            self.assertLess(error, float(off))
            self.assertAlmostEqual(error, schemes[h]["err_sup_all"], delta=1e-11)  # rounding
            # An impulse is 2|v|, the jump of x' = R v sgn(s) where s changes its sign: 1 + e times the velocity before.
            before = np.array([-float(impact["vminus"]) for impact in known["impacts"][:2]])
            impulses = result.impacts()["impulse"][:2]
            np.testing.assert_allclose(impulses, before * (1 + (1 - 0.41) / (1 + 0.41)), atol=60 * h)  # first order
        self.promised(BALL, "27.48 J of 27.81 J")
        energy = self.run_example(BALL).energy
        np.testing.assert_allclose(energy[0], [18, 9.81, 0], rtol=1e-15)
        np.testing.assert_allclose(energy[-1], [0, 0, 27.48], atol=5e-3)
        self.assertTrue((np.diff(energy[:, 2]) >= 0).all())

    def test_ball_resampled(self):
        name = BALL + " --set model.resample=true"
        self.promised(name, "to 1e-11", "s >= 0")
        direct, resampled = self.run_example(BALL), self.run_example(name)
        np.testing.assert_allclose(resampled.x, direct.x, atol=1e-11)
        # Each step starts from s >= 0: never two rows with s < 0 one after the other.
        below = resampled.z[:, 0] < 0
        self.assertTrue(below.any() and not (below[1:] & below[:-1]).any())
        self.assertTrue((direct.z[1:, 0] < 0).sum() > 500)

    def test_regulator(self):
        impacts = "1.020, 1.276, 1.320 and 1.326 s"
        self.promised(REGULATOR, "s from 6 m, v from 5 m/s", impacts, "rest from 1.327 s", "1.332637 s")
        known = np.genfromtxt(gallery.REFERENCE / "regulator_v0_5.csv", delimiter=",", names=True)
        result = self.run_example(REGULATOR)
        oscillators.audit(result, 0.5, lambda t, x: 0.0, mu=(30.0, 17.0))
        np.testing.assert_array_equal(result.z[0], [6, 5])
        np.testing.assert_allclose(result.impacts()["t"], [1.020, 1.276, 1.320, 1.326], atol=1e-9)
        self.assertAlmostEqual(result.rest()[0], 1.327, delta=1e-9)
        self.assertLess(abs(result.rest()[0] - 1.332637), 10 * result.h)
        rows = known["t"] <= 2.0
        for column, name in enumerate(("s", "v")):
            np.testing.assert_allclose(result.z[::10, column], known[name][rows], atol=1e-10)
        # At rest the two gains hold each other: -mu1 lambda_s = mu2 lambda_v.
        at_rest = (result.z == 0).all(axis=1)
        signs = result.signs[at_rest][1:, 0]  # without the step that came to rest
        np.testing.assert_allclose(30 * signs[:, 0] + 17 * signs[:, 1], 0, atol=1e-12)

        name = REGULATOR + " --set model.force={amplitude=8.0,frequency=5.0}"
        self.promised(name, "M = 8: the condition holds", "rest from 1.328 s")
        forced = self.run_example(name)
        oscillators.audit(forced, 0.5, lambda t, x: 8 * np.sin(10 * np.pi * t), mu=(30.0, 17.0))
        self.assertAlmostEqual(forced.rest()[0], 1.328, delta=1e-9)

    def test_gain_condition(self):
        """M < mu2 < mu1 - M with mu1 = 30, mu2 = 17: up to 13, for all phases of a wave."""
        for force, bound, holds in (
            ("0.0", "0", True),
            ("-12.9", "12.9", True),
            ("-13.1", "13.1", False),
            ("{offset=-6.0,amplitude=6.9,frequency=5.0}", "12.9", True),
            ("{offset=-6.0,amplitude=7.1,frequency=5.0}", "13.1", False),
        ):
            outcome = program.run("check", str(gallery.EXAMPLES / REGULATOR), "--set", f"model.force={force}")
            self.assertEqual(outcome.code, 0, outcome)
            self.assertIn(f"|force| <= M = {bound}:", outcome.out)
            self.assertEqual("holds, rest is reached" in outcome.out, holds, outcome)
            self.assertEqual("does not hold, rest is not guaranteed" in outcome.out, not holds, outcome)
        chain = program.run("check", str(gallery.EXAMPLES / CHAIN), "--set", "model.regulator={mu1=30.0,mu2=10.0}")
        self.assertIn("M = 9.81: the gain condition M < mu2 < mu1 - M holds", chain.out)
        self.assertIn("springs are not counted in M", chain.out)

    def test_chain_without_springs(self):
        name = CHAIN + " --set model.count=50 --set model.coupling=0"
        self.promised(name, "rests at 1.095 s", "at most 1.103 s", "early by at most 0.01 s")
        result = self.run_example(name, "--set", "output.every=1")
        oscillators.audit(result, 0.5, lambda t, x: np.full_like(x, -9.81))
        exact = 2 * np.sqrt(2 * result.x[0, :50] / 9.81)
        self.assertLess(exact.max(), 1.103)
        self.assertAlmostEqual(result.rest().max(), 1.095, delta=1e-9)
        early = exact - result.rest()
        self.assertTrue((early > 0).all() and (early < 0.01).all())

    def test_chain(self):
        """As in the scene, but 60 balls; on other ranks, recorded in part, and with gravity of its own for each."""
        name = CHAIN
        more = ("--set", "model.count=60", "--set", "output.every=1")
        result = self.run_example(name, *more, ranks=2)
        oscillators.audit(result, 0.5, lambda t, x: 20 * gallery.laplacian(60) @ x - 9.81)
        self.assertTrue((result.z[-1] == 0).all())
        self.assertTrue((abs(result.signs[-1, :, 0]) < 1).all())
        self.assertEqual(result.summary["predictor_hits"], result.summary["steps"])
        self.assertEqual(result.summary["rungs"]["predictor"], result.summary["steps"])
        self.assertEqual(result.summary["edge_cut"], 1)
        # Springs and gravity only: the energy falls, and is 0 when all lie.
        self.assertTrue((np.diff(result.energy[:, :2].sum(axis=1)) <= 1e-12 * result.energy[0, 1]).all())
        x0 = result.x[0, :60]
        potential = 9.81 * x0.sum() - 10 * x0 @ gallery.laplacian(60) @ x0
        np.testing.assert_allclose(result.energy[0], [0, potential, 0], rtol=1e-14)
        np.testing.assert_array_equal(result.energy[-1, :2], 0)

        alone = self.run_example(name, *more, ranks=1)
        np.testing.assert_allclose(alone.z, result.z, atol=1e-10)  # rounding of sums over ranks
        part = self.run_example(name, *more, "--set", "output.blocks=[7, 41]", ranks=2)
        np.testing.assert_array_equal(part.x, result.x[:, [7, 41, 67, 101]])
        np.testing.assert_array_equal(part.z, result.z[:, [7, 41, 67, 101]])
        np.testing.assert_array_equal(part.signs, result.signs[:, [7, 41]])

    def test_own_values_for_each(self):
        """kappa and force per ball, x0 by hand: a ball on the wall with a force upwards leaves, the other stays."""
        result = self.run_example(
            CHAIN, "--set", "model.count=3", "--set", "model.coupling=0", "--set", "model.kappa=[0.2, 0.5, 0.8]",
            "--set", "model.force=[2.0, -2.0, -9.81]", "--set", "model.x0=[0, 0, 0.5, 0, 0, 1.0]", "--set", "output.every=1",
            ranks=2,
        )  # fmt: skip
        oscillators.audit(result, np.array([0.2, 0.5, 0.8]), lambda t, x: np.array([2.0, -2.0, -9.81]))
        np.testing.assert_allclose(result.x[:, 0], result.t * (result.t + result.h), rtol=1e-12)  # implicit Euler
        np.testing.assert_array_equal(result.x[:, 1], 0)
        lift_offs = result.events[result.events["kind"] == 1]
        self.assertEqual([(event["t"], event["constraint"]) for event in lift_offs], [(result.h, 0)])


def bounces(known, t):
    """The ball of the reference in closed form between its impacts."""
    start = np.array([0.0] + [float(impact["t"]) for impact in known["impacts"]])
    speed = np.array([6.0] + [float(impact["vplus"]) for impact in known["impacts"]])
    height = np.array([1.0] + [0.0] * len(known["impacts"]))
    at = np.searchsorted(start, t, side="right") - 1
    since = t - start[at]
    x = height[at] + speed[at] * since - 9.81 / 2 * since**2
    return np.where(t >= float(known["zeno"]), 0.0, x)


if __name__ == "__main__":
    unittest.main()
