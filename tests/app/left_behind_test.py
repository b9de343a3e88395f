# ranks: 2
"""Nothing of PETSc's is left behind: -malloc_dump, which tells of every piece of memory not freed by the end, is silent
for every verb and every way to end; on one rank here, on more in left_behind_full_test.py."""

import re
import unittest

import program

LEFT = re.compile(r"^\[ *\d+\] *\d+ bytes .*$", re.MULTILINE)

WALL = """
[time]
scheme = "moreau-jean"
end = 0.1
step = 1e-2
[model]
kind = "chain"
element = "wall"
count = 5
"""
JERK = WALL.replace("moreau-jean", "homsp").replace("wall", "jerk")
OSCILLATORS = WALL.replace("moreau-jean", "zhuravlev-ivanov").replace("wall", "zhuravlev-ivanov")
SWEEPING = """
[time]
end = 0.1
step = 1e-2
[model]
kind = "sweeping"
u0 = [0, 0]
G = [[1, 0], [1, 1]]
g = [{amplitude = 1, frequency = 1}, -1]
"""
# From inside K, which is empty a quarter of a second later.
EMPTY = SWEEPING.replace("end = 0.1", "end = 1").replace("[[1, 0], [1, 1]]", "[[1, 0], [-1, 0]]").replace("-1]\n", "-0.5]\n")
PROBLEM = "[problem]\nM = [[2, 1], [1, 2]]\nq = [-5, 6]\n"

# name: exit code, verb, input, further words
CASES = {
    "wall": (0, "run", WALL, []),
    "jerk": (0, "run", JERK, []),
    "jerk primal-dual": (0, "run", JERK, ["-sweepvi_form", "primal-dual"]),
    "oscillators": (0, "run", OSCILLATORS, []),
    "sweeping": (0, "run", SWEEPING, []),
    "check": (0, "check", JERK, []),
    "help of a scene": (0, "run", WALL, ["-help"]),
    "solve": (0, "solve", PROBLEM, []),
    "wrong scene": (2, "run", WALL.replace("count = 5", "count = -5"), []),
    "wrong model": (2, "run", SWEEPING.replace("u0 = [0, 0]", "u0 = [0]"), []),
    "wrong form": (2, "check", WALL, ["-sweepvi_form", "box-on-z"]),
    "wrong problem": (2, "solve", PROBLEM.replace("-5", "nan"), []),
    "no step": (3, "run", EMPTY, []),
    "no solution": (3, "solve", PROBLEM.replace("[[2, 1], [1, 2]]", "[[0, 0], [0, 0]]"), []),
    "no folder": (5, "run", WALL, ["-o", "missing/a.h5"]),
}


class LeftBehind(unittest.TestCase):
    def at(self, ranks, cases):
        def play(name):
            code, verb, text, words = CASES[name]
            with program.temporary_folder() as folder:
                (program.Path(folder) / "input.toml").write_text(text)
                words = [verb, "input.toml", *words, "-malloc_debug", "-malloc_dump", "-malloc_view"]
                return program.run(*words, ranks=ranks, cwd=folder, timeout=60)

        for name, outcome in zip(cases, program.run_all(play, cases, ranks)):
            with self.subTest(name, ranks=ranks):
                self.assertEqual(outcome.code, CASES[name][0], outcome)
                said = outcome.out + outcome.err
                self.assertIn("Maximum memory PetscMalloc()ed", said, "PETSc does not count memory")
                self.assertEqual(LEFT.findall(said), [], outcome.command)

    def test_on_one_rank(self):
        self.at(1, list(CASES))

    def test_on_two_ranks(self):
        self.at(2, ["wall", "wrong model"])


if __name__ == "__main__":
    unittest.main()
