"""What is not as it was asked for is told: in the last lines of a run, in its summary and in its file, with how often.
And what is no departure at all: a wave whose front decays below the range of numbers."""
# ranks: 1

import unittest
from pathlib import Path

import h5py
import numpy as np
import scipy.io
import scipy.sparse as sp

from program import read_json, run, temporary_folder

# h times the first state's rate is 1: a step has no matrix to solve with, half of one has. Beside it a falling mass.
SINGULAR = """
[time]
scheme = "homsp"
end = 4.0
step = 0.5
[model]
kind = "linear"
A = [[2, 0, 0], [0, 0, 1], [0, 0, 0]]
B = [[0], [0], [1]]
C = [[0, 1, 0]]
f = [0, 0, -2]
x0 = [1, 1, 0]
"""


def beads(folder, count, steps, h):
    """`count` masses of .01 kg that touch, one-sided springs of 1e7 N/m between them (r = 0, D = 1/k), the first struck."""
    gaps = sp.diags([-np.ones(count - 1), np.ones(count - 1)], [0, 1], shape=(count - 1, count)).tocsr()
    zero = sp.csr_matrix((count, count))
    velocity = np.zeros(count)
    velocity[0] = 1.0
    matrices = {
        "A": sp.bmat([[zero, sp.eye(count)], [zero, zero]]),
        "B": sp.vstack([sp.csr_matrix((count, count - 1)), gaps.T / 0.01]),
        "C": sp.hstack([gaps, sp.csr_matrix((count - 1, count))]),
        "D": sp.eye(count - 1) / 1e7,
        "x0": sp.coo_matrix(np.concatenate([np.zeros(count), velocity]).reshape(-1, 1)),
    }
    for name, matrix in matrices.items():
        scipy.io.mmwrite(folder / f"{name}.mtx", sp.coo_matrix(matrix), precision=17)
    (folder / "beads.toml").write_text(
        f'[time]\nscheme = "homsp"\nend = {steps * h}\nstep = {h}\n[model]\nkind = "linear"\n'
        + "".join(f'{name} = "{name}.mtx"\n' for name in matrices)
    )
    return gaps.toarray()


def independent_beads(gaps, steps, h):
    """The implicit steps 0 <= H q + lambda / k _|_ lambda >= 0 by an active-set iteration, dense."""
    count = gaps.shape[1]
    q, v = np.zeros(count), np.zeros(count)
    v[0] = 1.0
    matrix = h * h / 0.01 * gaps @ gaps.T + np.eye(count - 1) / 1e7
    active = np.zeros(count - 1, bool)
    for _ in range(steps):
        right = -(gaps @ (q + h * v))
        while True:
            force = np.zeros(count - 1)
            inside = np.flatnonzero(active)
            force[inside] = np.linalg.solve(matrix[np.ix_(inside, inside)], right[inside])
            again = np.where(active, force > 0, matrix @ force - right < 0)
            if (again == active).all():
                break
            active = again
        v = v + h / 0.01 * (gaps.T @ force)
        q = q + h * v
    return q, v


def told(outcome, summary, file):
    """The notes of a run, which are the same in all three places."""
    notes = read_json(summary)["notes"]
    printed = [line[len("note: ") :] for line in outcome.out.splitlines() if line.startswith("note: ")]
    assert printed == [note["text"] for note in notes], outcome
    with h5py.File(file) as recorded:
        assert recorded.attrs["notes"] == "\n".join(printed), recorded.attrs["notes"]
    return {note["kind"]: note for note in notes}


class Notes(unittest.TestCase):
    def setUp(self):
        self.folder = temporary_folder()
        self.addCleanup(self.folder.cleanup)
        self.path = Path(self.folder.name)

    def go(self, scene, *words, ranks=1):
        outcome = run("run", scene, "-o", self.path / "o.h5", "--force", "--summary", self.path / "s.json", *words, ranks=ranks)
        self.assertEqual(outcome.code, 0, outcome)
        return told(outcome, self.path / "s.json", self.path / "o.h5")

    def scene(self, text):
        path = self.path / "scene.toml"
        path.write_text(text)
        return path

    def test_steps_in_parts(self):
        scene = self.scene(SINGULAR)
        for ranks in (1, 2):
            notes = self.go(scene, ranks=ranks)
            self.assertEqual(set(notes), {"smaller_step"})
            self.assertEqual(notes["smaller_step"]["count"], 8)
            self.assertIn("8 of 8 steps could only be solved in parts, 2 at most", notes["smaller_step"]["text"])
        self.assertEqual(self.go(scene, "--set", "time.step=0.25"), {})

    # What was told before a stop is told after going on.
    def test_going_on(self):
        scene = self.scene(SINGULAR.replace("[[2, 0", "[[4, 0").replace("step = 0.5", "step = 0.25"))
        stopped = run("run", scene, "-o", self.path / "first.h5", "--wall-limit", "1e-9")
        self.assertEqual(stopped.code, 4, stopped)
        notes = self.go(scene, "--restart", self.path / "first.h5")
        self.assertEqual(notes["smaller_step"]["count"], 16)

    def test_study(self):
        scene = self.scene(SINGULAR)
        outcome = run("study", scene, "--steps", "0.5,0.25", "--repeats", "1", "--csv", self.path / "study.csv")
        self.assertEqual(outcome.code, 0, outcome)
        self.assertIn("8 (8 in parts)", outcome.out)
        lines = [line.split(",") for line in (self.path / "study.csv").read_text().splitlines()]
        column = lines[0].index("steps_in_parts")
        self.assertEqual([line[column] for line in lines[1:]], ["8", "0"])

    def test_step_that_does_not_divide_the_run(self):
        notes = self.go(self.scene(SINGULAR), "--set", "time.step=0.3")
        self.assertEqual(set(notes), {"step_adjusted"})
        self.assertIn("0.3 s does not divide the run: steps of 0.307692 s instead", notes["step_adjusted"]["text"])
        # 4 / 0.1 is 40 up to rounding: nothing to tell.
        self.assertEqual(self.go(self.scene(SINGULAR), "--set", "time.step=0.1"), {})

    # Contacts far from the blow move by less than the smallest number there is: residuals down there are no measure of
    # anything, and no step may be cut for them. A longer row of beads, whose far end stays at exactly 0, moves alike.
    def test_wave_that_decays_below_the_range_of_numbers(self):
        steps, h = 5, 1e-5
        gaps = beads(self.path, 290, steps, h)
        q, v = independent_beads(gaps, steps, h)
        self.assertLess(np.min(np.abs(v[v != 0.0])), 1e-300)  # or the scene does not show what it is for
        expected = np.concatenate([q, v])
        for ranks in (1, 2):
            self.assertEqual(self.go(self.path / "beads.toml", ranks=ranks), {})
            with h5py.File(self.path / "o.h5") as file:
                short = file["x"][-1]
            # Both solve a chain of 290 well-conditioned rows: rounding of the largest velocity, 1 m/s.
            np.testing.assert_allclose(short, expected, rtol=0.0, atol=1e-14)
        beads(self.path, 2900, steps, h)
        self.assertEqual(self.go(self.path / "beads.toml"), {})
        with h5py.File(self.path / "o.h5") as file:
            long = file["x"][-1].reshape(2, -1)
        # But for the last bead of the short row, which nothing holds from behind.
        np.testing.assert_allclose(long[:, :200], short.reshape(2, -1)[:, :200], rtol=0.0, atol=1e-14)


if __name__ == "__main__":
    unittest.main()
