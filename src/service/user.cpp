#include "service/user.hpp"

#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <sstream>

#include "service/arguments.hpp"
#include "service/files.hpp"
#include "service/refusal.hpp"

namespace sweepvi::service {

namespace {

constexpr std::size_t shortest_token = 16;

std::string read_secret(const std::filesystem::path& path) {
  struct stat about {};
  if (stat(path.c_str(), &about) != 0)
    throw UsageError(fmt::format("--token-file {}: {}", path.string(), std::strerror(errno)));
  if (!S_ISREG(about.st_mode) || (about.st_mode & 077U) != 0 || about.st_uid != geteuid())
    throw UsageError(
        fmt::format("--token-file {}: others may read it, or it is not yours; chmod 600 it", path.string()));
  return read_file(path).value_or("");
}

std::vector<std::string> words_of(const std::string& text) {
  std::istringstream stream(text);
  std::vector<std::string> words;
  for (std::string word; stream >> word;)
    words.push_back(word);
  return words;
}

bool is_name(const std::string& word) {
  constexpr std::size_t longest = 32;
  return !word.empty() && word.size() <= longest &&
         word.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_-") == std::string::npos;
}

/// @throws UsageError without the text of the line, which has a token
User user_in(const std::vector<std::string>& words, const std::string& where) {
  const auto refuse = [&](const std::string& what) { throw UsageError(where + what); };
  if (words.size() < 2) refuse("expected NAME TOKEN [admin] [max-jobs=N] [max-disk=BYTES]");
  if (!is_name(words[0])) refuse("a name has 1 to 32 of a-z, 0-9, _ and -");
  if (words[1].size() < shortest_token)
    refuse(fmt::format("a token has {} characters or more, as 'openssl rand -hex 32' makes them",
                       shortest_token));
  User user;
  user.name = words[0];
  user.token = words[1];
  for (std::size_t i = 2; i < words.size(); ++i) {
    constexpr double most = 1e18;
    if (words[i] == "admin")
      user.admin = true;
    else if (words[i].starts_with("max-jobs="))
      user.jobs = static_cast<std::int64_t>(number_in(where, words[i].substr(9), 1, most));
    else if (words[i].starts_with("max-disk="))
      user.disk = static_cast<std::int64_t>(number_in(where, words[i].substr(9), 1, most));
    else
      refuse(fmt::format("word {}: expected admin, max-jobs=N or max-disk=BYTES", i + 1));
  }
  return user;
}

}  // namespace

std::vector<User> read_users(const std::filesystem::path& path) {
  const std::string text = read_secret(path);
  if (words_of(text).size() == 1) return {everybody(read_token(path))};
  std::vector<User> users;
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    const std::vector<std::string> words = words_of(line);
    if (words.empty() || words[0].starts_with('#')) continue;
    const std::string where = fmt::format("--token-file {}:{}: ", path.string(), number);
    User user = user_in(words, where);
    for (const User& other : users)
      if (other.name == user.name || other.token == user.token)
        throw UsageError(where + "a name or a token that is in the file already");
    users.push_back(std::move(user));
  }
  if (users.empty())
    throw UsageError(
        fmt::format("--token-file {}: expected a word of {} characters or more, as 'openssl rand -hex 32' "
                    "makes them, or lines "
                    "NAME TOKEN",
                    path.string(), shortest_token));
  return users;
}

std::string read_token(const std::filesystem::path& path) {
  const std::vector<std::string> words = words_of(read_secret(path));
  if (words.size() != 1 || words[0].size() < shortest_token)
    throw UsageError(fmt::format(
        "--token-file {}: expected one word of {} characters or more, as 'openssl rand -hex 32' makes them",
        path.string(), shortest_token));
  return words[0];
}

}  // namespace sweepvi::service
