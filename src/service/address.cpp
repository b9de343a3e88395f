#include "service/address.hpp"

#include <arpa/inet.h>
#include <strings.h>

#include <array>

namespace sweepvi::service {

std::optional<std::string> host_in(const std::string& host_and_port) {
  const bool brackets = host_and_port.starts_with('[');
  const std::size_t end = brackets ? host_and_port.find(']') : host_and_port.find(':');
  if (brackets && end == std::string::npos) return std::nullopt;
  const std::string host = brackets ? host_and_port.substr(1, end - 1) : host_and_port.substr(0, end);
  const std::string rest = end == std::string::npos ? "" : host_and_port.substr(brackets ? end + 1 : end);
  constexpr std::size_t longest_port = 5;
  const bool port = rest.empty() || (rest[0] == ':' && rest.size() <= 1 + longest_port &&
                                     rest.find_first_not_of("0123456789", 1) == std::string::npos);
  in6_addr address{};
  if (!port || host.empty() || (brackets && inet_pton(AF_INET6, host.c_str(), &address) != 1))
    return std::nullopt;
  return host;
}

bool is_loopback(const std::string& host) {
  if (strcasecmp(host.c_str(), "localhost") == 0) return true;
  in_addr four{};
  if (inet_pton(AF_INET, host.c_str(), &four) == 1) return (ntohl(four.s_addr) >> 24U) == 127;
  in6_addr six{};
  if (inet_pton(AF_INET6, host.c_str(), &six) != 1) return false;
  return IN6_IS_ADDR_LOOPBACK(&six) || (IN6_IS_ADDR_V4MAPPED(&six) && six.s6_addr[12] == 127);
}

}  // namespace sweepvi::service
