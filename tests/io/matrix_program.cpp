// Reads matrices and vectors for scripts: a line "matrix FILE [DATASET]" or "vector FILE [DATASET]" on
// standard input, for each a line on standard output: "ROWS COLUMNS VALUE ..." row by row, "LENGTH VALUE
// ...", or "refused: WHY".

#include <cstdio>
#include <iostream>
#include <sstream>
#include <string>

#include "io/matrix_file.hpp"
#include "sweepvi/error.hpp"

namespace {

using namespace sweepvi;

void answer(const std::string& what, const std::string& file, const std::string& dataset) {
  if (what == "vector") {
    const std::vector<double> values = read_vector_file(file, dataset, true);
    std::printf("%zu", values.size());
    for (const double value : values)
      std::printf(" %.17g", value);
  } else {
    const SparseEntries matrix = read_matrix_file(file, dataset);
    std::printf("%lld %lld", static_cast<long long>(matrix.rows), static_cast<long long>(matrix.cols));
    for (std::int64_t i = 0; i < matrix.rows; ++i)
      for (std::int64_t j = 0; j < matrix.cols; ++j)
        std::printf(" %.17g", matrix.entry(i, j));
  }
}

}  // namespace

int main() {
  for (std::string line; std::getline(std::cin, line);) {
    std::istringstream words(line);
    std::string what, file, dataset;
    words >> what >> file >> dataset;
    try {
      answer(what, file, dataset);
    } catch (const Error& error) {
      if (error.code() != ExitCode::bad_input) return static_cast<int>(error.code());
      std::printf("refused: %s", error.what());
    }
    std::printf("\n");
  }
  return 0;
}
