// Everything that fuzzing found worth keeping, once more through the readers: they succeed or throw Error
// (bad_input). A file's name says what was wrong with it, or is a hash that libFuzzer gave.
//
// ranks: 1
#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <vector>

#include "readers.hpp"
#include "sweepvi/petsc.hpp"

namespace sweepvi::fuzz {
namespace {

std::string content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

template <class Reader>
void replay(const char* name, Reader&& reader) {
  check(PetscOptionsSetValue(nullptr, "-sweepvi_memory_limit", "0.02"));  // [GB]: as while fuzzing
  std::vector<fs::path> paths;
  for (const auto& entry :
       fs::directory_iterator(fs::path(std::getenv("SWEEPVI_SOURCE")) / "tests/fuzz/corpus" / name))
    paths.push_back(entry.path());
  std::sort(paths.begin(), paths.end());
  ASSERT_GE(paths.size(), 10U);
  const Folder folder(PETSC_COMM_WORLD);
  put_data(folder);
  for (const fs::path& path : paths) {
    SCOPED_TRACE(path.string());
    EXPECT_NO_THROW(reader(folder, content(path)));
  }
}

TEST(Corpus, Scenes) {
  replay("scene", scene);
}
TEST(Corpus, Problems) {
  replay("problem", problem);
}
TEST(Corpus, MatrixMarket) {
  replay("matrix_market", matrix_market);
}
TEST(Corpus, Data) {
  replay("data", data);
}
TEST(Corpus, Hdf5) {
  replay("hdf5", hdf5);
}
TEST(Corpus, Recorded) {
  replay("recorded", recorded);
}

// A dotted key makes a table for each of its words, and tables in tables are destroyed recursively.
TEST(Corpus, DeepKeys) {
  std::string key = "a";
  for (int i = 0; i < 1000000; ++i)
    key += ".a";
  const Folder folder(PETSC_COMM_WORLD);
  for (const std::string& text : {key + " = 1", "[" + key + "]\n", "[model]\nkind = {" + key + " = 1}\n"})
    EXPECT_NO_THROW(scene(folder, text));
}

}  // namespace
}  // namespace sweepvi::fuzz
