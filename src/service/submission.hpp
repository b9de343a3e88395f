#pragma once

#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "service/digest.hpp"
#include "service/job.hpp"
#include "service/settings.hpp"

namespace sweepvi::service {

/// A matrix that comes with a scene: under a number, whatever it is called.
struct Upload {
  std::string name;  ///< what the scene calls it
  std::string path;  ///< in the job's folder
  std::string sha256;
};

/// A request for a job while it comes in, part by part: the description (JSON), and files. Everything is in
/// one folder from the beginning.
class Submission {
public:
  Submission(std::filesystem::path folder, const Settings& settings);

  // Parts, in any order.
  void add_description(std::string_view bytes);
  /// @throws Refusal (400): not a name of a file; (400) too many of them
  void begin_file(const std::string& name);
  /// @throws Refusal (507) if the disk is full
  void add_to_file(std::string_view bytes);

  /// Reads the description and puts scene and settings into the folder.
  /// @param key  idempotency key; empty: none
  /// @throws Refusal (400) naming what is wrong with it
  Request finish(const std::string& key);

private:
  void end_file();

  std::filesystem::path folder_;
  const Settings& settings_;
  std::string description_;
  std::vector<Upload> uploads_;
  std::ofstream file_;
  std::unique_ptr<Digest> digest_;
};

/// The part of a description that a resumption may change (options, set, wall_limit, memory), put into
/// `work`: each key and each option has the value that was given last.
/// @return whether there was anything
/// @throws Refusal (400)
bool change_work(const std::string& body, nlohmann::json& work, const Settings& settings);

}  // namespace sweepvi::service
