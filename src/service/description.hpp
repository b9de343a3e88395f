#pragma once

#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <vector>

namespace sweepvi::service {

/// A JSON object from outside, read key by key. Every complaint is a Refusal (400) that names the key.
class Description {
public:
  explicit Description(std::string_view text);

  bool has(const char* key) const { return object_.contains(key); }
  /// @param longest  in bytes
  std::string text(const char* key, const std::string& otherwise, std::size_t longest) const;
  double number(const char* key, double otherwise, double least, double most) const;
  std::int64_t integer(const char* key, std::int64_t otherwise, std::int64_t least, std::int64_t most) const;
  std::vector<std::string> words(const char* key) const;
  /// Numbers as the command line has them: "1e-1,1e-2".
  std::string numbers(const char* key) const;

  /// Complains about keys that are none of these.
  void refuse_others(const std::set<std::string>& keys) const;

  [[noreturn]] static void refuse(const std::string& what);

private:
  nlohmann::json object_;
};

}  // namespace sweepvi::service
