"""Runs of impact oscillators, and the discrete equations that every step must satisfy."""

import os
from dataclasses import dataclass
from pathlib import Path

import h5py
import numpy as np
import program


@dataclass
class Result:
    """What a run recorded; N oscillators."""

    h: float
    t: np.ndarray
    x: np.ndarray  # [row, 2 N]: all x, all x'
    z: np.ndarray  # [row, 2 N]: all s, all v
    signs: np.ndarray  # [row, N, 2]: lambda_s, lambda_v
    energy: np.ndarray  # [row, 3]: kinetic, potential, dissipated
    events: np.ndarray
    summary: dict

    def impacts(self):
        return self.events[self.events["kind"] == 0]

    def rest(self):
        """From when on each oscillator rests, s = v = 0."""
        s, v = np.split(self.z, 2, axis=1)
        moves = (s != 0) | (v != 0)
        assert not moves[-1].any(), "something still moves at the end"
        return self.t[len(moves) - np.argmax(moves[::-1], axis=0)]


def run(folder, example, *more, ranks=None, timeout=100):
    """Runs an example, with more words for the program, and reads its file."""
    name = f"run{os.urandom(4).hex()}"
    file, summary = Path(folder) / f"{name}.h5", Path(folder) / f"{name}.json"
    outcome = program.run(
        "run", *example.words, *more, "-o", file, "--summary", summary,
        ranks=ranks or example.ranks, cwd=program.SOURCE, timeout=timeout,
    )  # fmt: skip
    if outcome.code != 0:
        raise AssertionError(str(outcome))
    with h5py.File(file) as data:
        np.testing.assert_array_equal(data["w"], data["x"][:, : data["w"].shape[1]])
        return Result(
            float(data.attrs["step"]), data["t"][:], data["x"][:], data["z"][:], data["lambda"][:], data["energy"][:],
            data["events"][:], program.read_json(summary),
        )  # fmt: skip


def audit(result, kappa, acceleration, mu=(0.0, 0.0)):
    """Checks every step, all recorded, against HO (12), (13), corrected, and (9): implicit, theta = gamma = 1.

    `acceleration(t, x)` of all oscillators. Rounding is judged against the terms of each equation; s counts as known up
    to the terms of v, through which it is found.
    """
    s, v = np.split(result.z, 2, axis=1)
    h = result.h
    worst = 0.0
    for k in range(len(result.t) - 1):
        ls, lv = result.signs[k + 1].T
        R = 1 - kappa * ls * lv
        a = acceleration(result.t[k + 1], abs(s[k + 1]))
        push = (ls * (a - mu[0]) - lv * mu[1]) / R
        terms_v = abs(v[k + 1]) + abs(v[k]) + h / R * (abs(a) + sum(mu)) * (1 + kappa) / R
        terms_s = abs(s[k + 1]) + abs(s[k]) + h * (1 + kappa) * terms_v
        worst = max(worst, (abs(v[k + 1] - v[k] - h * push) / terms_v).max())
        worst = max(worst, (abs(s[k + 1] - s[k] - h * R * v[k + 1]) / terms_s).max())
        for value, sign in ((s[k + 1], ls), (v[k + 1], lv)):
            assert (abs(sign) <= 1).all(), f"step {k + 1}: a sign is not in [-1, 1]"
            moving = value != 0
            assert (sign[moving] == np.sign(value[moving])).all(), f"step {k + 1}: a sign is not that of its variable"
        # HO (1): nothing stays at rest where the acceleration points away from the wall.
        resting = (s[k + 1] == 0) & (v[k + 1] == 0)
        assert (np.broadcast_to(a, s[k + 1].shape)[resting] <= sum(mu)).all(), f"step {k + 1}: rests against its force"
        # HO section II, and the velocity after the impact where s = 0.
        side = np.where(s[k + 1] != 0, np.sign(s[k + 1]), np.sign(v[k + 1]))
        velocity = (1 - kappa * side * np.sign(v[k + 1])) * v[k + 1] * side
        physical = np.concatenate([abs(s[k + 1]), velocity])
        np.testing.assert_allclose(result.x[k + 1], physical, rtol=1e-14, atol=0)
    assert worst < 1e-12, f"equations hold only to {worst:.2g} of their terms"
