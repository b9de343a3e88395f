#pragma once

#include <map>
#include <set>
#include <string>
#include <vector>

namespace sweepvi::service {

/// A word with two dashes (or -o, -n) that a verb takes.
struct Option {
  std::string word;
  std::string value;  ///< what follows it; empty: nothing
  std::string text;
};

/// The words behind a verb.
class Arguments {
public:
  /// @param operands  how many plain words there may be
  /// @param rest_from the plain word, counted from 1, from which on all words are left alone; 0: none
  /// @throws UsageError for words that are not known, come twice or lack their value
  Arguments(const std::string& verb, const std::vector<std::string>& words,
            const std::vector<Option>& options, std::size_t operands, std::size_t rest_from = 0);

  bool has(const std::string& word) const { return values_.contains(word); }
  std::string get(const std::string& word, const std::string& otherwise = {}) const;
  /// A number from `least` to `most`; bytes may end in K, M, G or T (powers of 1024).
  double number(const std::string& word, double otherwise, double least, double most) const;
  const std::vector<std::string>& operands() const { return operands_; }
  const std::vector<std::string>& rest() const { return rest_; }  ///< begins with the word it starts from

private:
  std::map<std::string, std::string> values_;
  std::vector<std::string> operands_, rest_;
};

/// A number from `least` to `most`; bytes may end in K, M, G or T (powers of 1024).
/// @param what  is complained of: "--grace 1x"  @throws UsageError
double number_in(const std::string& what, const std::string& text, double least, double most);

/// A table of options as help shows it.
std::string option_table(const std::vector<Option>& options);

}  // namespace sweepvi::service
