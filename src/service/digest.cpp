#include "service/digest.hpp"

#include <openssl/evp.h>
#include <openssl/rand.h>

#include <array>
#include <fstream>
#include <stdexcept>
#include <vector>

namespace sweepvi::service {

Digest::Digest() : context_(EVP_MD_CTX_new()) {
  if (context_ == nullptr || EVP_DigestInit_ex(context_, EVP_sha256(), nullptr) != 1)
    throw std::runtime_error("SHA-256 is not available");
}

Digest::~Digest() {
  EVP_MD_CTX_free(context_);
}

void Digest::add(std::string_view bytes) {
  EVP_DigestUpdate(context_, bytes.data(), bytes.size());
}

std::string Digest::bytes() {
  std::array<unsigned char, EVP_MAX_MD_SIZE> found{};
  unsigned int size = 0;
  EVP_DigestFinal_ex(context_, found.data(), &size);
  return {reinterpret_cast<const char*>(found.data()), size};
}

std::string hex(std::string_view bytes) {
  constexpr std::string_view digits = "0123456789abcdef";
  std::string text;
  for (const char c : bytes) {
    text += digits[static_cast<unsigned char>(c) >> 4U];
    text += digits[static_cast<unsigned char>(c) & 15U];
  }
  return text;
}

std::string base64(std::string_view bytes) {
  std::string text(4 * ((bytes.size() + 2) / 3) + 1, '\0');
  const int length =
      EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()),
                      reinterpret_cast<const unsigned char*>(bytes.data()), static_cast<int>(bytes.size()));
  text.resize(static_cast<std::size_t>(length));
  return text;
}

std::string digest_of(std::string_view bytes) {
  Digest digest;
  digest.add(bytes);
  return hex(digest.bytes());
}

std::string digest_of_file(const std::string& path, const std::function<void()>& meanwhile) {
  std::ifstream file(path, std::ios::binary);
  Digest digest;
  std::vector<char> buffer(1U << 20U);
  while (file.read(buffer.data(), static_cast<std::streamsize>(buffer.size())) || file.gcount() > 0) {
    digest.add({buffer.data(), static_cast<std::size_t>(file.gcount())});
    if (meanwhile) meanwhile();
  }
  if (!file.eof()) throw std::runtime_error(path + " cannot be read");
  return hex(digest.bytes());
}

std::string random_hex(std::size_t bytes) {
  std::vector<unsigned char> found(bytes);
  if (RAND_bytes(found.data(), static_cast<int>(bytes)) != 1)
    throw std::runtime_error("the system has no random numbers");
  return hex({reinterpret_cast<const char*>(found.data()), bytes});
}

}  // namespace sweepvi::service
