#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "io/output_file.hpp"
#include "io/table_mark.hpp"

namespace sweepvi {

/// What a run needs to go on from where it was: the contents of a checkpoint, which stands in a file of its
/// own while the run lasts, and in a stopped file as the dataset /checkpoint. Plain data, on one rank.
///
/// As bytes: the line "sweepvi checkpoint 1" (the version of this format), the length of the header (8 bytes,
/// little-endian like all numbers), the header (JSON: `facts`, names and lengths of the arrays), the arrays
/// one after the other, a checksum of all before it (8 bytes).
struct CheckpointData {
  nlohmann::json facts =
      nlohmann::json::object();  ///< small things; no doubles, JSON may not keep their bits
  std::map<std::string, std::vector<double>> numbers;
  std::map<std::string, std::vector<std::uint64_t>> integers;

  void put(const TableMark& mark);
  TableMark mark() const;
};

std::vector<std::byte> encode(const CheckpointData& data);
/// @param name  of the file, for messages
/// @throws Error (bad_input): not a checkpoint, of another format, cut short, damaged
CheckpointData decode(std::span<const std::byte> bytes, const std::string& name);

/// The file of a run's checkpoints, with room on the disk for the next one: that can be written when the disk
/// is full. On one rank.
class CheckpointFile {
public:
  explicit CheckpointFile(const std::string& path) : path_(path), room_(path) {}

  const std::string& path() const { return path_; }
  /// Takes room for one of so many bytes, and a little more. @throws Error (output), with nothing left behind
  void reserve(std::uint64_t bytes);
  /// Writes the file under another name, makes it durable and gives it its name: what bears it is complete,
  /// and an older one stays until then. Takes room for the next one, if there is some.
  /// @throws Error (output)
  void write(std::span<const std::byte> bytes);
  /// Removes it, and what a killed run left of one. @throws Error (output)
  void remove() const;

private:
  std::string unfinished() const { return path_ + ".new"; }

  std::string path_;
  ReservedRoom room_;
};

/// The checkpoint that `path` is, or that it holds if it is a stopped output file.
/// @throws Error (bad_input): no such file, nothing to go on from, or as `decode`
CheckpointData read_checkpoint(const std::string& path);

}  // namespace sweepvi
