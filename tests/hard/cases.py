"""All hard cases."""

import cases_constraints
import cases_problems
import cases_time

CASES = [*cases_time.CASES, *cases_constraints.CASES, *cases_problems.CASES]
