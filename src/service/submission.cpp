#include "service/submission.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <cmath>

#include "app/allowed_options.hpp"
#include "io/output_file.hpp"
#include "io/printable.hpp"
#include "service/description.hpp"
#include "service/files.hpp"
#include "service/refusal.hpp"
#include "service/work.hpp"

namespace sweepvi::service {

using nlohmann::json;

namespace {

constexpr std::size_t most_files = 100;
constexpr std::size_t longest_name = 255;
constexpr std::size_t longest_scene = 16U << 20U;
constexpr std::size_t longest_key = 200;
constexpr int highest_priority = 1000;

// A name is never used as a path; but people read it.
void check_name(const std::string& name) {
  if (name.empty() || name.size() > longest_name || printable(name) != name)
    Description::refuse("a file needs a name of 1 to 255 characters that can be printed");
}

bool is_option_name(const std::string& word) {
  return word.size() > 1 && word[0] == '-' && std::isalpha(static_cast<unsigned char>(word[1])) != 0;
}

/// The words of each option, by its name in the order in which they came; a later one stands for an earlier
/// one.
std::vector<std::vector<std::string>> by_option(const std::vector<std::string>& words) {
  std::vector<std::vector<std::string>> options;
  for (std::size_t i = 0; i < words.size(); ++i) {
    std::vector<std::string> option = {words[i]};
    if (i + 1 < words.size() && !is_option_name(words[i + 1])) option.push_back(words[++i]);
    std::erase_if(options, [&](const auto& earlier) { return earlier[0] == option[0]; });
    options.push_back(std::move(option));
  }
  return options;
}

std::string key_of(const std::string& change) {
  std::string key = change.substr(0, change.find('='));
  std::erase_if(key, [](unsigned char c) { return std::isspace(c) != 0; });
  return key;
}

// Resumed again and again a job keeps one value for each key and each option, or its words would in the end
// be more than a system starts a program with.
void take_options(const Description& given, json& work) {
  constexpr std::size_t most = 200;
  constexpr std::size_t most_bytes = std::size_t{256} << 10;
  const std::vector<std::string> added = given.words("options");
  if (const std::string refused = app::why_refused(added); !refused.empty()) Description::refuse(refused);
  std::vector<std::string> changes = work.at("set");
  for (const std::string& change : given.words("set")) {
    const std::size_t equals = change.find('=');
    if (equals == std::string::npos || equals == 0)
      Description::refuse("'set' has '" + printable(change.substr(0, 40)) +
                          "'; expected key=value, as in time.step=1e-3");
    std::erase_if(changes, [&](const std::string& earlier) { return key_of(earlier) == key_of(change); });
    changes.push_back(change);
  }
  std::vector<std::string> words = work.at("options");
  words.insert(words.end(), added.begin(), added.end());
  const std::vector<std::vector<std::string>> options = by_option(words);
  if (changes.size() > most || options.size() > most)
    Description::refuse(fmt::format("more than {} keys are set, or more than {} options", most, most));
  work["set"] = changes;
  work["options"] = json::array();
  for (const std::vector<std::string>& option : options)
    for (const std::string& word : option)
      work["options"].push_back(word);
  if (work["set"].dump().size() + work["options"].dump().size() > most_bytes)
    Description::refuse(fmt::format("'set' and 'options' have more than {} bytes together", most_bytes));
}

void take_limits(const Description& given, json& work, const Settings& settings) {
  constexpr double year = 366.0 * 86400.0;
  const bool bounded = settings.wall > 0.0;
  const double wall =
      given.number("wall_limit", bounded ? settings.wall : 0.0, 1e-3, bounded ? settings.wall : year);
  if (given.has("wall_limit") || !work.contains("wall_limit")) work["wall_limit"] = wall;
  constexpr std::int64_t most_memory = std::int64_t{1} << 50;
  const std::int64_t memory =
      given.integer("memory", settings.memory, 1, settings.memory > 0 ? settings.memory : most_memory);
  if (given.has("memory") || !work.contains("memory")) work["memory"] = memory;
}

json study_of(const Description& given) {
  json study = json::object();
  for (const char* key : {"steps", "tolerances", "components"})
    if (const std::string list = given.numbers(key); !list.empty()) study[key] = list;
  std::string schemes;
  for (const std::string& scheme : given.words("schemes"))
    schemes += (schemes.empty() ? "" : ",") + scheme;
  if (!schemes.empty()) study["schemes"] = schemes;
  if (given.has("repeats")) study["repeats"] = fmt::format("{}", given.integer("repeats", 3, 1, 1000));
  if (given.has("reference"))
    study["reference"] = fmt::format("{}", given.number("reference", 1.0, 1e-300, 1e300));
  return study;
}

}  // namespace

Submission::Submission(std::filesystem::path folder, const Settings& settings)
    : folder_(std::move(folder)), settings_(settings) {}

void Submission::add_description(std::string_view bytes) {
  if (description_.size() + bytes.size() > 2 * longest_scene)
    throw Refusal(413, "the description is too long");
  description_ += bytes;
}

void Submission::begin_file(const std::string& name) {
  end_file();
  check_name(name);
  if (uploads_.size() == most_files) Description::refuse(fmt::format("more than {} files", most_files));
  if (std::any_of(uploads_.begin(), uploads_.end(),
                  [&](const Upload& upload) { return upload.name == name; }))
    Description::refuse("two files have the same name");
  // Who reads it tells by its content what it is; one that is called .mtx is complained about as such.
  const char* kind = name.ends_with(".mtx") ? "mtx" : "data";
  uploads_.push_back({name, fmt::format("upload-{}.{}", uploads_.size(), kind), {}});
  file_.open(folder_ / uploads_.back().path, std::ios::binary | std::ios::trunc);
  digest_ = std::make_unique<Digest>();
}

void Submission::add_to_file(std::string_view bytes) {
  file_.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  digest_->add(bytes);
  if (!file_) throw Refusal(507, "there is no room on the disk");
}

void Submission::end_file() {
  if (!digest_) return;
  file_.close();
  if (!file_) throw Refusal(507, "there is no room on the disk");
  uploads_.back().sha256 = hex(digest_->bytes());
  digest_.reset();
}

Request Submission::finish(const std::string& key) {
  end_file();
  if (key.size() > longest_key)
    Description::refuse(fmt::format("an idempotency key has more than {} bytes", longest_key));
  const Description given(description_);
  const std::string verb = given.text("verb", given.has("problem") ? "solve" : "run", 10);
  std::set<std::string> keys = {"verb",    "name",       "ranks",  "priority",
                                "options", "wall_limit", "memory", verb == "solve" ? "problem" : "scene"};
  if (verb != "solve") keys.insert("set");
  if (verb == "study")
    keys.insert({"steps", "schemes", "tolerances", "components", "repeats", "reference", "settings"});
  if (verb != "run" && verb != "solve" && verb != "study")
    Description::refuse("'verb' is none of run, solve, study");
  given.refuse_others(keys);

  Request request;
  request.key = key;
  const char* document = verb == "solve" ? "problem" : "scene";
  const std::string text = given.text(document, "", longest_scene);
  if (text.empty()) Description::refuse(fmt::format("there is no '{}': the text of a TOML file", document));
  request.title = given.text("name", verb == "solve" ? "problem.toml" : "scene.toml", longest_name);
  check_name(request.title);
  request.ranks = static_cast<int>(given.integer("ranks", 1, 1, settings_.cores));
  request.priority = static_cast<int>(given.integer("priority", 0, -highest_priority, highest_priority));
  request.work = {{"verb", verb}, {"set", json::array()}, {"options", json::array()}};
  take_options(given, request.work);
  take_limits(given, request.work, settings_);
  json names = json::object();
  std::string all = description_;
  for (const Upload& upload : uploads_) {
    names[upload.name] = upload.path;
    all += '\n' + upload.name + '\n' + upload.sha256;
  }
  write_output(folder_ / scene_file, text);
  write_output(folder_ / confine_file, names.dump());
  if (verb == "study") {
    if (!given.has("steps") && !given.has("tolerances"))
      Description::refuse("a study needs 'steps', or 'tolerances' for the scheme hybrid");
    request.work["study"] = study_of(given);
    const std::string settings = given.text("settings", "", longest_scene);
    request.work["settings"] = !settings.empty();
    if (!settings.empty()) write_output(folder_ / settings_file, settings);
  }
  request.digest = digest_of(all);
  request.bytes = size_below(folder_);
  return request;
}

bool change_work(const std::string& body, json& work, const Settings& settings) {
  if (body.empty()) return false;
  const Description given(body);
  std::set<std::string> keys = {"options", "wall_limit", "memory"};
  if (work.at("verb") != "solve") keys.insert("set");
  given.refuse_others(keys);
  take_options(given, work);
  take_limits(given, work, settings);
  return true;
}

}  // namespace sweepvi::service
