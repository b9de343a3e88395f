#pragma once

#include <gtest/gtest.h>

#include "vi/data_problems.hpp"

namespace sweepvi::test {

/// `count` problems without a solution and `count` with one, of each kind, and stiff ones: none of the first,
/// all of the others are certified, from wherever the solver starts.
inline void certify_only_what_has_a_solution(unsigned seed, int count, Index largest) {
  DataProblems problems(seed);
  Random sizes(seed + 1);
  const auto next = [&] { return static_cast<std::size_t>(random_size(sizes, largest)); };
  for (int kind = 0; kind < DataProblems::kinds; ++kind) {
    for (const bool solvable : {false, true}) {
      for (int k = 0; k < count; ++k) {
        const DataProblem problem = problems.make(kind, next(), solvable);
        const Solved solved = solve(problem);
        EXPECT_EQ(solved.report.certified, solvable)
            << problem.kind << ", number " << k << ", n = " << problem.size() << ", largest u "
            << solved.u.cwiseAbs().maxCoeff() << ", ratio " << solved.report.residual << ", "
            << solved.report.reason;
      }
    }
  }
  int refined = 0;
  for (const bool grounded : {true, false}) {
    for (int k = 0; k < count; ++k) {
      const DataProblem problem = problems.stiff(next(), grounded);
      const Solved solved = solve(problem);
      EXPECT_TRUE(solved.report.certified)
          << problem.kind << ", number " << k << ", n = " << problem.size() << ", " << solved.report.reason;
      refined += solved.report.refined ? 1 : 0;
    }
  }
  EXPECT_GT(refined, 0);  // or stiff ones show nothing
}

}  // namespace sweepvi::test
