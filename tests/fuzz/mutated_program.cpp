// Inputs of the readers with bytes changed, without libFuzzer: for builds as users have them, whose optimiser
// may make something else of a defect than a sanitizer sees.
//
//   mutated_program READER NUMBER SEED FOLDER...    NUMBER inputs out of the files in the folders; the first
//   that breaks
//                                                   the reader is told and kept, or stays as broken.READER
#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iterator>
#include <map>
#include <random>
#include <string_view>
#include <vector>

#include "fuzz/readers.hpp"
#include "sweepvi/petsc.hpp"

namespace sweepvi::fuzz {
namespace {

using namespace std::string_view_literals;

std::string content(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(file), {}};
}

class Mutation {
public:
  Mutation(std::vector<std::string> seeds, unsigned number) : seeds_(std::move(seeds)), draw_(number) {}

  std::string next() {
    std::string bytes = seeds_[below(seeds_.size())];
    for (std::size_t changes = 1 + below(8); changes > 0 && !bytes.empty(); --changes)
      change(bytes);
    return bytes;
  }

private:
  std::size_t below(std::size_t end) { return std::uniform_int_distribution<std::size_t>(0, end - 1)(draw_); }

  void change(std::string& bytes) {
    const std::size_t at = below(bytes.size());
    const std::size_t length = 1 + below(std::min<std::size_t>(bytes.size() - at, 64));
    constexpr std::string_view telling = "\0\x01\x7f\x80\xff 0-.,[]{}\"\n9e"sv;
    switch (below(7)) {
      case 0:
        bytes[at] = static_cast<char>(bytes[at] ^ (1 << below(8)));
        break;
      case 1:
        bytes[at] = telling[below(telling.size())];
        break;
      case 2:
        bytes.erase(at, length);
        break;
      case 3:
        bytes.insert(at, bytes.substr(at, length));
        break;
      case 4:
        bytes.resize(at);
        break;
      case 5:
        std::fill_n(bytes.begin() + static_cast<std::ptrdiff_t>(at), length, telling[below(telling.size())]);
        break;
      default: {
        const std::string& other = seeds_[below(seeds_.size())];
        if (!other.empty()) bytes.replace(at, length, other.substr(below(other.size()), length));
      }
    }
  }

  std::vector<std::string> seeds_;
  std::mt19937_64 draw_;
};

int run(const std::string& name, int number, unsigned seed, const std::vector<fs::path>& folders) {
  using Reader = std::function<void(const Folder&, std::string_view)>;
  const std::map<std::string, Reader> readers = {
      {"scene", scene}, {"problem", problem}, {"matrix_market", matrix_market},
      {"data", data},   {"hdf5", hdf5},       {"recorded", recorded}};
  std::vector<fs::path> paths;
  for (const fs::path& folder : folders)
    std::copy(fs::directory_iterator(folder), fs::directory_iterator(), std::back_inserter(paths));
  std::sort(paths.begin(), paths.end());
  std::vector<std::string> seeds;
  std::transform(paths.begin(), paths.end(), std::back_inserter(seeds), content);
  if (!readers.contains(name) || seeds.empty()) return 2;

  const Folder folder(PETSC_COMM_WORLD);
  put_data(folder);
  Mutation mutation(std::move(seeds), seed);
  const std::string kept = "broken." + name;
  for (int i = 0; i < number; ++i) {
    const std::string bytes = mutation.next();
    std::ofstream(kept, std::ios::binary) << bytes;
    try {
      readers.at(name)(folder, bytes);
    } catch (const std::exception& error) {
      std::printf("%s: input %d of seed %u: %s; it is in %s\n", name.c_str(), i, seed, error.what(),
                  kept.c_str());
      return 1;
    }
  }
  fs::remove(kept);
  std::printf("%s: %d inputs of seed %u read or refused\n", name.c_str(), number, seed);
  return 0;
}

}  // namespace
}  // namespace sweepvi::fuzz

int main(int argc, char** argv) {
  if (argc < 5) return 2;
  const sweepvi::Session session(argv[0], {"-no_signal_handler", "-sweepvi_memory_limit", "0.02"});  // [GB]
  return sweepvi::fuzz::run(argv[1], std::atoi(argv[2]), static_cast<unsigned>(std::atoi(argv[3])),
                            {argv + 4, argv + argc});
}
