// What the tests of the matrix readers share. The readers are serial: under MPI every rank runs these tests
// by itself, in a folder of its own.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "io/matrix_file.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace fs = std::filesystem;

class MatrixFileTest : public testing::Test {
protected:
  void SetUp() override {
    char name[] = "/tmp/sweepvi_matrix_XXXXXX";
    ASSERT_NE(mkdtemp(name), nullptr);
    folder_ = name;
  }
  void TearDown() override { fs::remove_all(folder_); }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  std::string file(const std::string& text) const {
    std::ofstream(path("m.mtx"), std::ios::binary) << text;
    return path("m.mtx");
  }

  fs::path folder_;
};

inline std::vector<double> dense(const SparseEntries& matrix) {
  std::vector<double> result(std::size_t(matrix.rows * matrix.cols), 0.0);
  EXPECT_EQ(matrix.row_starts.size(), std::size_t(matrix.rows) + 1);
  for (std::int64_t i = 0; i < matrix.rows; ++i) {
    for (std::int64_t k = matrix.row_starts[std::size_t(i)]; k < matrix.row_starts[std::size_t(i) + 1]; ++k) {
      const std::int64_t j = matrix.columns[std::size_t(k)];
      if (k > matrix.row_starts[std::size_t(i)]) {
        EXPECT_LT(matrix.columns[std::size_t(k) - 1], j);
      }
      result[std::size_t(i * matrix.cols + j)] = matrix.values[std::size_t(k)];
    }
  }
  return result;
}

template <class Work>
std::string complaint(Work&& work) {
  try {
    work();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::bad_input);
    return error.what();
  }
  return "(no error)";
}

using Values = std::vector<double>;

}  // namespace sweepvi
