"""Runs examples/petsc4py/paper65.py: where right it is sweepvi's homsp, and its traps are what the gallery says."""
# ranks: 1
# timeout: 180

import importlib.util
import json
import subprocess
import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "app"))
import program

FOLDER = program.SOURCE / "examples"
SCRIPT = FOLDER / "petsc4py" / "paper65.py"
REFERENCE = Path(__file__).resolve().parents[1] / "reference" / "order65.json"

spec = importlib.util.spec_from_file_location("paper65", SCRIPT)
paper65 = importlib.util.module_from_spec(spec)
spec.loader.exec_module(paper65)
from petsc4py import PETSc  # after paper65: its import is part of the example


def sweepvi(steps, unit=1.0):
    """States of the scene with this many steps, in this unit."""
    with program.temporary_folder() as folder:
        file = Path(folder) / "run.h5"
        outcome = program.run(
            "run", FOLDER / "paper65" / "scene.toml", "--set", f"time.step={paper65.END / steps!r}",
            "--set", f"model.x0=[{unit!r}, 0, 0, 0, 0]", "-o", file,
        )  # fmt: skip
        if outcome.code != 0:
            raise AssertionError(str(outcome))
        with h5py.File(file) as data:
            return data["x"][:] / unit


class Petsc4py(unittest.TestCase):
    def trap(self, name, steps):
        """Its final error; every step of it is one that PETSc calls converged."""
        run = paper65.march(paper65.TRAPS[name], steps)
        self.assertEqual(sum(run.verdict.values()), steps, name)
        self.assertTrue(all(reason.startswith("CONVERGED_") for reason in run.verdict), run.verdict)
        return run.error(steps)

    def test_levels_and_mask_are_sweepvis_homsp(self):
        known = {row["N"]: row["final_2"] for row in json.loads(REFERENCE.read_text())}
        for steps in (100, 333, 946, 1000):
            run, ours = paper65.march(paper65.RIGHT, steps), sweepvi(steps)
            # Rounding of the size of 1e-16 a step, and the system's own growth.
            self.assertLess(abs(run.x - ours).max(), 1e-12 * abs(ours).max(), f"{steps} steps")
            if steps in known:
                self.assertAlmostEqual(run.error(steps), known[steps], delta=1e-9)
            semismooth = paper65.march(paper65.SEMISMOOTH, steps)  # to the 1e-8 of SNES's tolerances, step by step
            self.assertLess(abs(semismooth.x - ours).max(), 1e-6, f"{steps} steps")

    def test_errors_that_do_not_go_away(self):
        for steps in (100, 1000):
            self.assertGreater(self.trap("bound on z_1 alone", steps), 0.45)
            self.assertGreater(self.trap("levels, `theta` as it comes (1/2)", steps), 1.0)
            self.assertGreater(self.trap("levels, `cn`, semismooth", steps), 2.5)
        self.assertGreater(self.trap("lambda an unknown, semismooth", 100), 5)
        self.assertGreater(self.trap("lambda an unknown, semismooth", 1000), 1000)

    def test_1e30_is_not_infinity(self):
        run = paper65.march(paper65.TRAPS["levels, semismooth, 1e30 for infinity"], 100)
        self.assertEqual(run.verdict, {"CONVERGED_FNORM_ABS": 100})
        self.assertTrue((run.x == run.x[0]).all(), "nothing moves")

    def test_units(self):
        self.assertGreater(self.trap("levels, unit 1e-6", 1000), 0.45)
        np.testing.assert_allclose(sweepvi(1000, 1e-6), sweepvi(1000), atol=1e-11)
        database = PETSc.Options()
        database["snes_vi_zero_tolerance"] = 0
        self.addCleanup(database.delValue, "snes_vi_zero_tolerance")
        self.assertLess(self.trap("levels, unit 1e-6", 1000), 0.0983)

    def test_crank_nicolson_with_reduced_space_is_of_order_two(self):
        errors = [self.trap("levels, `cn`, reduced space", steps) for steps in (100, 1000)]
        self.assertAlmostEqual(np.log10(errors[0] / errors[1]), 2, delta=0.05)

    def test_residue_decides_on_contact(self):
        counts = range(100, 200, 3)
        changed, missed, verdict = paper65.residue(counts)
        # Which ones is up to rounding, and that to the processor; of the 100 numbers of the gallery 37 and 17.
        self.assertGreater(len(missed), 0)
        self.assertGreaterEqual(changed, len(missed))
        self.assertEqual(sum(verdict.values()), sum(counts))
        self.assertTrue(all(reason.startswith("CONVERGED_") for reason in verdict), verdict)
        steps, error, masked = missed[0]
        self.assertGreater(error, masked + 0.1)
        self.assertLess(abs(paper65.march(paper65.RIGHT, steps).x - sweepvi(steps)).max(), 1e-12 * 3)  # states below 3

    def test_semismooth_applies_the_right_hand_side_too_late(self):
        """0 <= u _|_ u - b >= 0 has the solution max(0, b); a TS of type cn passes such b."""
        for snes_type, found in (("vinewtonrsls", (1, 0)), ("vinewtonssls", (1 + 0.5**0.5, 0.5**0.5 - 1))):
            for b, expected in zip((1, -1), found):
                snes = PETSc.SNES().create(PETSc.COMM_SELF)
                u, right, lower, upper = (PETSc.Vec().createSeq(1) for _ in range(4))
                J = PETSc.Mat().createAIJ((1, 1), nnz=1, comm=PETSc.COMM_SELF)
                J.setUp()

                def jacobian(snes, u, J, P):
                    P[0, 0] = 1
                    P.assemble()

                snes.setType(snes_type)
                snes.setFunction(lambda snes, u, F: u.copy(F), u.duplicate())
                snes.setJacobian(jacobian, J)
                upper.set(PETSc.INFINITY)
                snes.setVariableBounds(lower, upper)
                right.set(b)
                snes.solve(right, u)
                self.assertGreater(snes.reason, 0)
                self.assertAlmostEqual(u[0], expected, delta=1e-6, msg=f"{snes_type}, b = {b}")

    def test_the_script(self):
        command = [sys.executable, SCRIPT, "--steps", "1e-1", "--repeats", "1", "--sweepvi", program.PROGRAM]
        done = subprocess.run(command, capture_output=True, text=True, timeout=100)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertRegex(done.stdout, r"(?m)^\| 1e-01 \| 100 \| 0\.888 \| [1-9]e-1[3-6] \|")
        for name in paper65.TRAPS:
            self.assertIn(f"\n| {name} |", done.stdout)


if __name__ == "__main__":
    unittest.main()
