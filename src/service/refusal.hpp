#pragma once

#include <stdexcept>
#include <string>

namespace sweepvi::service {

/// A request that is not granted: what the client is told, and the HTTP status it goes with.
class Refusal : public std::runtime_error {
public:
  Refusal(int status, const std::string& message) : std::runtime_error(message), status_(status) {}
  int status() const noexcept { return status_; }

private:
  int status_;
};

/// Wrong words on the command line, or a setting that cannot be used: exit 2.
class UsageError : public std::runtime_error {
  using std::runtime_error::runtime_error;
};

}  // namespace sweepvi::service
