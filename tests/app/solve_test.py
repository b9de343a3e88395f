# ranks: 2
# timeout: 240
"""`sweepvi solve` on random box VIs, judged by numpy: the natural residual of /solution, and the solution it was built
around; a P-matrix leaves no other."""

import sys
import unittest
from pathlib import Path

import h5py
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))
import program

SEED = 20240607
CERTIFICATE = 1e-10  # worst natural residual over row terms, the program's default
ROUNDING = 100 * np.finfo(float).eps  # numpy adds the row up in another order


# Matrices ------------------------------------------------------------------------------------------------------------


def positive_definite(rng, n):
    """Nonsymmetric: the skew part is as large as the symmetric one."""
    g, s = rng.normal(size=(2, n, n))
    return g @ g.T / n + 0.1 * np.eye(n) + (s - s.T) / 2


def m_matrix(rng, n):
    off = -rng.random((n, n)) * (rng.random((n, n)) < 0.5)
    np.fill_diagonal(off, 0)
    return off + np.diag(-off.sum(axis=1) + rng.uniform(0.05, 1, n))


def h_matrix(rng, n):
    """Dominant after a scaling of the columns, signs mixed."""
    off = rng.normal(size=(n, n))
    np.fill_diagonal(off, 0)
    return (off + np.diag(abs(off).sum(axis=1) + rng.uniform(0.05, 1, n))) * rng.uniform(0.1, 10, n)


def murty(rng, n):
    """1 on the diagonal, 2 below it: the P-matrix on which pivoting methods take 2^n steps, thinned out here."""
    return np.eye(n) + 2 * np.tril(rng.random((n, n)) < min(1, 4 / n), -1)


def cyclic(rng, n):
    """Newton-min goes round in circles on such blocks (Ben Gharbia and Gilbert 2012): P-matrices, not H."""
    matrix = np.eye(n)
    for i in range(0, n - n % 3, 3):
        for j in range(3):
            matrix[i + j, i + (j + 1) % 3] = rng.uniform(1.1, 3)
    return matrix


def badly_scaled(rng, n):
    rows, columns = 10 ** rng.uniform(-3, 3, (2, n))
    return rows[:, None] * positive_definite(rng, n) * columns


WELL_CONDITIONED = {"positive_definite", "m_matrix", "h_matrix"}
KINDS = [positive_definite, m_matrix, h_matrix, murty, cyclic, badly_scaled]


# Problems ------------------------------------------------------------------------------------------------------------


def with_solution(rng, matrix, lower, upper):
    """q such that u solves the VI: each row at a bound, free between them, or both at once (degenerate)."""
    n = len(matrix)
    width = np.where(np.isfinite(upper - lower), upper - lower, 1.0)
    anchor = np.where(np.isfinite(lower), lower, np.where(np.isfinite(upper), upper - width, 0.0))
    place = rng.choice(["lower", "upper", "between"], n)
    place[(place == "lower") & ~np.isfinite(lower)] = "between"
    place[(place == "upper") & ~np.isfinite(upper)] = "between"
    u = anchor + width * rng.uniform(0.1, 0.9, n)
    u[place == "lower"] = lower[place == "lower"]
    u[place == "upper"] = upper[place == "upper"]
    force = rng.uniform(0.1, 2, n) * (rng.random(n) < 0.9)
    force = np.select([place == "lower", place == "upper"], [force, -force], 0.0)
    return force - matrix @ u, u


def lcp(rng, kind):
    n = int(rng.integers(2, 41))
    matrix = kind(rng, n)
    lower, upper = np.zeros(n), np.full(n, np.inf)
    q, u = with_solution(rng, matrix, lower, upper)
    return {"M": matrix, "q": q, "lower": lower, "upper": upper, "u": u, "kind": kind.__name__}


def mixed(rng, kind):
    """A third of the rows free, a third a half line, a third a box; some boxes are a single point."""
    n = int(rng.integers(2, 41))
    sort = rng.integers(0, 3, n)
    lower = np.where(sort == 0, -np.inf, rng.normal(size=n))
    upper = np.where(sort == 2, lower + rng.uniform(0, 2, n) * (rng.random(n) < 0.8), np.inf)
    flipped = (sort == 1) & (rng.random(n) < 0.5)
    lower[flipped], upper[flipped] = -np.inf, lower[flipped]
    matrix = kind(rng, n)
    q, u = with_solution(rng, matrix, lower, upper)
    return {"M": matrix, "q": q, "lower": lower, "upper": upper, "u": u, "kind": "mixed " + kind.__name__}


def block_diagonal(problems):
    """Independent problems as one."""
    sizes = [len(problem["q"]) for problem in problems]
    matrix = np.zeros((sum(sizes), sum(sizes)))
    for problem, first in zip(problems, np.cumsum([0] + sizes)):
        matrix[first : first + len(problem["q"]), first : first + len(problem["q"])] = problem["M"]
    parts = {key: np.concatenate([problem[key] for problem in problems]) for key in ("q", "lower", "upper", "u")}
    return {"M": matrix, **parts, "kind": "block diagonal"}


# The program ---------------------------------------------------------------------------------------------------------


def toml(values):
    if np.ndim(values):
        return "[" + ", ".join(map(toml, values)) + "]"
    return repr(float(values))


def write_matrix_market(path, matrix):
    rows, columns = np.nonzero(matrix)
    lines = [f"{i + 1} {j + 1} {float(matrix[i, j])!r}" for i, j in zip(rows, columns)]
    head = ["%%MatrixMarket matrix coordinate real general", f"{len(matrix)} {len(matrix)} {len(lines)}"]
    path.write_text("\n".join(head + lines) + "\n")


def write_csr(path, matrix):
    rows, columns = np.nonzero(matrix)
    with h5py.File(path, "w") as file:
        group = file.create_group("M")
        group.attrs["shape"] = matrix.shape
        group["data"] = matrix[rows, columns]
        group["indices"] = columns
        group["indptr"] = np.searchsorted(rows, np.arange(len(matrix) + 1))


def write_problem(folder, problem, form):
    """form: how M is given, in turn one of the ways a scene may give a matrix."""
    if form == "rows":
        matrix = toml(problem["M"])
    elif form == "market":
        write_matrix_market(folder / "M.mtx", problem["M"])
        matrix = '"M.mtx"'
    else:
        write_csr(folder / "M.h5", problem["M"])
        matrix = '{file = "M.h5", dataset = "/M"}'
    text = f"[problem]\nM = {matrix}\n"
    for key in ("q", "lower", "upper"):
        text += f"{key} = {toml(problem[key])}\n"
    (folder / "problem.toml").write_text(text)


def solve(problem, form="rows", ranks=1):
    with program.temporary_folder() as name:
        folder = Path(name)
        write_problem(folder, problem, form)
        words = ["solve", "problem.toml", "-o", "solution.h5", "--summary", "summary.json"]
        result = {"outcome": program.run(*words, ranks=ranks, cwd=folder)}
        if (folder / "solution.h5").exists():
            with h5py.File(folder / "solution.h5") as file:
                result["status"] = file.attrs["status"]
                result["solution"], result["F"] = file["solution"][:], file["F"][:]
        if (folder / "summary.json").exists():
            result["summary"] = program.read_json(folder / "summary.json")
        return result


def natural_ratio(problem, u):
    """Natural residual over the row's terms |M||u| + |q|, the worst row."""
    f = problem["M"] @ u + problem["q"]
    terms = abs(problem["M"]) @ abs(u) + abs(problem["q"])
    residual = abs(u - np.clip(u - f, problem["lower"], problem["upper"]))
    return np.max(np.divide(residual, terms, out=np.zeros_like(residual), where=residual > 0))


class Solve(unittest.TestCase):
    LCPS, MIXED = 24, 9  # solve_full_test.py has more

    def judge_solved(self, problem, result):
        outcome = result["outcome"]
        self.assertEqual(outcome.code, 0, f"{problem['kind']}, n = {len(problem['q'])}\n{outcome}")
        self.assertEqual(result["status"], "done", outcome)
        self.assertEqual((result["summary"]["exit"], result["summary"]["status"]), (0, "done"), outcome)
        u = np.ravel(result["solution"])
        self.assertEqual(u.shape, problem["q"].shape, "/solution has another length than q")
        self.assertTrue(np.all((problem["lower"] <= u) & (u <= problem["upper"])), "/solution leaves the box")
        ratio = natural_ratio(problem, u)
        self.assertLessEqual(ratio, CERTIFICATE + ROUNDING * len(u), f"natural residual over row terms\n{outcome}")
        terms = abs(problem["M"]) @ abs(u) + abs(problem["q"])
        if problem["kind"] in WELL_CONDITIONED:
            np.testing.assert_allclose(u, problem["u"], rtol=1e-6, atol=1e-6, err_msg="not the only solution there is")
        gap = np.max(abs(np.ravel(result["F"]) - problem["M"] @ u - problem["q"]) / np.maximum(terms, 1e-300))
        self.assertLessEqual(gap, ROUNDING * len(u), "/F is not M u + q at /solution")

    def judge_all(self, problems, ranks=1):
        forms = ("rows", "market", "csr")
        jobs = [(problem, forms[i % 3], ranks) for i, problem in enumerate(problems)]
        for i, (problem, result) in enumerate(zip(problems, program.run_all(lambda job: solve(*job), jobs))):
            with self.subTest(i, kind=problem["kind"], ranks=ranks):
                self.judge_solved(problem, result)

    def judge_unsolvable(self, problem, ranks=1):
        result = solve(problem, ranks=ranks)
        outcome = result["outcome"]
        self.assertEqual(outcome.code, 3, outcome)
        self.assertEqual(result["status"], "failed", "the file's status")
        self.assertEqual((result["summary"]["exit"], result["summary"]["status"]), (3, "failed"), "the summary")
        self.assertTrue(np.all(np.isfinite(result["solution"])), f"the best point is {result['solution']}")
        ratio = natural_ratio(problem, np.ravel(result["solution"]))
        self.assertGreater(ratio, CERTIFICATE, "there is no solution, and yet a point with no residual")
        self.assertAlmostEqual(result["summary"]["max_residual"] / ratio, 1, 6, "the summary's residual of that point")
        self.assertEqual(outcome.err.count("sweepvi: "), 1, outcome)
        self.assertNotIn("PETSC ERROR", outcome.err, outcome)

    def test_random_lcps(self):
        rng = np.random.default_rng(SEED)
        self.judge_all([lcp(rng, KINDS[i % len(KINDS)]) for i in range(self.LCPS)])

    def test_random_mixed_problems(self):
        rng = np.random.default_rng(SEED + 1)
        kinds = [positive_definite, m_matrix, h_matrix]
        self.judge_all([mixed(rng, kinds[i % 3]) for i in range(self.MIXED)])

    def test_on_two_ranks(self):
        rng = np.random.default_rng(SEED + 2)
        self.judge_all([lcp(rng, kind) for kind in KINDS] + [mixed(rng, positive_definite) for _ in range(3)], ranks=2)

    def test_many_independent_problems_as_one(self):
        """Each block converges at its own pace; one slow block must not spoil the others."""
        rng = np.random.default_rng(SEED + 3)
        problem = block_diagonal([lcp(rng, kind) for kind in KINDS] + [mixed(rng, h_matrix) for _ in range(6)])
        self.judge_all([problem, problem, problem])  # in each form
        self.judge_all([problem], ranks=2)

    def test_newton_min_cycle(self):
        """A fixed block of `cyclic`."""
        matrix = np.array([[1.0, 0, 2], [2, 1, 0], [0, 2, 1]])
        bounds = {"lower": np.zeros(3), "upper": np.full(3, np.inf)}
        for q in (np.ones(3), -np.ones(3), np.array([-1.0, 1, 0.5])):
            with self.subTest(q=q):
                problem = {"M": matrix, "q": q, **bounds, "kind": "cycle"}
                self.judge_solved(problem, solve(problem))

    def test_without_a_solution(self):
        bounds = {"lower": np.zeros(1), "upper": np.full(1, np.inf)}
        cases = {
            "negative": {"M": np.array([[-1.0]]), "q": np.array([-1.0]), **bounds},
            "zero": {"M": np.array([[0.0]]), "q": np.array([-1.0]), **bounds},
            "zero, two rows": {"M": np.zeros((2, 2)), "q": np.array([-1.0, 0]), "lower": np.zeros(2), "upper": np.full(2, np.inf)},
            "free row without diagonal": {
                "M": np.array([[0.0, 0], [0, 1]]), "q": np.array([1.0, -1]),
                "lower": np.array([-np.inf, 0]), "upper": np.full(2, np.inf),
            },
        }
        for name, problem in cases.items():
            for ranks in (1, 2) if "row" in name else (1,):
                with self.subTest(name, ranks=ranks):
                    self.judge_unsolvable(problem, ranks)

    def test_singular_with_a_solution(self):
        """M = 0: u at the bound that F = q points away from. Zero diagonal: u = (1, 1), the only point with F = 0."""
        zero = {"M": np.zeros((2, 2)), "q": np.array([1.0, -2]), "lower": np.zeros(2), "upper": np.ones(2), "kind": "zero"}
        skew = np.array([[0.0, 1], [-1, 0]])
        skew = {"M": skew, "q": np.array([-1.0, 1]), "lower": np.zeros(2), "upper": np.full(2, np.inf), "kind": "skew"}
        for problem, expected in ((zero, [0, 1]), (skew, [1, 1])):
            for ranks in (1, 2):
                with self.subTest(problem["kind"], ranks=ranks):
                    result = solve(problem, ranks=ranks)
                    self.judge_solved(problem, result)
                    np.testing.assert_allclose(np.ravel(result["solution"]), expected, rtol=1e-12)

    def test_singular_equations(self):
        """u1 + u2 = 1 twice: solved, or given up in order."""
        problem = "[problem]\nM = [[1, 1], [1, 1]]\nq = [-1, -1]\nlower = -inf\n"
        for ranks in (1, 2):
            with self.subTest(ranks=ranks), program.temporary_folder() as name:
                (Path(name) / "problem.toml").write_text(problem)
                outcome = program.run("solve", "problem.toml", cwd=name, ranks=ranks)
                self.assertIn(outcome.code, (0, 3), outcome)

    def test_optional_start(self):
        """u0 outside the box, and the defaults of lower and upper."""
        with program.temporary_folder() as name:
            (Path(name) / "problem.toml").write_text("[problem]\nM = [[2, 1], [0, 2]]\nq = [-1, 2]\nu0 = [-5, 7]\n")
            outcome = program.run("solve", "problem.toml", cwd=name)
            self.assertEqual(outcome.code, 0, outcome)
            with h5py.File(Path(name) / "problem.h5") as file:
                np.testing.assert_allclose(np.ravel(file["solution"]), [0.5, 0], rtol=1e-14)
                np.testing.assert_allclose(np.ravel(file["F"]), [0, 2], atol=1e-15)


if __name__ == "__main__":
    unittest.main()
