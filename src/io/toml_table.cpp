#include "io/toml_table.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <optional>
#include <sstream>
#include <tuple>

#include "io/checksum.hpp"
#include "io/confinement.hpp"
#include "io/toml_library.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

struct TomlValue::Document {
  std::string file;
  bool load_files = false;
  toml::table root;
  std::map<const void*, std::vector<std::string>> asked;  ///< per table, in the order of asking
};

namespace {

constexpr std::string_view override_mark = "--set ";

const toml::node* as_node(const void* node) {
  return static_cast<const toml::node*>(node);
}

/// Long values are cut, between characters.
std::string shortened(const std::string& text) {
  std::size_t length = 48;
  if (text.size() <= length) return text;
  while (length > 0 && (static_cast<unsigned char>(text[length]) & 0xC0U) == 0x80U)
    --length;
  return text.substr(0, length) + "...";
}

/// "= 1.7" or "is a table", to go behind a key.
std::string found(const toml::node& node) {
  if (const auto* value = node.as_string()) return fmt::format("= \"{}\"", shortened(value->get()));
  if (const auto* value = node.as_integer()) return fmt::format("= {}", value->get());
  if (const auto* value = node.as_floating_point()) return fmt::format("= {}", value->get());
  if (const auto* value = node.as_boolean()) return fmt::format("= {}", value->get());
  if (node.is_array()) return "is an array";
  return node.is_table() ? "is a table" : "is a date or a time";
}

bool is_override(const toml::source_region& source) {
  return source.path && std::string_view(*source.path).starts_with(override_mark);
}

std::string place(const std::string& file, const toml::source_region& source) {
  if (is_override(source)) return *source.path;
  return source.begin ? fmt::format("{}:{}:{}", file, source.begin.line, source.begin.column) : file;
}

/// toml++ limits how deep values nest, but not the tables that a dotted key makes; it destroys them
/// recursively.
void refuse_deep_keys(const std::string& text, const std::string& label) {
  constexpr int most_words = 1000;
  int words = 1;
  int line = 1;
  for (const char c : text) {
    if (c == '\n') ++line;
    if (c == '.') ++words;
    if (std::string_view("\n=,[]{}").find(c) != std::string_view::npos) words = 1;
    if (words > most_words)
      throw InputError(fmt::format("{}:{}: more than {} dots in a row; keys do not nest that deep", label,
                                   line, most_words));
  }
}

std::vector<std::string> split_key(const std::string& key, const std::string& label) {
  std::vector<std::string> words(1);
  for (const char c : key) {
    if (c == '.') {
      words.emplace_back();
    } else {
      words.back() += c;
    }
  }
  for (const std::string& word : words) {
    const bool bare = std::all_of(word.begin(), word.end(), [](unsigned char c) {
      return c < 0x80 && (std::isalnum(c) != 0 || c == '_' || c == '-');
    });
    if (word.empty() || !bare)
      throw InputError(fmt::format(
          "{}: '{}' is not a key; expected words of letters, digits, - and _ with dots between", label, key));
  }
  return words;
}

/// The table that "key = value" makes; nothing if that is not TOML, or more than one value.
std::optional<toml::table> parse_assignment(const std::vector<std::string>& words, const std::string& key,
                                            const std::string& value, const std::string& label) {
  try {
    toml::table parsed = toml::parse(key + " = " + value, label);
    const toml::table* level = &parsed;
    for (std::size_t i = 0; i < words.size(); ++i) {
      if (level == nullptr || level->size() != 1) return std::nullopt;
      level = level->begin()->second.as_table();
    }
    return parsed;
  } catch (const toml::parse_error&) {
    return std::nullopt;
  }
}

void override_value(toml::table& root, const std::string& key, const std::string& value) {
  const std::string label = fmt::format("{}{}={}", override_mark, key, shortened(value));
  refuse_deep_keys(key, label);
  refuse_deep_keys(value, label);
  const std::vector<std::string> words = split_key(key, label);
  std::optional<toml::table> parsed = parse_assignment(words, key, value, label);
  if (!parsed) {  // a string without quotes
    parsed = toml::parse(key + " = ''", label);
    toml::node* node = &*parsed;
    for (const std::string& word : words)
      node = node->as_table()->get(word);
    node->as_string()->get() = value;
  }
  toml::table* to = &root;
  toml::table* from = &*parsed;
  for (std::size_t i = 0; i < words.size(); ++i) {
    toml::node* ours = to->get(words[i]);
    toml::node* theirs = from->get(words[i]);
    if (ours == nullptr || i + 1 == words.size()) {
      // Moved, not copied: a copy forgets where it came from.
      theirs->visit([&](auto& node) { to->insert_or_assign(words[i], std::move(node)); });
      return;
    }
    if (!ours->is_table())
      throw InputError(fmt::format(
          "{}: {} {}, not a table", label,
          fmt::join(words.begin(), words.begin() + static_cast<std::ptrdiff_t>(i) + 1, "."), found(*ours)));
    to = ours->as_table();
    from = theirs->as_table();
  }
}

}  // namespace

TomlValue TomlValue::parse(const std::string& file, const std::string& text,
                           const std::vector<std::pair<std::string, std::string>>& overrides,
                           bool load_files) {
  auto document = std::make_shared<Document>();
  document->file = file;
  document->load_files = load_files;
  refuse_deep_keys(text, file);
  try {
    document->root = toml::parse(text, file);
  } catch (const toml::parse_error& error) {
    throw InputError(fmt::format("{}: not valid TOML: {}", place(file, error.source()), error.description()));
  }
  for (const auto& [key, value] : overrides)
    override_value(document->root, key, value);
  const toml::node* root = &document->root;
  return TomlValue(std::move(document), root, nullptr, "");
}

TomlValue TomlValue::operator[](std::string_view key) const {
  std::string name = name_.empty() ? std::string(key) : fmt::format("{}.{}", name_, key);
  if (node_ == nullptr) return TomlValue(document_, nullptr, nullptr, std::move(name));
  const toml::table* table = as_node(node_)->as_table();
  if (table == nullptr) fail_kind("a table");
  std::vector<std::string>& asked = document_->asked[node_];
  if (std::find(asked.begin(), asked.end(), key) == asked.end()) asked.emplace_back(key);
  return TomlValue(document_, table->get(key), node_, std::move(name));
}

TomlValue TomlValue::entry(std::size_t index) const {
  const toml::array& array = *as_node(node_)->as_array();
  return TomlValue(document_, array.get(index), node_, fmt::format("{}[{}]", name_, index));
}

std::size_t TomlValue::size() const {
  return as_node(node_)->as_array()->size();
}

std::vector<TomlValue> TomlValue::tables() const {
  if (!is_array()) fail_kind("tables, each under [[" + name_ + "]]");
  std::vector<TomlValue> found;
  for (std::size_t i = 0; i < size(); ++i) {
    found.push_back(entry(i));
    if (!found.back().is_table()) found.back().fail_kind("a table");
  }
  return found;
}

std::optional<double> TomlValue::plain_number(std::size_t index) const {
  const toml::node* node = as_node(node_)->as_array()->get(index);
  if (node->is_integer()) return static_cast<double>(node->as_integer()->get());
  if (node->is_floating_point() && std::isfinite(node->as_floating_point()->get()))
    return node->as_floating_point()->get();
  return std::nullopt;
}

void TomlValue::refuse_unknown() const {
  if (node_ == nullptr) return;
  const toml::table* table = as_node(node_)->as_table();
  if (table == nullptr) fail_kind("a table");
  const std::vector<std::string>& asked = document_->asked[node_];
  // toml++ sorts keys by name; people read from the top.
  std::optional<std::tuple<toml::source_index, toml::source_index, std::string, std::string>> first;
  for (const auto& [key, node] : *table) {
    if (std::find(asked.begin(), asked.end(), key.str()) != asked.end()) continue;
    const toml::source_region& source = key.source().begin ? key.source() : node.source();
    auto unknown = std::tuple(source.begin.line, source.begin.column, place(document_->file, source),
                              std::string(key.str()));
    if (!first || unknown < *first) first = std::move(unknown);
  }
  if (!first) return;
  const auto& [line, column, position, key] = *first;
  throw InputError(fmt::format("{}: {} has no key '{}'{}", position, name_.empty() ? "the file" : name_, key,
                               suggestion(key, asked)));
}

bool TomlValue::is_number() const {
  return node_ != nullptr && as_node(node_)->is_number();
}
bool TomlValue::is_string() const {
  return node_ != nullptr && as_node(node_)->is_string();
}
bool TomlValue::is_array() const {
  return node_ != nullptr && as_node(node_)->is_array();
}
bool TomlValue::is_table() const {
  return node_ != nullptr && as_node(node_)->is_table();
}
bool TomlValue::overridden() const {
  return node_ != nullptr && is_override(as_node(node_)->source());
}

bool TomlValue::names_file() const {
  if (is_string()) return true;
  const toml::table* table = node_ == nullptr ? nullptr : as_node(node_)->as_table();
  return table != nullptr && (table->contains("file") || table->contains("dataset"));
}

bool TomlValue::elsewhere() const {
  return names_file() && !document_->load_files;
}

std::string TomlValue::where() const {
  const void* node = node_ != nullptr ? node_ : parent_;
  return node == nullptr ? document_->file : place(document_->file, as_node(node)->source());
}

void TomlValue::fail(const std::string& complaint) const {
  throw InputError(fmt::format("{}: {} {}", where(), name_, complaint));
}

void TomlValue::fail_kind(const std::string& expected) const {
  fail(fmt::format("{}; expected {}", node_ == nullptr ? "is missing" : found(*as_node(node_)), expected));
}

double TomlValue::checked(bool infinity) const {
  const toml::node* node = as_node(node_);
  if (node != nullptr && node->is_integer()) return static_cast<double>(node->as_integer()->get());
  if (node == nullptr || !node->is_floating_point())
    fail_kind(infinity ? "a number, inf or -inf" : "a number");
  const double value = node->as_floating_point()->get();
  if (std::isnan(value) || (std::isinf(value) && !infinity))
    fail(fmt::format("= {}; expected a {}number", value, infinity ? "" : "finite "));
  return value;
}

double TomlValue::number() const {
  return checked(false);
}
double TomlValue::number_or_infinity() const {
  return checked(true);
}

std::int64_t TomlValue::integer() const {
  const toml::node* node = as_node(node_);
  if (node != nullptr && node->is_integer()) return node->as_integer()->get();
  if (node != nullptr && node->is_floating_point()) {
    const double value = node->as_floating_point()->get();
    if (std::abs(value) < 9007199254740992.0 && value == std::round(value))
      return static_cast<std::int64_t>(value);
  }
  fail_kind("an integer");
}

bool TomlValue::boolean() const {
  if (node_ == nullptr || !as_node(node_)->is_boolean()) fail_kind("true or false");
  return as_node(node_)->as_boolean()->get();
}

std::string TomlValue::string() const {
  if (!is_string()) fail_kind(overridden() ? "a string; put it in double quotes" : "a string");
  return as_node(node_)->as_string()->get();
}

std::string TomlValue::path() const {
  std::string path = string();
  if (path.empty()) fail("= \"\"; expected the name of a file");
  if (files_are_confined()) {
    const std::optional<std::string> file = confined_file(path);
    if (!file)
      fail(fmt::format("= \"{}\" is no file that came with the document; hand it in, too", shortened(path)));
    return *file;
  }
  return target();
}

std::string TomlValue::target() const {
  const std::string path = string();
  if (overridden()) return path;
  return (std::filesystem::path(document_->file).parent_path() / path).string();
}

std::string TomlValue::choice(const std::vector<std::string>& built, bool optional) const {
  if (node_ == nullptr && optional) return built.front();
  const std::string available = fmt::format("\"{}\"", fmt::join(built, "\", \""));
  if (!is_string()) fail_kind((built.size() > 1 ? "one of " : "") + available);
  std::string value = string();
  if (std::find(built.begin(), built.end(), value) != built.end()) return value;
  const std::string quoted = fmt::format("= \"{}\"", shortened(value));
  fail(fmt::format("{} is unknown{}", quoted, suggestion(value, built)));
}

namespace {

/// Numbers as such: 2000 and 2e3 are the same.
std::string text_of(const toml::node& node) {
  if (const auto* value = node.as_string()) return fmt::format("\"{}\"", value->get());
  if (const auto* value = node.as_boolean()) return fmt::format("{}", value->get());
  if (const auto* value = node.as_integer()) return fmt::format("{}", static_cast<double>(value->get()));
  if (const auto* value = node.as_floating_point()) return fmt::format("{}", value->get());
  std::string text;
  const auto add = [&text](const std::string& part) { text += (text.empty() ? "" : ", ") + part; };
  if (const auto* array = node.as_array()) {
    for (const toml::node& entry : *array)
      add(text_of(entry));
    return "[" + text + "]";
  }
  if (const auto* table = node.as_table()) {
    for (const auto& [key, entry] : *table)
      add(fmt::format("{} = {}", key.str(), text_of(entry)));
    return "{" + text + "}";
  }
  return "a date or a time";
}

std::string digest(std::string_view bytes) {
  std::vector<std::uint64_t> words((bytes.size() + 7) / 8, 0);
  std::memcpy(words.data(), bytes.data(), bytes.size());
  const auto* first = reinterpret_cast<const std::byte*>(words.data());
  return fmt::format("{} bytes, checksum {:016x}", bytes.size(), checksum(first, words.size(), 8, 0));
}

}  // namespace

std::map<std::string, std::string> TomlValue::flattened() const {
  std::map<std::string, std::string> result;
  if (node_ == nullptr) return result;
  const toml::node& node = *as_node(node_);
  if (const toml::table* table = node.as_table()) {
    for (const auto& [key, entry] : *table)
      result.merge(TomlValue(document_, &entry, node_,
                             name_.empty() ? std::string(key.str()) : fmt::format("{}.{}", name_, key.str()))
                       .flattened());
    return result;
  }
  std::error_code failure;
  const bool may_be_file =
      node.is_string() && !string().empty() && (!files_are_confined() || confined_file(string()));
  if (may_be_file && std::filesystem::is_regular_file(path(), failure)) {
    std::ifstream file(path(), std::ios::binary);
    std::stringstream bytes;
    bytes << file.rdbuf();
    result[name_] = "a file of " + digest(bytes.view());
    return result;
  }
  constexpr std::size_t line = 80;
  const std::string text = text_of(node);
  result[name_] = text.size() <= line ? text : "an array of " + digest(text);
  return result;
}

}  // namespace sweepvi
