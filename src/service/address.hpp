#pragma once

#include <optional>
#include <string>

namespace sweepvi::service {

/// The host of HOST or HOST:PORT, without the brackets of an IPv6 address; nothing if it is neither.
std::optional<std::string> host_in(const std::string& host_and_port);

/// Whether a host is this machine alone, as an address: 127.0.0.0/8 with four numbers, ::1 or
/// ::ffff:127.0.0.0/104 however they are written, or the name `localhost`. Other names may begin alike, and
/// lead anywhere.
bool is_loopback(const std::string& host);

}  // namespace sweepvi::service
