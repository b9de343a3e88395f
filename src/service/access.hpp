#pragma once

#include <httplib.h>

#include <string>

#include "service/settings.hpp"

namespace sweepvi::service {

/// Who may ask for what.
class Access {
public:
  explicit Access(const Settings& settings);

  /// @throws Refusal (401) without a token, if one is asked for; (403) for requests that a web page of
  /// somebody else may have made a browser send
  void check(const httplib::Request& request) const;
  /// Who asks. @throws Refusal (401) without a token, if one is asked for
  const User& user_of(const httplib::Request& request) const;

private:
  const User* with_token(const std::string& authorization) const;
  bool names_us(const std::string& host) const;

  bool open_, on_socket_, on_loopback_;
  std::vector<User> users_;
  std::vector<std::string> digests_;  // of their tokens: texts of one length, compared in constant time
};

}  // namespace sweepvi::service
