#include "service/job.hpp"

#include <algorithm>
#include <array>
#include <cmath>

namespace sweepvi::service {

using nlohmann::json;

namespace {

constexpr std::array<std::pair<State, const char*>, 6> state_names = {{{State::queued, "queued"},
                                                                       {State::running, "running"},
                                                                       {State::done, "done"},
                                                                       {State::failed, "failed"},
                                                                       {State::cancelled, "cancelled"},
                                                                       {State::interrupted, "interrupted"}}};

bool is_list_of_texts(const json& value) {
  return value.is_array() &&
         std::all_of(value.begin(), value.end(), [](const json& entry) { return entry.is_string(); });
}

}  // namespace

const char* name_of(State state) {
  for (const auto& [known, name] : state_names)
    if (known == state) return name;
  return "";
}

std::optional<State> state_named(const std::string& name) {
  for (const auto& [state, known] : state_names)
    if (known == name) return state;
  return std::nullopt;
}

bool at_rest(State state) {
  return state != State::queued && state != State::running;
}

std::string complaint_about(const json& work) {
  if (!work.is_object()) return "its work is no JSON object";
  const json none;
  const auto entry = [&](const char* key) -> const json& { return work.contains(key) ? work.at(key) : none; };
  const std::string verb = entry("verb").is_string() ? entry("verb").get<std::string>() : "";
  if (verb != "run" && verb != "solve" && verb != "study") return "its verb is none of run, solve, study";
  for (const char* key : {"set", "options"})
    if (!is_list_of_texts(entry(key))) return std::string("its '") + key + "' is no list of texts";
  for (const char* key : {"wall_limit", "memory"})
    if (!entry(key).is_number() || !(entry(key).get<double>() >= 0.0) ||
        !std::isfinite(entry(key).get<double>()))
      return std::string("its '") + key + "' is no limit";
  if (verb != "study") return {};
  const json& study = entry("study");
  const bool texts = study.is_object() && std::all_of(study.begin(), study.end(),
                                                      [](const json& value) { return value.is_string(); });
  if (!texts) return "its 'study' is no list of words";
  return entry("settings").is_null() || entry("settings").is_boolean() ? ""
                                                                       : "its 'settings' is not yes or no";
}

std::string notes_of(const Job& job) {
  const json notes = {{"id", job.id},
                      {"title", job.request.title},
                      {"ranks", job.request.ranks},
                      {"priority", job.request.priority},
                      {"work", job.request.work},
                      {"key", job.request.key},
                      {"digest", job.request.digest},
                      {"report", job.request.report},
                      {"owner", job.request.owner},
                      {"submitted", job.submitted}};
  return notes.dump(2, ' ', false, json::error_handler_t::replace) + "\n";
}

std::optional<Job> job_in_notes(const std::string& bytes) {
  const json notes = json::parse(bytes, nullptr, false);
  try {
    Job job;
    job.id = notes.at("id");
    job.request = {notes.at("title"),       notes.at("ranks"),  notes.at("priority"), notes.at("work"),
                   notes.at("key"),         notes.at("digest"), notes.at("report"),   0,
                   notes.value("owner", "")};
    job.submitted = notes.at("submitted");
    const bool good = job.id > 0 && job.request.ranks > 0 && complaint_about(job.request.work).empty();
    return good ? std::optional(job) : std::nullopt;
  } catch (const json::exception&) {
    return std::nullopt;
  }
}

}  // namespace sweepvi::service
