#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace sweepvi::service {

/// The files that a scene or problem names for its matrices and vectors, and that are there.
struct NamedFile {
  std::string name;            ///< as the document has it
  std::filesystem::path path;  ///< seen from the working directory
};

/// @param changes  `--set key=value`; their files are seen from the working directory
/// @throws UsageError if it cannot be read; a document that is not TOML names none (its complaint comes from
/// those who know better)
std::vector<NamedFile> files_named_in(const std::string& document, const std::vector<std::string>& changes);

}  // namespace sweepvi::service
