#include "io/checksum.hpp"

#include <cstring>

namespace sweepvi {
namespace {

/// The output of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014), whose state the number of the word selects
/// and its bits disturb. For one number it is a permutation of the bits.
template <class Word>
std::uint64_t sum(const std::byte* words, std::uint64_t count, std::uint64_t first) {
  constexpr std::uint64_t step = 0x9e3779b97f4a7c15;
  std::uint64_t total = 0, state = first * step;
  for (std::uint64_t i = 0; i < count; ++i) {
    Word word;
    std::memcpy(&word, words + i * sizeof word, sizeof word);
    std::uint64_t mixed = (state += step) ^ word;
    mixed = (mixed ^ (mixed >> 30)) * 0xbf58476d1ce4e5b9;
    mixed = (mixed ^ (mixed >> 27)) * 0x94d049bb133111eb;
    total += mixed ^ (mixed >> 31);
  }
  return total;
}

}  // namespace

std::uint64_t checksum(const std::byte* entries, std::uint64_t count, std::uint64_t entry_bytes,
                       std::uint64_t first) {
  const std::uint64_t word = entry_bytes % 8 == 0 ? 8 : 4, words = entry_bytes / word;
  return word == 8 ? sum<std::uint64_t>(entries, count * words, first * words)
                   : sum<std::uint32_t>(entries, count * words, first * words);
}

}  // namespace sweepvi
