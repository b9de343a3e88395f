"""Runs every scene of examples/ as its header says and holds the result against what the header promises."""
# ranks: 1
# timeout: 300

import json
import unittest
from fractions import Fraction
from pathlib import Path

import gallery
import numpy as np
import program

EXACT65 = np.array([2.038074313834594676, 0.453192855214661465, -1.056047929937494749, 2.615870338795054074,
                    0.624221522682221825])  # fmt: skip
SCHEMES = ("homsp", "zd-euler", "naive-euler")


def words(example):
    """How the checks below name a run: the scene's path in examples/, then what the Run line adds."""
    return " ".join([example.scene.removeprefix("examples/"), *example.words[1:]])


class Examples(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.examples = {words(example): example for example in gallery.examples()}
        folder = program.temporary_folder()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = folder.name

    def run_example(self, name, *more, **options):
        return gallery.run(self.folder, self.examples[name], *more, **options)

    def promised(self, name, *texts):
        """The numbers checked are those the header states."""
        for text in texts:
            self.assertIn(text, self.examples[name].expect)

    # ---- paper65, forced_contact --------------------------------------------------------------------

    def one_contact(self, result, begin, end):
        self.assertEqual(len(result.contacts()), 1)
        self.assertEqual(len(result.lift_offs()), 1)
        return abs(result.contacts()["t"][0] - begin), abs(result.lift_offs()["t"][0] - end)

    def test_paper65(self):
        name = "paper65/scene.toml"
        begin, end = 4.345147830371428, 6.199615848871525
        self.promised(name, "4.345147830371428", "6.199615848871525", "0.0983", "0.0100")
        order = {entry["N"]: entry for entry in json.loads((gallery.REFERENCE / "order65.json").read_text())}
        errors = []
        for steps, bound, more in ((1000, 0.0983, ()), (10000, 0.0100, ("--set", "time.step=1e-3"))):
            result = self.run_example(name, *more)
            gallery.audit_jerk(result)
            self.assertLessEqual(max(self.one_contact(result, begin, end)), 2 * result.h)
            errors.append(np.linalg.norm(result.x[-1] - EXACT65))
            self.assertLess(errors[-1], bound)
            # The paper's own scheme, computed by another program: equal but for rounding over the steps.
            self.assertAlmostEqual(errors[-1], order[steps]["final_2"], delta=1e-11)
        self.assertAlmostEqual(errors[0] / errors[1], 10, delta=0.2)

    def test_forced_contact(self):
        name = "forced_contact/scene.toml"
        begin, end = 4.275430224833, 6.265932815676
        final = np.array([2.4836203, 0.47590271, -1.2231584, 3.12069791, 0.87438016])
        begin_found, end_found, final_found = forced_contact_exactly(10.0)
        self.assertAlmostEqual(begin, begin_found, delta=1e-11)
        self.assertAlmostEqual(end, end_found, delta=1e-11)
        np.testing.assert_allclose(final, final_found, atol=1e-7)
        self.promised(name, str(begin), str(end), "0.1152", "0.0117", "(2.4836, 0.4759, -1.2232, 3.1207, 0.8744)")
        for bound, more in ((0.1152, ()), (0.0117, ("--set", "time.step=1e-3"))):
            result = self.run_example(name, *more)
            gallery.audit_jerk(result)
            self.assertLessEqual(max(self.one_contact(result, begin, end)), 2 * result.h)
            self.assertLess(np.linalg.norm(result.x[-1] - final_found), bound)
            self.assertGreater(np.linalg.norm(result.x[-1] - final_found), 0.98 * bound)
            held = result.level[:-1, 0] == 3  # rows that end a step of contact
            held &= result.z[:-1, 0, 0] == 0
            self.assertTrue((result.z[:-1][held] == 0).all())
            angle, omega = np.pi / 2 * result.t[:-1][held], np.pi / 2
            # z_3 = x3 + f' is known to the terms of its row; f' is 0.157 here.
            np.testing.assert_allclose(result.x[:-1][held, 1], -0.1 * np.sin(angle), atol=1e-15)
            np.testing.assert_allclose(result.x[:-1][held, 2], -0.1 * omega * np.cos(angle), atol=1e-15)
            self.assertEqual([np.count_nonzero(result.mu[:, 0, i]) for i in (0, 1)], [1, 1])
            self.assertTrue((result.mu[:-1][held, 0, 2] > 0).all())

    # ---- section34 ----------------------------------------------------------------------------------

    def test_section34(self):
        """Every step of every scheme from both starts, at h = 1/10, 1/100, 1/1000, against rational arithmetic."""
        exact = json.loads((gallery.REFERENCE / "examples34.json").read_text())
        scenes = {1: self.examples["section34/example1.toml"], 2: self.examples["section34/example2.toml"]}
        starts = ("(0,-1,0)", "(-1,-1,0)")
        euler = {(1, starts[0]): "be_ex1_a", (1, starts[1]): "be_ex1_b", (2, starts[0]): "be_ex2",
                 (2, starts[1]): "be_ex2_infeasible"}  # fmt: skip

        def compare(case):
            table, number, start, scheme = case
            h = Fraction(table["h"])
            result = gallery.run(
                self.folder, scenes[number], "--set", f"time.step={float(h)}", "--set", f"time.end={float(10 * h)}",
                "--set", f"time.scheme={scheme}", "--set", f"model.x0=[{start[1:-1]}]",
            )  # fmt: skip
            degree = number + 1
            if scheme == "homsp":
                rows = table["homsp"][f"ex{number} x0={start}"]
                measures = [[Fraction(value) for value in row[1]] for row in rows]
            else:  # lambda on the last level only
                rows = table[euler[number, start]]
                measures = [[0] * (degree - 1) + [h * Fraction(row[1])] for row in rows]
            states = [[Fraction(value) for value in row[0]] for row in rows]
            for found, wanted in ((result.x[1:], states), (result.mu[1:, 0], measures)):
                wanted = np.array(wanted[:10], dtype=float)
                text = f"example {number}, x0 = {start}, {scheme}, h = {h}"
                # Each step's rows hold to 1e-14 of their terms; the LCP's size h^r does not enter.
                np.testing.assert_allclose(found, wanted, rtol=1e-12, atol=1e-12 * max(1, abs(wanted).max()), err_msg=text)

        program.run_all(compare, [(t, n, s, c) for t in exact for n in scenes for s in starts for c in SCHEMES])

    def test_section34_as_printed_in_the_headers(self):
        h, k = 0.1, np.arange(1, 11)
        zero = np.zeros((10, 3))
        away1 = np.column_stack([k - 1, 1 / h + 0 * k, 0 * k])
        away2 = np.column_stack([h * k * (k - 1) / 2, k - 1, 1 / h + 0 * k])
        violating, naive, zd = "--set model.x0=[-1,-1,0]", "--set time.scheme=naive-euler", "--set time.scheme=zd-euler"
        one, two = "section34/example1.toml", "section34/example2.toml"
        for name, states, measures in (
            (one, zero, [0, 1]),
            (f"{one} {violating}", zero, [1, 1]),
            (f"{one} {naive}", zero, [0, 1]),
            (f"{one} {naive} {violating}", away1, [0, (1 + h) / h]),
            (f"{one} {zd} {violating}", away1, [0, (1 + h) / h]),
            (two, zero, [0, 1, 0]),
            (f"{two} {naive}", away2, [0, 0, 1 / h]),
            (f"{two} {zd}", away2, [0, 0, 1 / h]),
        ):
            with self.subTest(name):
                result = self.run_example(name)
                np.testing.assert_allclose(result.x[1:], states, rtol=1e-12, atol=1e-11)
                np.testing.assert_allclose(result.mu[1, 0], measures, rtol=1e-12)
                np.testing.assert_allclose(result.mu[2:], 0, atol=1e-11)

    # ---- diode_ladder -------------------------------------------------------------------------------

    def test_diode_ladder(self):
        name = "diode_ladder/scene.toml"
        result = self.run_example(name)
        c, R, Rs = 100e-6, 10.0, np.array([0, 20, 0, 20, 0, 20, 0])
        G = 1e-3 * np.arange(8, 0, -1)
        h, u, w, current = result.h, result.x, result.w, result.mu[:, :, 0] / result.h
        source = 5 * np.sin(2 * np.pi * 50 * result.t)
        rounding = 1e-13  # V, of at most 10 V; the certificate's target is 1e-14 of the terms
        self.assertTrue((current >= 0).all() and (w >= -rounding).all())
        self.assertLess(abs(current * w).max(), rounding)
        np.testing.assert_allclose(np.diff(u) + Rs * current, w, atol=rounding)
        self.assertGreaterEqual(np.diff(u)[:, ::2].min(), -rounding)
        self.assertLess(abs(u).max(), 5)
        charge = c * np.diff(u.sum(axis=1))
        inflow = h * ((source[1:] - u[1:, 0]) / R - (G * u[1:]).sum(axis=1))
        np.testing.assert_allclose(charge, inflow, atol=8 * c * rounding)
        self.assertTrue((current.max(axis=0) > 0).all() and (w.max(axis=0) > 1e-3).all(), "every diode opens and blocks")
        same = self.run_example(name, "--set", "time.scheme=naive-euler")
        np.testing.assert_allclose(same.x, u, atol=1000 * rounding)  # rounding of 1000 steps of a contraction
        two = self.run_example(name, ranks=2)
        np.testing.assert_allclose(two.x, u, atol=1000 * rounding)

    def test_isotonic(self):
        name = "diode_ladder/isotonic.toml"
        self.promised(name, "(2, 5, 5, 5, 5, 8, 8.5, 8.5)", "(0, 4, 2, 4, 0, 0, 3.5)")
        for more in ((), ("--set", "time.step=1e-3", "--set", "time.end=2e-3")):
            result = self.run_example(name, *more)
            start = result.x[0]
            wanted = isotonic_regression(start)
            self.assertEqual(wanted, [2, 5, 5, 5, 5, 8, 8.5, 8.5])
            for row in result.x[1:]:
                np.testing.assert_allclose(row, wanted, atol=1e-14 * 47)  # 47: sum of the charges
            np.testing.assert_allclose(result.mu[1, :, 0], np.cumsum(start - wanted)[:-1], atol=1e-14 * 47)
            np.testing.assert_allclose(result.mu[2], 0, atol=1e-14 * 47)

    # ---- jerk_chain ---------------------------------------------------------------------------------

    def test_jerk_chain(self):
        name = "jerk_chain/scene.toml --set model.count=50 --set output.every=1"
        self.promised(name, "250 unknowns", "52 contacts", "2 elements twice")
        for ranks in (1, 2):
            result = self.run_example(name, ranks=ranks)
            gallery.audit_jerk(result, 0.5 * gallery.laplacian(50))
            self.assertEqual(result.summary["unknowns"], 250)
            self.assertEqual(result.summary["max_penetration"], 0.0)
            per_element = np.bincount(result.contacts()["constraint"], minlength=50)
            self.assertEqual((per_element.sum(), np.count_nonzero(per_element == 2), per_element.min()), (52, 2, 1))
            self.assertEqual(len(result.lift_offs()), 52)

    def test_jerk_chain_of_two(self):
        name = "jerk_chain/scene.toml --set model.count=2 --set time.step=1e-3 --set output.every=1"
        self.promised(name, "2.1728766024319735")
        result = self.run_example(name)
        gallery.audit_jerk(result, 0.5 * gallery.laplacian(2))
        first = result.contacts()[0]
        self.assertEqual(first["constraint"], 1)
        self.assertLessEqual(abs(first["t"] - 2.1728766024319735), 2 * result.h)

    # ---- jerk_lattice, forced_chain -----------------------------------------------------------------

    def test_jerk_lattice(self):
        name = "jerk_lattice/scene.toml"
        self.promised(name, "2880 unknowns", "580 contacts", "four corners at 2.18 s", "4.98 s to 5.52 s", "6.58 s")
        self.assertEqual(self.examples[name].ranks, 2)
        runs = [self.run_example(name, ranks=ranks) for ranks in (2, 1)]
        np.testing.assert_allclose(runs[0].x, runs[1].x, atol=1e-12)
        for result in runs:
            self.assertEqual(result.summary["unknowns"], 2880)
            states = result.x.reshape(-1, 24, 24, 5)
            for mirrored in (states[:, ::-1], states[:, :, ::-1], states.swapaxes(1, 2)):
                np.testing.assert_allclose(states, mirrored, atol=1e-12)
            contacts = result.contacts()
            per_element = np.bincount(contacts["constraint"], minlength=576)
            self.assertEqual(np.flatnonzero(per_element == 2).tolist(), [0, 23, 552, 575])
            self.assertEqual((per_element.sum(), per_element.min(), len(result.lift_offs())), (580, 1, 580))
            self.assertEqual(sorted(contacts["constraint"][:4]), [0, 23, 552, 575])
            self.assertAlmostEqual(contacts["t"][0], 2.18)
            full = result.t[(result.w == 0).all(axis=1)]
            np.testing.assert_allclose([full[0], full[-1], result.events["t"][-1]], [4.98, 5.52, 6.58])

    def test_jerk_lattice_row_by_row(self):
        name = "jerk_lattice/scene.toml --set model.count=30 --set model.shape=[6,5]"
        for ranks in (1, 2):
            result = self.run_example(name, ranks=ranks)
            self.assertEqual(result.summary["unknowns"], 150)
            gallery.audit_jerk(result, gallery.laplacian(6, 5), a=(-1, -2, -2))
            self.assertGreaterEqual(len(result.contacts()), 30)

    def test_forced_chain(self):
        name, alone = "forced_chain/scene.toml", "forced_chain/scene.toml --set model.coupling=0"
        delay, omega = 0.2 * np.arange(20), 2 * np.pi / 8
        self.promised(name, "element 10 at 8.70 s", "element 0 at 6.08 s", "element 19 after 6.12 s, at 9.92 s")
        self.promised(alone, "6.70 s", "6.730562171244")
        results = {}
        for run, coupling in ((name, 0.5), (alone, 0.0)):
            result = results[run] = self.run_example(run)
            force = np.sin(omega * (result.t[:, None] - delay))
            gallery.audit_jerk(result, coupling * gallery.laplacian(20), force=force)
            off, down = result.lift_offs(), result.contacts()
            first = lambda events, i: events["t"][events["constraint"] == i][0]
            for i in range(20):
                self.assertLess(abs(first(off, i) - delay[i]), 1.01 * result.h)
            for i, t in ((10, 8.70), (0, 6.08), (19, 9.92)) if coupling else ((0, 6.70),):
                self.assertAlmostEqual(first(down, i), t)
        result, late = results[alone], 10  # steps from one element to the next
        for i in range(20):
            np.testing.assert_allclose(result.w[late * i :, i], result.w[: len(result.t) - late * i, 0], atol=1e-12)
        free = np.zeros((7, 7))  # z1, z2, z3, xi1, xi2, sin, cos
        free[:5, :5] = gallery.jerk_matrix(np.zeros((1, 1)))
        free[2, 5] = 1
        free[5, 6], free[6, 5] = omega, -omega
        flying = exponential(free, 1.0) @ [0, 0, 0, 0, 0, 0, 1]
        exact = 1.0 + first_root(free, flying, lambda s: s[0], 10.0)[0]
        self.assertAlmostEqual(exact, 6.730562171244, delta=1e-11)
        self.assertLessEqual(abs(exact - 6.70), 2 * result.h)

    # ---- flexible_chain -----------------------------------------------------------------------------

    def test_flexible_chain(self):
        name = "flexible_chain/scene.toml"
        self.promised(name, "1.103 s to 1.835 s", "0.00122", "0.143")
        result = self.run_example(name)
        np.testing.assert_allclose(result.events["t"][[0, -1]], [1.103, 1.835], atol=2.1 * result.h)
        x = result.x.reshape(-1, 50, 4)  # q p q' p'
        rest = result.t > 1.84
        np.testing.assert_allclose(x[rest], np.broadcast_to([0, 0.1, 0, 0], x[rest].shape), atol=1e-13)
        np.testing.assert_allclose(result.mu[rest, :, 3] / result.h, 1, rtol=1e-10)
        hit = result.mu[1:].any(axis=2)
        moves = abs(np.diff(x[:, :, 1], axis=0))
        self.assertLess(moves[~hit].max(), 0.00122)
        self.assertLessEqual(moves[~hit].max(), result.h * abs(x[:, :, 3]).max() * (1 + 1e-9))
        self.assertAlmostEqual(moves[hit].max(), 0.143, delta=0.0005)

    def test_flexible_single(self):
        name = "flexible_chain/single.toml"
        reference = json.loads((gallery.REFERENCE / "flexible_N1_events.json").read_text())["events"]
        bounce, stay = (float(event["t"]) for event in reference)
        self.assertAlmostEqual(bounce, 0.915099007954486, delta=1e-14)
        self.assertAlmostEqual(stay, 0.992485474415426, delta=1e-14)
        jump_q = float(reference[0]["multiplier_jumps"][1])
        jump_p = float(reference[1]["multiplier_jumps"][2]) / 10  # q'' = 10 (p - q) + ..., q held
        self.promised(name, "0.915099007954486", "0.992485474415426", f"{jump_q:.6f}", f"{jump_p:.6f}")
        self.promised(name, "0.9152 s", "0.9918 s", "0.5194", "0.675", "0.0272")
        result = self.run_example(name)
        h, times = result.h, result.contacts()["t"]
        np.testing.assert_allclose(times, [0.9152, 0.9917], atol=0.1 * h)  # the measures of levels > 1 act a step later
        self.assertLessEqual(abs(times[0] - bounce), 2 * h)
        self.assertLessEqual(abs(times[1] - stay), 8 * h)
        at = np.rint(times / h).astype(int) + 1
        for k, level, mu_2, p, dp in ((at[0], 2, 0.5194, 0.0, 0.675), (at[1], 4, 0.0051, 0.0272, 0.559)):
            before, after = result.x[k - 1], result.x[k]
            self.assertEqual(np.flatnonzero(result.mu[k, 0])[-1] + 1, level)
            self.assertAlmostEqual(result.mu[k, 0, 1], mu_2, delta=1e-4)
            self.assertAlmostEqual(after[1] - before[1], p, delta=1e-4)
            self.assertAlmostEqual(after[3] - before[3], dp, delta=1e-3)
        self.assertAlmostEqual(jump_p, 0.0272, delta=0.0005)
        np.testing.assert_allclose(result.x[at[1] :], np.broadcast_to([0, 0.1, 0, 0], result.x[at[1] :].shape), atol=1e-14)
        np.testing.assert_allclose(result.mu[at[1] + 1 :, 0, 3] / h, 1, rtol=1e-11)

    # ---- falling_column -----------------------------------------------------------------------------

    def test_falling_column(self):
        name = "falling_column/scene.toml --set model.count=200 --set time.end=4.6"
        self.promised(name, "4.4833 s", "h (200 - i)", "920")
        gallery.audit_column(self.run_example(name), 200, 4.6)

    # ---- two_walls ----------------------------------------------------------------------------------

    def test_two_walls(self):
        name = "two_walls/scene.toml"
        phi = 2.0  # phi - sin phi = 1, by Newton
        for _ in range(10):
            phi -= (phi - np.sin(phi) - 1) / (1 - np.cos(phi))
        speed = 2 * np.pi * (1 - np.cos(phi))
        self.promised(name, f"exact {speed:.4f}", "2.1158", "1.1158", "-5.443", "8.532")
        header = (gallery.EXAMPLES / name).read_text()
        self.assertIn("phi = 1.9345632107520243", header)
        self.assertIn("0.6157905954298255 s after", header)
        self.assertAlmostEqual(phi, 1.9345632107520243, delta=1e-14)
        self.assertAlmostEqual(phi / np.pi, 0.6157905954298255, delta=1e-15)
        result = self.run_example(name)
        h, t = result.h, result.t
        self.assertEqual(result.summary["unknowns"], 2)
        closing = np.array([1 / 3, *(0.5 + np.arange(3) + phi / np.pi)])
        np.testing.assert_allclose(result.contacts()["t"], closing, atol=2 * h)
        np.testing.assert_allclose(result.lift_offs()["t"], np.arange(4) + 0.5, atol=2 * h)
        blows = result.events["impulse"][(result.events["kind"] == 0) & (result.events["level"] == 2)]
        np.testing.assert_allclose(blows, [-5.443, 8.532, -8.532, 8.532], atol=5e-4)
        np.testing.assert_allclose(blows, [-np.sqrt(3) * np.pi, speed, -speed, speed], atol=15 * h)
        self.assertTrue((result.w >= 0).all() and (result.w <= 2).all())
        held = (result.x[1:, 1] == 0) & (result.x[:-1, 1] == 0) & (result.level[1:, 0] == 2)
        force = 2 * np.pi**2 * np.cos(np.pi * t)
        np.testing.assert_allclose(result.mu[1:, 0, 1][held], -h * force[1:][held], atol=1e-15)
        upper = result.w[:, 0] == 2
        self.assertTrue((result.mu[upper] <= 0).all() and (result.mu[result.w[:, 0] == 0] >= 0).all())

        rows = self.run_example("two_walls/rows.toml")
        self.assertEqual(rows.summary["unknowns"], 2)
        np.testing.assert_array_equal(rows.x, result.x)
        np.testing.assert_array_equal(rows.mu[:, 0] - rows.mu[:, 1], result.mu[:, 0])
        self.assertTrue((rows.mu >= 0).all() and (rows.mu.min(axis=1) == 0).all())
        np.testing.assert_allclose(rows.w.sum(axis=1), 2, atol=1e-15)
        out = program.run("check", gallery.EXAMPLES / "two_walls/rows.toml").out
        self.assertRegex(out, r"(?m)^two-sided +1 constraint, .* two opposite rows of the scene")

    # ---- shared_input -------------------------------------------------------------------------------

    def test_shared_input(self):
        name = "shared_input/scene.toml"
        scaled = f"{name} --set model.B=[[0,0],[0,0],[1,0],[0,0],[0,0],[0,1]]"
        self.promised(name, "12 unknowns", "1.047 s", "1.731", "0.500", "0.0029", "1.5707", "1.570737")
        self.promised(scaled, "6 unknowns")
        result = self.run_example(name)
        h, t, a, b = result.h, result.t, result.x[:, :3], result.x[:, 3:]
        self.assertEqual(result.summary["unknowns"], 12)
        self.assertEqual((len(result.contacts()), len(result.lift_offs())), (1, 0))
        self.assertAlmostEqual(result.contacts()["t"][0], 1.047)
        self.assertLess(abs(np.pi / 3 - 1.047), h)
        self.assertFalse(result.mu[:, 1].any())
        blow = np.flatnonzero(result.mu[:, 0, 1])
        self.assertEqual(len(blow), 1)
        np.testing.assert_allclose(result.mu[blow[0], 0], [0, 1.731, 0.5], atol=5e-4)
        np.testing.assert_allclose(result.mu[blow[0], 0], [0, np.sqrt(3), 0.5], atol=2 * h)
        np.testing.assert_allclose(result.mu[blow[0] + 1 :, 0, 2], h / 2, rtol=1e-10)
        after = slice(blow[0], None)
        exact = np.column_stack([1.5 + np.cos(t), -np.sin(t), -np.cos(t)])
        self.assertLess(abs(b - exact)[after].max(), 0.0029)
        at = np.rint(1.5 / h).astype(int)
        self.assertAlmostEqual(b[at, 0], 1.5707, delta=5e-5)
        self.assertAlmostEqual(exact[at, 0], 1.570737, delta=5e-7)
        A = np.array([[0, 1, 0], [0, 0, 1], [-1, -1, -1]])
        y = a + 2 * b
        np.testing.assert_allclose(np.diff(y, axis=0), h * (y[1:] @ A.T + [0, 0, -1 + 2 * 2]), atol=1e-14)

        result = self.run_example(scaled)
        self.assertEqual(result.summary["unknowns"], 6)
        np.testing.assert_array_equal(result.x[:, 3:], np.broadcast_to([2, 0, 0], result.x[:, 3:].shape))
        np.testing.assert_allclose(result.mu[-1, 0, 2] / h, 1, rtol=1e-10)

    # ---- all ----------------------------------------------------------------------------------------

    def test_each_scene_gets_only_the_unknowns_it_needs(self):
        for scene, scheme, expected in (
            ("paper65/scene.toml", "homsp", 5),  # outputs are states: no multipliers
            ("forced_contact/scene.toml", "homsp", 5),
            ("section34/example1.toml", "homsp", 3),
            ("section34/example1.toml", "naive-euler", 4),  # lambda itself
            ("section34/example2.toml", "homsp", 3),
            ("section34/example2.toml", "zd-euler", 4),
            ("diode_ladder/scene.toml", "homsp", 8 + 7),  # diodes share capacitors: a current each
            ("diode_ladder/isotonic.toml", "homsp", 8 + 7),
            ("jerk_chain/scene.toml", "homsp", 5 * 2000),
            ("jerk_lattice/scene.toml", "homsp", 5 * 576),
            ("forced_chain/scene.toml", "homsp", 5 * 20),
            ("flexible_chain/scene.toml", "homsp", 4 * 50),
            ("falling_column/scene.toml", "homsp", 2 * (1000 + 1000)),  # contacts share balls: measures of two levels
            ("two_walls/rows.toml", "homsp", 2),
            ("shared_input/scene.toml", "homsp", 6 + 6),
        ):
            path = gallery.EXAMPLES / scene
            outcome = program.run("check", str(path), "--set", f"time.scheme={scheme}")
            self.assertEqual(outcome.code, 0, outcome)
            self.assertRegex(outcome.out, rf"(?m)^unknowns +{expected} ", f"{scene}, {scheme}")

    def test_no_example_is_forgotten(self):
        checks = "".join(path.read_text() for path in Path(__file__).parent.glob("*_test.py"))
        for name, example in self.examples.items():
            self.assertIn(example.scene.removeprefix("examples/"), checks, f"no check of {name}")


def isotonic_regression(values):
    """Pool adjacent violators."""
    blocks = []
    for value in values:
        blocks.append([value, 1])
        while len(blocks) > 1 and blocks[-2][0] > blocks[-1][0]:
            (a, p), (b, q) = blocks[-2:]
            blocks[-2:] = [[(a * p + b * q) / (p + q), p + q]]
    return [mean for mean, count in blocks for _ in range(count)]


def exponential(A, t):
    """exp(A t): Taylor series to rounding on a small step, then squaring."""
    squarings = max(0, int(np.ceil(np.log2(max(1e-300, np.abs(A * t).sum(axis=1).max())))) + 3)
    step = A * (t / 2**squarings)
    term = total = np.eye(len(A))
    for i in range(1, 20):
        term = term @ step / i
        total = total + term
    for _ in range(squarings):
        total = total @ total
    return total


def first_root(A, state, function, end, step=1e-3):
    """First t <= end with function(exp(A t) state) < 0, by stepping and bisection, and the state there."""
    advance, t = exponential(A, step), 0.0
    while function(advance @ state) >= 0:
        state, t = advance @ state, t + step
        if t + step > end:
            return end, exponential(A, end - t) @ state
    low, high = 0.0, step
    while (middle := 0.5 * (low + high)) not in (low, high):
        low, high = (middle, high) if function(exponential(A, middle) @ state) >= 0 else (low, middle)
    return t + high, exponential(A, high) @ state


def forced_contact_exactly(end):
    """Event-driven solution of forced_contact: times of impact and lift-off, and the state at `end`."""
    omega, amplitude = np.pi / 2, 0.1
    free = np.zeros((7, 7))  # z1, x2, x3, xi1, xi2, sin, cos
    free[0, [1, 5]] = 1, amplitude
    free[1, 2] = free[3, 4] = 1
    free[2, [0, 1, 2, 4]] = -1, -1, -1, 1
    free[4, [0, 3]] = 1, -1
    free[5, 6], free[6, 5] = omega, -omega
    held = free.copy()  # z_1 = z_2 = z_3 = 0: x2 = -f, x3 = -f'
    held[:3] = 0
    held[1, 6], held[2, 5] = -amplitude * omega, amplitude * omega**2
    start = np.array([1, 0, 0, 0, 0, 0, 1.0])
    impact, state = first_root(free, start, lambda s: s[0], end)
    if state[1] + amplitude * state[5] >= 0 or state[2] + amplitude * omega * state[6] >= 0:
        raise AssertionError("at this impact z_2 and z_3 should both head out")
    state[:3] = 0, -amplitude * state[5], -amplitude * omega * state[6]
    contact, state = first_root(held, state, lambda s: (held[2] - free[2]) @ s, end - impact)  # lambda
    lift_off = impact + contact
    # At lift-off z_1 = z_2 = z_3 = lambda = 0 and w grows like t^4: no second impact is looked for, and none may come.
    later = [exponential(free, t) @ state for t in np.linspace(0.01, end - lift_off, 400)]
    if min(s[0] for s in later) <= 0:
        raise AssertionError("a second impact")
    return impact, lift_off, (exponential(free, end - lift_off) @ state)[:5]


if __name__ == "__main__":
    unittest.main()
