# Balls in contact in the `linear` form, and columns of balls that land one by one: many constraints that share their
# inputs, all of them active at once, with solutions in closed form.
#
# ranks: 2
# timeout: 240
import numpy as np
from chain_runs import Verdict, homsp, program, run, write_scene

BALLS = 1000
SPEED = 1.0
# Impulses are sums of up to N numbers of order 1, and the condition of M is of order N^2 = 1e6; a stable factorization of
# a diagonally dominant tridiagonal matrix does not feel it. 2e-15 was measured; 1e-12 still shows one wrong ball (1e-3).
TOLERANCE = 1e-12
NEWTON = 3  # 2 were measured: the set is found at once, the second one confirms it


def write_matrix(path, rows, columns, entries):
    with path.open("w") as file:
        file.write(f"%%MatrixMarket matrix coordinate real general\n{rows} {columns} {len(entries)}\n")
        file.writelines(f"{row + 1} {column + 1} {value:.17g}\n" for row, column, value in entries)


def write_balls(folder):
    """Ball k has the states q_k, v_k; constraint k is q_{k+1} - q_k >= 0. The first ball hits the others, all touching."""
    n, m = 2 * BALLS, BALLS - 1
    write_matrix(folder / "A.mtx", n, n, [(2 * k, 2 * k + 1, 1.0) for k in range(BALLS)])
    pushes = [(2 * k + 1, k, -1.0) for k in range(m)] + [(2 * k + 3, k, 1.0) for k in range(m)]
    write_matrix(folder / "B.mtx", n, m, pushes)
    reads = [(k, 2 * k, -1.0) for k in range(m)] + [(k, 2 * k + 2, 1.0) for k in range(m)]
    write_matrix(folder / "C.mtx", m, n, reads)
    x0 = np.zeros(n)
    x0[1] = SPEED
    model = {"kind": "linear", **{key: f"{key}.mtx" for key in "ABC"}, "x0": x0.tolist()}
    return write_scene(folder, "balls", homsp(0.01, 0.01), model)


def test_touching(folder, verdict):
    """Moreau's law with e = 0: all go on with v / N, and the impulse between balls k and k + 1 is v (N - k) / N."""
    scene = write_balls(folder)
    velocity = np.full(BALLS, SPEED / BALLS)
    impulse = SPEED * (BALLS - np.arange(1, BALLS)) / BALLS
    for ranks in (1, 2):
        for predictor in ("none", "active-set"):
            options = ["-snes_type", "vinewtonrsls", "-sweepvi_predictor", predictor]
            file, summary = run(scene, ranks, options, name=f"balls_{predictor}")
            error = max(
                np.abs(file["x"][1, 1::2] - velocity).max(),
                np.abs(file["x"][1, ::2] - 0.01 * velocity).max(),
                np.abs(file["mu"][1, :, 1] - impulse).max(),
                np.abs(file["w"][1]).max(),
            )
            newton = summary["snes_iterations"]
            verdict.expect(
                error <= TOLERANCE and newton <= NEWTON and summary["rungs"]["predictor"] + summary["rungs"]["chosen"] == 1,
                f"{BALLS} touching balls, {ranks} ranks, predictor {predictor}: error {error:.1e}, {newton} iterations,"
                f" {summary['seconds_stepping']:.2f} s",
            )
            verdict.expect(
                (file["level"][1] == 2).all() and len(file["events"]) == 1, "all on level 2, one impact (of the first ball)"
            )


def test_column(folder, count, step, ranks, verdict):
    """Ball i falls freely over 0.1 + 0.05 i, then stops: on the ground, or on the balls at rest below it."""
    gravity = 1.0
    landing = np.sqrt(2.0 * (0.1 + 0.05 * np.arange(count)) / gravity)
    end = step * np.ceil(landing[-1] / step + 3)
    file, summary = run(
        write_scene(folder, f"column{count}", homsp(float(end), step), {"kind": "chain", "element": "contact", "count": count}),
        ranks,
    )
    times, x = file["t"][:], file["x"][:]
    q, v = x[:, :count], x[:, count:]
    stands = np.abs(v) <= 1e-9  # speeds are of order 1; in a column at rest, rounding
    landed = q - np.arange(count) <= 1e-9
    # Always after the last row in which it did not: what is down stays down.
    after = lambda done: np.array([times[np.flatnonzero(~done[:, i])[-1] + 1] for i in range(count)]) - landing
    contact, rest = after(landed), after(stands)
    # q_k = q_0 - g t_k (t_k + h) / 2 is down h / 2 early, which shows at the end of a step; level 2 of the next one stops
    # the velocity.
    verdict.expect(
        np.abs(contact).max() <= step and np.allclose(rest - contact, step),
        f"{count} balls touch {contact.min() / step:.2f} h to {contact.max() / step:.2f} h after the exact time and stop in the"
        f" next step: {len(times) - 1} steps, {summary['snes_iterations']} iterations,"
        f" {summary['seconds_stepping']:.1f} s, {ranks} ranks",
    )
    fallen = q[0] - 0.5 * gravity * times[:, None] * (times[:, None] + step)
    flight = np.abs(np.where(q > np.arange(count) + 1e-9, q - fallen, 0.0)).max()
    # 1000 additions of h v to numbers of size up to count
    verdict.expect(flight <= 1e-11 * count, f"until then they fall freely: {flight:.1e}")
    settled = np.abs(q[-1] - np.arange(count)).max()
    verdict.expect(settled <= 1e-12 * count and stands[-1].all(), f"and rest on each other: {settled:.1e}")
    # Ball i carries all above it: h m g (count - i) per step.
    load = np.abs(file["mu"][-1, :, 1] - step * gravity * (count - np.arange(count))).max()
    verdict.expect(load <= 1e-11 * count, f"each carries those above it: {load:.1e}")
    verdict.expect(summary["max_penetration"] == 0.0, f"penetration {summary['max_penetration']:.1e}")


def main():
    verdict = Verdict()
    with program.temporary_folder() as name:
        folder = program.Path(name)
        test_touching(folder, verdict)
        for ranks in (1, 2):
            test_column(folder, 100, 0.01, ranks, verdict)
    verdict.exit()


if __name__ == "__main__":
    main()
