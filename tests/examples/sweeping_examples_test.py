"""The sweeping processes of examples/ against closed forms and an event-driven solution."""
# ranks: 1

import unittest

import gallery
import numpy as np
import program

R = 0.5  # half-width of play and stop


def words(example):
    return " ".join([example.scene.removeprefix("examples/"), *example.words[1:]])


def play(y, r):
    """The play of an input that is monotone between its entries, from u = 0."""
    u = [0.0]
    for value in y[1:]:
        u.append(min(max(u[-1], value - r), value + r))
    return np.array(u)


def loop_area(y, u):
    return abs(np.sum((y[1:] + y[:-1]) / 2 * np.diff(u)))


class SweepingExamples(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.examples = {words(example): example for example in gallery.examples()}
        folder = program.temporary_folder()
        cls.addClassCleanup(folder.cleanup)
        cls.folder = folder.name

    def run_example(self, name, **options):
        result = gallery.run(self.folder, self.examples[name], **options)
        self.assertEqual(result.summary["max_penetration"], 0.0)
        self.assertTrue((result.level[0] == 0).all() and (result.level[1:] == 1).all())
        np.testing.assert_array_equal(result.mu[:, :, 0] * np.where(np.isfinite(result.w), result.w, 0), 0)
        return result

    def promised(self, name, *texts):
        for text in texts:
            self.assertIn(text, self.examples[name].expect)

    def test_play_operator(self):
        name = "play_operator/scene.toml"
        self.promised(name, "4e-15", "pushes it by 6", "area 2.9974")
        result = self.run_example(name)
        t, u, mu = result.t, result.x[:, 0], result.mu[:, 0, 0]
        y = 2 * np.sin(2 * np.pi * t)
        exact = np.where(t <= 0.25, np.maximum(0, y - R), 0)
        phase = t % 1.0
        falls = (t > 0.25) & (phase > 0.25 + 1e-9) & (phase < 0.75 - 1e-9)
        exact = np.where(t <= 0.25 + 1e-9, exact, np.where(falls, np.minimum(1.5, y + R), np.maximum(-1.5, y - R)))
        exact[np.isclose(phase, 0.25)] = 1.5
        exact[np.isclose(phase, 0.75)] = -1.5
        np.testing.assert_allclose(u, exact, atol=4e-15)
        np.testing.assert_allclose(np.diff(u), mu[1:], atol=1e-15)
        self.assertTrue((mu[1:][falls[1:]] <= 0).all())
        for cycle in range(3):
            rows = slice(25 + 100 * cycle, 126 + 100 * cycle)
            self.assertAlmostEqual(abs(np.diff(u[rows])).sum(), 6, delta=1e-13)
            self.assertAlmostEqual(loop_area(y[rows], u[rows]), 2.9974, delta=5e-5)

    def test_stop_operator(self):
        names = ["stop_operator/scene.toml", "stop_operator/scene.toml --set time.step=1e-3"]
        self.promised(names[0], "0.0528", "3.0722", "1e-13")
        self.promised(names[1], "0.0055", "3.0077")
        for name, error, area in zip(names, (0.0528, 0.0055), (3.0722, 3.0077)):
            result = self.run_example(name)
            t, s, h, w = result.t, result.x[:, 0], result.h, 2 * np.pi
            y = 2 * np.sin(w * t)
            summed = 2 * w * h * (np.sin(w * t + w * h / 2) - np.sin(w * h / 2)) / (2 * np.sin(w * h / 2))
            np.testing.assert_allclose(s, summed - play(summed, R), atol=1e-13)
            yields = result.mu[:, 0, 0] != 0
            self.assertGreater(np.count_nonzero(yields), 100)
            self.assertTrue((abs(s[yields]) == R).all())
            worst = abs(s - (y - play(y, R))).max()
            self.assertLess(worst, error)
            self.assertGreater(worst, 0.98 * error)
            begin, cycle = round(0.25 / h), round(1 / h)
            rows = slice(begin, begin + cycle + 1)
            self.assertAlmostEqual(loop_area(y[rows], s[rows]), area, delta=5e-5)

    def test_moving_polygon(self):
        names = ["moving_polygon/scene.toml", "moving_polygon/scene.toml --set time.step=1e-2"]
        self.promised(names[0], "1e-14", "0.0431", "0.2050", "from 0.25 s", "(sqrt 3, 1/sqrt 3 - 1)")
        self.promised(names[1], "3.8e-4")
        result = self.run_example(names[0])
        exact, starts = pushed_by_polygon(result.t)
        np.testing.assert_allclose(result.x, exact, atol=1e-14)
        np.testing.assert_allclose(starts[1:4], [0.0431, 0.2050, 0.25], atol=5e-5)
        np.testing.assert_allclose(result.x[-1], [np.sqrt(3), 1 / np.sqrt(3) - 1], atol=1e-14)
        np.testing.assert_allclose(result.x[150:], result.x[30:-120], atol=1e-14)  # 0.25 s is row 30, a second 120
        coarse = self.run_example(names[1])
        exact, _ = pushed_by_polygon(coarse.t)
        worst = abs(coarse.x - exact).max()
        self.assertLess(worst, 3.8e-4)
        self.assertGreater(worst, 3.7e-4)

    def test_sweeping_chain(self):
        name = "sweeping_chain/scene.toml"
        self.promised(name, "1e-14", "0.4549 s", "u_i = 1 + 0.01 i")
        for ranks in (1, 2):
            result = self.run_example(name, ranks=ranks)
            i, t, h = np.arange(100), result.t, result.h
            height = np.sin(np.pi * np.minimum(t, 0.5))[:, None]
            np.testing.assert_allclose(result.x, np.maximum(0.02 * i, height + 0.01 * i), atol=1e-14)
            carried = np.diff(result.x, axis=0)[:, ::-1].cumsum(axis=1)[:, ::-1]
            np.testing.assert_allclose(result.mu[1:, :, 0], carried, atol=1e-14 * 100)  # sums of up to 100 of them
            self.assertTrue((result.w[t <= 0.5, 0] == 0).all())
            contacts = result.contacts()
            self.assertEqual(sorted(contacts["constraint"]), list(range(1, 100)))  # face 0 is closed from the start
            late = contacts["t"] - np.arcsin(0.01 * contacts["constraint"]) / np.pi
            self.assertTrue((late >= 0).all() and (late <= h).all())
            self.assertAlmostEqual(np.arcsin(0.99) / np.pi, 0.4549, delta=1e-4)
            self.assertEqual(list(result.lift_offs()["constraint"]), [0])
            self.assertAlmostEqual(result.lift_offs()["t"][0], 0.5 + h, delta=1e-9)
            self.assertEqual(result.summary["ranks"], ranks)
            if ranks == 2:
                self.assertEqual(result.summary["edge_cut"], 1)


def first_time(function, t, step=1e-3, offset=1e-6):
    """When `function`, >= 0 right after t, becomes negative: by stepping and bisection."""
    later = t + offset
    while function(later) >= 0 and later < 10:
        later += step
    low, high = max(t, later - step), later
    while (middle := 0.5 * (low + high)) not in (low, high):
        low, high = (middle, high) if function(middle) >= 0 else (low, middle)
    return low


def pushed_by_polygon(times, radius=2.0, rho=0.5, sides=6):
    """Event-driven solution: where the point is at `times`, and when sides and corners take it over in turn.

    On a side the point keeps its place along the side and is pushed along its normal; a corner carries it.
    """
    w, length = 2 * np.pi, 2 * rho * np.tan(np.pi / sides)
    angle = 2 * np.pi * np.arange(sides) / sides
    normal = np.column_stack([np.cos(angle), np.sin(angle)])  # outward
    along = np.column_stack([-np.sin(angle), np.cos(angle)])
    centre = lambda t: radius * np.array([np.cos(w * t), np.sin(w * t)])
    push = lambda t: radius * w * np.array([np.sin(w * t), -np.cos(w * t)])  # -c'
    rest = centre(0.0)
    reached = [first_time(lambda t: rho - normal[i] @ (rest - centre(t)), 0.0) for i in range(sides)]
    side = int(np.argmin(reached))
    starts, phases, t, point = [0.0], [lambda t: rest], reached[side], rest
    while t < times[-1]:
        place = along[side] @ point
        on_side = lambda t, i=side, s=place: s * along[i] + (normal[i] @ centre(t) + rho) * normal[i]
        offset = lambda t: along[side] @ (on_side(t) - centre(t))
        starts.append(t)
        phases.append(on_side)
        corner = first_time(lambda t: length / 2 - offset(t), t)
        if min(first_time(lambda t: normal[side] @ push(t), t), first_time(lambda t: offset(t) + length / 2, t)) < corner:
            raise AssertionError("the point should reach the next corner first")
        starts.append(corner)
        phases.append(lambda t, v=rho * normal[side] + length / 2 * along[side]: centre(t) + v)
        side = (side + 1) % sides
        t = first_time(lambda t: -along[side] @ push(t), corner)  # -c' leaves the cone of the corner's normals
        point = phases[-1](t)
    place = np.searchsorted(starts, times, side="right") - 1
    return np.array([phases[k](t) for k, t in zip(place, times)]), np.array(starts)


if __name__ == "__main__":
    unittest.main()
