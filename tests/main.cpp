// Every test program: MPI and PETSc up, all tests on all ranks in the same order, the ranks' failures added
// up.
#include <gtest/gtest.h>
#include <mpi.h>

#include <algorithm>
#include <cstdio>
#include <string>

#include "sweepvi/petsc.hpp"

namespace {

class FailurePrinter : public testing::EmptyTestEventListener {
public:
  explicit FailurePrinter(int rank) : rank_(rank) {}
  void OnTestPartResult(const testing::TestPartResult& result) override {
    if (result.failed())
      std::fprintf(stderr, "[rank %d] %s:%d: %s\n", rank_, result.file_name(), result.line_number(),
                   result.message());
  }

private:
  int rank_;
};

/// Whether each word of the filter stands for a test at least: one that was renamed must not drop out unseen.
bool filter_is_of_tests() {
  const std::string all = GTEST_FLAG_GET(filter);
  const std::string filter = all.substr(0, all.find('-'));
  const auto words = 1 + std::count(filter.begin(), filter.end(), ':');
  return testing::UnitTest::GetInstance()->test_to_run_count() >= words;
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  sweepvi::Session session(argc, argv);
  int rank = 0;
  MPI_Comm_rank(session.comm(), &rank);
  if (rank != 0) {  // one rank reports progress; failures of the others are counted below
    auto& listeners = testing::UnitTest::GetInstance()->listeners();
    delete listeners.Release(listeners.default_result_printer());
    listeners.Append(new FailurePrinter(rank));
  }
  int mine = RUN_ALL_TESTS();
  if (!filter_is_of_tests()) {
    std::fprintf(stderr, "fewer tests were run than the filter has words\n");
    mine = 1;
  }
  int failed = 0;
  MPI_Allreduce(&mine, &failed, 1, MPI_INT, MPI_MAX, session.comm());
  if (mine != 0) std::fprintf(stderr, "rank %d: some tests failed\n", rank);
  return failed;
}
