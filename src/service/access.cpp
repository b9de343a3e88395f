#include "service/access.hpp"

#include <openssl/crypto.h>

#include "service/address.hpp"
#include "service/digest.hpp"
#include "service/refusal.hpp"

namespace sweepvi::service {

Access::Access(const Settings& settings)
    : open_(settings.open()),
      on_socket_(settings.on_socket()),
      on_loopback_(settings.on_loopback()),
      users_(settings.users) {
  for (const User& user : users_)
    digests_.push_back(digest_of(user.token));
}

// All of them are compared: how long that takes tells nothing.
const User* Access::with_token(const std::string& authorization) const {
  constexpr std::string_view scheme = "Bearer ";
  const bool bearer = authorization.starts_with(scheme);
  const std::string given = digest_of(bearer ? authorization.substr(scheme.size()) : std::string());
  const User* found = nullptr;
  for (std::size_t i = 0; i < users_.size(); ++i)
    if (CRYPTO_memcmp(given.data(), digests_[i].data(), given.size()) == 0) found = &users_[i];
  return bearer ? found : nullptr;
}

const User& Access::user_of(const httplib::Request& request) const {
  const User* user = open_ ? &users_.front() : with_token(request.get_header_value("Authorization"));
  if (user == nullptr) throw Refusal(401, "a bearer token is needed: Authorization: Bearer TOKEN");
  return *user;
}

// Elsewhere the token keeps strangers out, and proxies may use any name.
bool Access::names_us(const std::string& host) const {
  if (on_socket_ || !on_loopback_) return true;
  const std::optional<std::string> name = host_in(host);
  return name && is_loopback(*name);
}

void Access::check(const httplib::Request& request) const {
  // A page from elsewhere reaches loopback through its visitor's browser: under a name of its own that has
  // been made to mean 127.0.0.1, or with an Origin that is not ours.
  const std::string host = request.get_header_value("Host");
  if (!names_us(host)) throw Refusal(403, "the Host header names another machine");
  const std::string origin = request.get_header_value("Origin");
  if (!origin.empty() && origin != "http://" + host && origin != "https://" + host)
    throw Refusal(403, "requests from web pages of others are not answered");
  // What says nothing about anybody's work needs no token.
  for (const char* path : {"/", "/healthz", "/openapi.json"})
    if (request.path == path && request.method == "GET") return;
  static_cast<void>(user_of(request));
}

}  // namespace sweepvi::service
