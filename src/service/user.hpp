#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace sweepvi::service {

/// Who has a token.
struct User {
  std::string
      name;  ///< of a-z, 0-9, _ and -; empty: whoever has the only token, or anybody where there is none
  std::string token;      ///< empty: none is asked for
  bool admin = false;     ///< sees all jobs; others see those that they have handed in
  std::int64_t jobs = 0;  ///< that may be kept; 0: as many as all together
  std::int64_t disk = 0;  ///< of them [B]; 0: likewise
};

/// Who sees all, by a token that everybody has; without one anybody is.
inline User everybody(std::string token = {}) {
  User user;
  user.token = std::move(token);
  user.admin = true;
  return user;
}

/// The users in a file that only its owner may read: lines `NAME TOKEN [admin] [max-jobs=N]
/// [max-disk=BYTES]`, empty ones and those that begin with # left out; or a single word, which is everybody's
/// token.
/// @throws UsageError
std::vector<User> read_users(const std::filesystem::path& path);

/// The token in a file with a single word. @throws UsageError
std::string read_token(const std::filesystem::path& path);

}  // namespace sweepvi::service
