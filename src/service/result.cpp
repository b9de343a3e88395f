#include "service/result.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <memory>
#include <vector>

#include "service/digest.hpp"
#include "service/files.hpp"
#include "service/refusal.hpp"

namespace sweepvi::service {

namespace {

std::optional<std::int64_t> whole_number(std::string_view text) {
  std::int64_t number = 0;
  const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (text.empty() || failure != std::errc() || end != text.data() + text.size() || number < 0)
    return std::nullopt;
  return number;
}

std::string bytes_of(const std::string& hexadecimal) {
  std::string bytes;
  for (std::size_t i = 0; i + 1 < hexadecimal.size(); i += 2)
    bytes += static_cast<char>(std::stoi(hexadecimal.substr(i, 2), nullptr, 16));
  return bytes;
}

}  // namespace

std::optional<ByteRange> read_range(const std::string& header, std::int64_t bytes) {
  constexpr std::string_view unit = "bytes=";
  if (!header.starts_with(unit)) return std::nullopt;
  const std::string_view range = std::string_view(header).substr(unit.size());
  const std::size_t dash = range.find('-');
  if (dash == std::string_view::npos) return std::nullopt;
  const std::string_view left = range.substr(0, dash);
  const std::string_view right = range.substr(dash + 1);
  const std::optional<std::int64_t> first = whole_number(left);
  const std::optional<std::int64_t> last = whole_number(right);
  if ((!left.empty() && !first) || (!right.empty() && !last) || (!first && !last)) return std::nullopt;
  if (first && last && *last < *first) return std::nullopt;
  if ((first && *first >= bytes) || (!first && *last == 0) || bytes == 0)
    throw Refusal(416, fmt::format("the file has {} bytes", bytes));
  if (!first) return ByteRange{bytes - std::min(*last, bytes), bytes - 1};  // the last so many
  return ByteRange{*first, last ? std::min(*last, bytes - 1) : bytes - 1};
}

void send_file(const httplib::Request& request, httplib::Response& response,
               const std::filesystem::path& path, const std::string& type, const std::string& sha256) {
  const auto file = std::make_shared<Descriptor>(open(path.c_str(), O_RDONLY | O_CLOEXEC));
  struct stat about {};
  if (!*file || fstat(file->get(), &about) != 0) throw Refusal(404, "there is no such file");
  const std::int64_t bytes = about.st_size;
  const std::string tag = '"' + sha256 + '"';
  response.set_header("Accept-Ranges", "bytes");
  response.set_header("ETag", tag);
  response.set_header("Repr-Digest", "sha-256=:" + base64(bytes_of(sha256)) + ":");
  response.set_header("Cache-Control", "no-cache");
  if (request.get_header_value("If-None-Match") == tag) {
    response.status = 304;
    return;
  }
  std::optional<ByteRange> range;
  const std::string condition = request.get_header_value("If-Range");
  if (request.has_header("Range") && (condition.empty() || condition == tag)) {
    try {
      range = read_range(request.get_header_value("Range"), bytes);
    } catch (const Refusal&) {
      response.set_header("Content-Range", fmt::format("bytes */{}", bytes));
      throw;
    }
  }
  response.status = range ? 206 : 200;
  if (range)
    response.set_header("Content-Range", fmt::format("bytes {}-{}/{}", range->first, range->last, bytes));
  const ByteRange part = range.value_or(ByteRange{0, bytes - 1});
  if (bytes == 0) {
    response.set_content("", type);
    return;
  }
  response.set_content_provider(
      static_cast<std::size_t>(part.last - part.first + 1), type,
      [file, part](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
        constexpr std::size_t piece = 1U << 18U;
        std::vector<char> buffer(std::min(length, piece));
        const ssize_t count = pread(file->get(), buffer.data(), buffer.size(),
                                    static_cast<off_t>(part.first) + static_cast<off_t>(offset));
        return count > 0 && sink.write(buffer.data(), static_cast<std::size_t>(count));
      });
}

}  // namespace sweepvi::service
