#pragma once

#include <cstddef>
#include <cstdint>

namespace sweepvi {

/// A checksum of `count` entries of a dataset, the first of which is number `first` there: the sum mod 2^64
/// of a mix of each entry's number and bits. So the checksum of a dataset is the sum of the checksums of its
/// parts, whoever holds them. A single changed bit always changes it; anything else goes unnoticed once in
/// about 2^64 cases.
/// @param entry_bytes  of one entry: a multiple of 4
std::uint64_t checksum(const std::byte* entries, std::uint64_t count, std::uint64_t entry_bytes,
                       std::uint64_t first);

}  // namespace sweepvi
