#include "app/allowed_options.hpp"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <map>
#include <sstream>
#include <string_view>

namespace sweepvi::app {

namespace {

enum class Value { none, word, number };

const std::map<std::string_view, Value>& allowed() {
  static const std::map<std::string_view, Value> options = {{"-sweepvi_target_rtol", Value::number},
                                                            {"-sweepvi_predictor", Value::word},
                                                            {"-sweepvi_linearisation", Value::word},
                                                            {"-sweepvi_halvings", Value::number},
                                                            {"-sweepvi_zi_sweeps", Value::number},
                                                            {"-sweepvi_form", Value::word},
                                                            {"-snes_type", Value::word},
                                                            {"-snes_rtol", Value::number},
                                                            {"-snes_atol", Value::number},
                                                            {"-snes_stol", Value::number},
                                                            {"-snes_max_it", Value::number},
                                                            {"-snes_max_funcs", Value::number},
                                                            {"-snes_linesearch_type", Value::word},
                                                            {"-snes_linesearch_order", Value::number},
                                                            {"-snes_linesearch_max_it", Value::number},
                                                            {"-snes_vi_zero_tolerance", Value::number},
                                                            {"-snes_monitor", Value::none},
                                                            {"-snes_vi_monitor", Value::none},
                                                            {"-snes_converged_reason", Value::none},
                                                            {"-snes_view", Value::none},
                                                            {"-ts_monitor", Value::none},
                                                            {"-ts_view", Value::none},
                                                            {"-ksp_monitor", Value::none},
                                                            {"-ksp_converged_reason", Value::none},
                                                            {"-ksp_view", Value::none},
                                                            {"-ksp_type", Value::word},
                                                            {"-ksp_rtol", Value::number},
                                                            {"-ksp_atol", Value::number},
                                                            {"-ksp_divtol", Value::number},
                                                            {"-ksp_max_it", Value::number},
                                                            {"-ksp_gmres_restart", Value::number},
                                                            {"-ksp_norm_type", Value::word},
                                                            {"-ksp_pc_side", Value::word},
                                                            {"-pc_type", Value::word},
                                                            {"-pc_factor_mat_solver_type", Value::word},
                                                            {"-pc_factor_mat_ordering_type", Value::word},
                                                            {"-pc_factor_levels", Value::number},
                                                            {"-pc_factor_fill", Value::number},
                                                            {"-pc_factor_shift_type", Value::word},
                                                            {"-pc_factor_shift_amount", Value::number},
                                                            {"-pc_factor_zeropivot", Value::number},
                                                            {"-pc_bjacobi_blocks", Value::number},
                                                            {"-pc_asm_overlap", Value::number},
                                                            {"-pc_asm_type", Value::word},
                                                            {"-sub_ksp_type", Value::word},
                                                            {"-sub_pc_type", Value::word},
                                                            {"-sub_pc_factor_mat_solver_type", Value::word},
                                                            {"-sub_pc_factor_mat_ordering_type", Value::word},
                                                            {"-sub_pc_factor_levels", Value::number},
                                                            {"-mat_mumps_icntl_6", Value::number},
                                                            {"-mat_mumps_icntl_7", Value::number},
                                                            {"-mat_mumps_icntl_8", Value::number},
                                                            {"-mat_mumps_icntl_10", Value::number},
                                                            {"-mat_mumps_icntl_14", Value::number},
                                                            {"-mat_mumps_icntl_24", Value::number},
                                                            {"-mat_mumps_icntl_28", Value::number},
                                                            {"-mat_mumps_icntl_29", Value::number},
                                                            {"-mat_mumps_cntl_1", Value::number},
                                                            {"-mat_mumps_cntl_3", Value::number},
                                                            {"-log_view", Value::none}};
  return options;
}

constexpr std::size_t longest_value = 40;

bool is_number(const std::string& text) {
  if (text.find_first_not_of("0123456789+-.eE") != std::string::npos || text.empty()) return false;
  char* end = nullptr;
  std::strtod(text.c_str(), &end);
  return *end == '\0';
}

bool is_word(const std::string& text) {
  return !text.empty() &&
         text.find_first_not_of("abcdefghijklmnopqrstuvwxyz0123456789_-") == std::string::npos &&
         text.front() != '-';
}

std::string printable(const std::string& text) {
  std::string shown = text.substr(0, longest_value);
  std::replace_if(
      shown.begin(), shown.end(), [](unsigned char c) { return c < 0x20 || c >= 0x7f; }, '?');
  return shown.size() < text.size() ? shown + "..." : shown;
}

}  // namespace

std::string why_refused(const std::vector<std::string>& words) {
  for (std::size_t i = 0; i < words.size(); ++i) {
    const auto option = allowed().find(words[i]);
    if (option == allowed().end())
      return "option '" + printable(words[i]) + "' may not be used here; see the list of allowed options";
    if (option->second == Value::none) continue;
    const bool number = option->second == Value::number;
    if (i + 1 == words.size() || words[i + 1].size() > longest_value ||
        !(number ? is_number(words[i + 1]) : is_word(words[i + 1])))
      return "option '" + words[i] + "' needs " + (number ? "a number" : "a word of a-z, 0-9, _ and -") +
             " after it";
    ++i;
  }
  return {};
}

std::string why_refused(const std::string& text) {
  // No quotes, comments or other ways to make PETSc see other words than these.
  constexpr std::string_view plain =
      "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_+-. \t\n";
  if (const std::size_t at = text.find_first_not_of(plain); at != std::string::npos)
    return "options may not have the character '" + printable(text.substr(at, 1)) + "' here";
  std::istringstream stream(text);
  std::vector<std::string> words;
  for (std::string word; stream >> word;)
    words.push_back(word);
  return why_refused(words);
}

}  // namespace sweepvi::app
