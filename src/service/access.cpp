#include "service/access.hpp"

#include <openssl/crypto.h>

#include "service/address.hpp"
#include "service/digest.hpp"
#include "service/refusal.hpp"

namespace sweepvi::service {

Access::Access(const Settings& settings)
    : open_(settings.token.empty()),
      on_socket_(settings.on_socket()),
      on_loopback_(settings.on_loopback()),
      digest_(digest_of(settings.token)) {}

bool Access::has_token(const std::string& authorization) const {
  constexpr std::string_view scheme = "Bearer ";
  const bool bearer = authorization.starts_with(scheme);
  const std::string given = digest_of(bearer ? authorization.substr(scheme.size()) : std::string());
  return CRYPTO_memcmp(given.data(), digest_.data(), digest_.size()) == 0 && bearer;
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
  if (!open_ && !has_token(request.get_header_value("Authorization")))
    throw Refusal(401, "a bearer token is needed: Authorization: Bearer TOKEN");
}

}  // namespace sweepvi::service
