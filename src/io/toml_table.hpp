#pragma once

#include <mpi.h>

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "io/sparse_entries.hpp"
#include "sweepvi/signal.hpp"

namespace sweepvi {

/// A value of a TOML document, or the place where one could be.
///
/// Knows its dotted key, file, line and column, so that every complaint names them. A table remembers which
/// keys it was asked for: these are the keys it has, and refuse_unknown() complains about all others. Copies
/// are cheap and share the document. Readers throw Error (bad_input) if the value is absent or of another
/// kind.
class TomlValue {
public:
  /// The outermost table.
  /// @param file        path of the document: for messages, and its folder is where files it names are looked
  /// for
  /// @param overrides   (dotted key, TOML or a string without quotes): they replace what the document says
  /// @param load_files  whether matrices and vectors kept in files are read; otherwise they are empty
  static TomlValue parse(const std::string& file, const std::string& text,
                         const std::vector<std::pair<std::string, std::string>>& overrides, bool load_files);

  /// Whether the document has it.
  explicit operator bool() const { return node_ != nullptr; }
  /// The value of `key` in this table, absent if the table is.
  TomlValue operator[](std::string_view key) const;
  /// Complains about the first key of this table that nobody asked for.
  void refuse_unknown() const;

  bool is_number() const;
  bool is_string() const;
  bool is_array() const;
  bool is_table() const;
  /// It is the name of a matrix or vector kept in a file: a string, or {file, dataset}, the dataset where one
  /// is needed.
  bool names_file() const;
  /// It came from `--set`.
  bool overridden() const;
  /// It is kept in a file that this rank does not read; numbers(), signals() and matrix() return nothing.
  bool elsewhere() const;

  double number() const;  ///< finite
  double number_or(double otherwise) const { return *this ? number() : otherwise; }
  double number_or_infinity() const;  ///< anything but NaN
  std::int64_t integer() const;       ///< 1e3 is one, too
  bool boolean() const;
  std::string string() const;
  std::string string_or(const std::string& otherwise) const { return *this ? string() : otherwise; }
  /// A path seen from the working directory: names in a document start at its folder, `--set` at ours.
  /// @throws Error (bad_input) if files are confined and it is not on the list
  std::string path() const;
  /// The same for a file to be written; no list is asked.
  std::string target() const;
  /// One of `built`, or `built.front()` if absent and `optional`.
  std::string choice(const std::vector<std::string>& built, bool optional) const;

  Signal signal() const;                            ///< a number or {offset, amplitude, frequency, phase}
  Signal signal(double& phase_spread) const;        ///< the same, where its phase may differ between elements
  std::vector<double> numbers() const;              ///< an array or a file
  std::vector<double> numbers_or_infinity() const;  ///< the same; infinite entries are welcome
  std::vector<Signal> signals() const;              ///< an array of signals, or a file of numbers
  std::vector<Signal> signals_or_infinity() const;  ///< the same; infinite numbers are welcome
  SparseEntries matrix() const;                     ///< an array of rows, or a file; zeros are left out

  std::vector<TomlValue> tables() const;  ///< an array of tables, [[name]]

  /// Every value at or below this one, as dotted key and text, in one form whatever way it is written. Of
  /// arrays longer than a line and of files that strings name: a checksum.
  std::map<std::string, std::string> flattened() const;

  const std::string& name() const { return name_; }  ///< dotted key
  /// Throws "file:line:column: name complaint"; `complaint` may start with "= found value".
  [[noreturn]] void fail(const std::string& complaint) const;

private:
  struct Document;
  TomlValue(std::shared_ptr<Document> document, const void* node, const void* parent, std::string name)
      : document_(std::move(document)), node_(node), parent_(parent), name_(std::move(name)) {}

  std::string where() const;
  std::size_t size() const;  ///< entries of an array
  TomlValue entry(std::size_t index) const;
  /// The same as entry(index).number() if that is finite, without building names: arrays can be long.
  std::optional<double> plain_number(std::size_t index) const;
  [[noreturn]] void fail_kind(const std::string& expected) const;
  double checked(bool infinity) const;
  std::vector<double> read_numbers(bool infinity) const;
  std::vector<Signal> read_signals(bool infinity) const;
  /// read(file, dataset), with this value's place in complaints; nothing if the file is elsewhere().
  template <class Read>
  auto read_file(Read&& read) const -> decltype(read(std::string(), std::string()));

  std::shared_ptr<Document> document_;
  const void*
      node_;  ///< toml::node, null if absent; toml++ itself stays in one .cpp, because it is slow to compile
  const void* parent_;  ///< the table or array around it, null if absent too
  std::string name_;
};

/// The member of `known` with the least edit distance from `name`; a change of case counts half. Empty if
/// none is known.
std::string nearest_name(std::string_view name, const std::vector<std::string>& known);

/// "; did you mean 'mass'?", or a list of what is known if nothing is close.
std::string suggestion(std::string_view name, const std::vector<std::string>& known);

/// The bytes of a text file.
/// @throws Error (bad_input): missing, unreadable, a folder, longer than 1 GiB
std::string read_text(const std::string& path);

/// The same, read by rank 0.
/// @throws Error (bad_input) on every rank: missing, unreadable, a folder.  @note Collective on `comm`.
std::string read_shared_text(MPI_Comm comm, const std::string& path);

}  // namespace sweepvi
