#pragma once

#include <httplib.h>

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

namespace sweepvi::service {

/// Bytes first ... last of a file.
struct ByteRange {
  std::int64_t first = 0, last = 0;
};

/// What a Range header (RFC 9110) asks of a file of so many bytes. Several ranges, other units and what
/// cannot be read count as none, as the RFC allows.
/// @throws Refusal (416) if nothing of it is there
std::optional<ByteRange> read_range(const std::string& header, std::int64_t bytes);

/// Answers with a file: whole, in part (Range, If-Range), or not at all (If-None-Match).
/// @param sha256  of all of it, in hexadecimal: ETag, and Repr-Digest (RFC 9530)
void send_file(const httplib::Request& request, httplib::Response& response,
               const std::filesystem::path& path, const std::string& type, const std::string& sha256);

}  // namespace sweepvi::service
