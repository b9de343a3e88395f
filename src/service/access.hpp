#pragma once

#include <httplib.h>

#include <string>

#include "service/settings.hpp"

namespace sweepvi::service {

/// Who may ask for what.
class Access {
public:
  explicit Access(const Settings& settings);

  /// @throws Refusal (401) without the token, if there is one; (403) for requests that a web page of somebody
  /// else may have made a browser send
  void check(const httplib::Request& request) const;

private:
  bool has_token(const std::string& authorization) const;
  bool names_us(const std::string& host) const;

  bool open_, on_socket_, on_loopback_;
  std::string digest_;  // of the token: texts of one length, compared in constant time
};

}  // namespace sweepvi::service
