#include "service/framing.hpp"

#include <algorithm>
#include <cctype>
#include <string_view>

namespace sweepvi::service {

namespace {

constexpr int bad_request = 400;
constexpr std::size_t most_headers = 100;

bool is_token(std::string_view text) {
  constexpr std::string_view others = "!#$%&'*+-.^_`|~";
  return !text.empty() && std::all_of(text.begin(), text.end(), [&](unsigned char c) {
    return std::isalnum(c) != 0 || others.find(static_cast<char>(c)) != std::string_view::npos;
  });
}

bool has_control_characters(std::string_view text) {
  return std::any_of(text.begin(), text.end(),
                     [](unsigned char c) { return (c < 0x20 && c != '\t') || c == 0x7f; });
}

std::string lower(std::string_view text) {
  std::string result(text);
  std::transform(result.begin(), result.end(), result.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return result;
}

std::string_view trimmed(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t'))
    text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t'))
    text.remove_suffix(1);
  return text;
}

/// What decides where a request ends, and whom it is for.
struct Framing {
  std::size_t headers = 0, hosts = 0, lengths = 0, encodings = 0;
  std::string problem;

  void add(std::string_view line) {
    ++headers;
    const std::size_t colon = line.find(':');
    const std::string_view name = line.substr(0, colon);
    if (colon == std::string_view::npos || !is_token(name))
      return complain("a header has no name, or a space beside it");
    const std::string_view value = trimmed(line.substr(colon + 1));
    if (has_control_characters(value)) return complain("a header has control characters");
    const std::string known = lower(name);
    if (known == "host") ++hosts;
    if (known == "content-length") {
      ++lengths;
      constexpr std::size_t most_digits = 18;
      if (value.empty() || value.size() > most_digits ||
          value.find_first_not_of("0123456789") != std::string_view::npos)
        complain("Content-Length is no number of bytes");
    }
    if (known == "transfer-encoding") {
      ++encodings;
      if (lower(value) != "chunked") complain("Transfer-Encoding is not 'chunked'");
    }
  }

  void complain(const char* what) {
    if (problem.empty()) problem = what;
  }
};

}  // namespace

HeadComplaint check_head(std::string& head) {
  std::string_view rest = head;
  const auto next_line = [&](std::string_view& line) {
    const std::size_t end = rest.find('\n');
    if (end == std::string_view::npos || end == 0 || rest[end - 1] != '\r') return false;
    line = rest.substr(0, end - 1);
    rest.remove_prefix(end + 1);
    return line.find('\r') == std::string_view::npos;
  };
  std::string_view line;
  if (!next_line(line) || has_control_characters(line))
    return {bad_request, "the request line does not end as it should, or has control characters"};
  const std::size_t first = line.find(' ');
  const std::size_t last = line.rfind(' ');
  const bool three = first != std::string_view::npos && last > first + 1 &&
                     line.substr(first + 1, last - first - 1).find(' ') == std::string_view::npos;
  const std::string method(line.substr(0, first));
  const std::string version(line.substr(last + 1));
  if (!three || !is_token(method)) return {bad_request, "the request line is not METHOD TARGET VERSION"};
  if (version != "HTTP/1.1" && version != "HTTP/1.0")
    return {505, "only HTTP/1.1 and HTTP/1.0 are spoken here"};

  Framing framing;
  while (true) {
    if (!next_line(line)) return {bad_request, "a header does not end in CRLF"};
    if (line.empty()) break;
    framing.add(line);
    if (framing.headers > most_headers) return {431, "there are too many headers"};
  }
  if (framing.hosts > 1 || (framing.hosts == 0 && version == "HTTP/1.1"))
    framing.complain("there has to be one Host");
  if (framing.lengths + framing.encodings > 1)
    framing.complain("there is more than one Content-Length or Transfer-Encoding");
  if (framing.encodings > 0 && version == "HTTP/1.0") framing.complain("HTTP/1.0 has no Transfer-Encoding");
  if (!framing.problem.empty()) return {bad_request, framing.problem};
  const bool may_have_body = method == "POST" || method == "PUT" || method == "PATCH";
  if (may_have_body && framing.lengths + framing.encodings == 0)
    head.insert(head.size() - 2, "Content-Length: 0\r\n");
  return {};
}

}  // namespace sweepvi::service
