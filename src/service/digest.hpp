#pragma once

#include <functional>
#include <memory>
#include <string>
#include <string_view>

struct evp_md_ctx_st;

namespace sweepvi::service {

/// SHA-256, part by part.
class Digest {
public:
  Digest();
  ~Digest();
  Digest(const Digest&) = delete;
  Digest& operator=(const Digest&) = delete;

  void add(std::string_view bytes);
  /// The 32 bytes; nothing can be added afterwards.
  std::string bytes();

private:
  evp_md_ctx_st* context_;
};

std::string hex(std::string_view bytes);
std::string base64(std::string_view bytes);
std::string digest_of(std::string_view bytes);  ///< 64 hexadecimal digits
/// @throws std::runtime_error if it cannot be read
/// @param meanwhile  called again and again: a large file takes minutes
std::string digest_of_file(const std::string& path, const std::function<void()>& meanwhile = {});

/// Bytes from the system's generator, in hexadecimal.
std::string random_hex(std::size_t bytes);

}  // namespace sweepvi::service
