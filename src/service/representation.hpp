#pragma once

#include <filesystem>
#include <nlohmann/json.hpp>

#include <string>

#include "service/job.hpp"

namespace sweepvi::service {

/// A job as the interface shows it; see openapi.json, "Job".
nlohmann::ordered_json represent(const Job& job, const std::filesystem::path& folder);

/// The same in few words, for lists.
nlohmann::ordered_json represent_briefly(const Job& job);

/// As JSON text. What is not UTF-8 (a program may print anything) is replaced.
std::string text_of(const nlohmann::ordered_json& json);

}  // namespace sweepvi::service
