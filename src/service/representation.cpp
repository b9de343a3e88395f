#include "service/representation.hpp"

#include "service/files.hpp"
#include "service/work.hpp"

namespace sweepvi::service {

using nlohmann::ordered_json;

namespace {

ordered_json time_of(const std::optional<double>& time) {
  return time ? ordered_json(utc(*time)) : ordered_json();
}

ordered_json number_of(const std::optional<int>& number) {
  return number ? ordered_json(*number) : ordered_json();
}

/// The last line of the progress file; null if there is none.
ordered_json progress_in(const std::filesystem::path& folder) {
  constexpr std::size_t enough = 2000;
  std::string tail = read_tail(folder / progress_file, enough);
  tail.resize(tail.rfind('\n') == std::string::npos ? 0 : tail.rfind('\n'));
  const std::size_t begin = tail.rfind('\n') == std::string::npos ? 0 : tail.rfind('\n') + 1;
  ordered_json line = ordered_json::parse(tail.substr(begin), nullptr, false);
  return line.is_discarded() ? ordered_json() : line;
}

ordered_json summary_in(const std::filesystem::path& folder) {
  const std::optional<std::string> text = read_file(folder / summary_file);
  ordered_json summary = ordered_json::parse(text.value_or(""), nullptr, false);
  return summary.is_discarded() ? ordered_json() : summary;
}

}  // namespace

std::string text_of(const ordered_json& json) {
  return json.dump(-1, ' ', false, ordered_json::error_handler_t::replace);
}

ordered_json represent_briefly(const Job& job) {
  ordered_json json;
  json["id"] = job.id;
  json["state"] = name_of(job.state);
  json["name"] = job.request.title;
  json["owner"] = job.request.owner;
  json["verb"] = job.request.work.at("verb");
  json["ranks"] = job.request.ranks;
  json["priority"] = job.request.priority;
  json["submitted"] = utc(job.submitted);
  json["started"] = time_of(job.started);
  json["finished"] = time_of(job.finished);
  json["attempt"] = job.attempt;
  json["stopping"] = job.stop_asked && job.state == State::running;
  json["exit"] = number_of(job.exit);
  json["signal"] = number_of(job.signal);
  json["message"] = job.message;
  json["result"] = nullptr;
  if (job.result_bytes > 0) json["result"] = {{"bytes", job.result_bytes}, {"sha256", job.result_sha256}};
  return json;
}

ordered_json represent(const Job& job, const std::filesystem::path& folder) {
  ordered_json json = represent_briefly(job);
  json["set"] = job.request.work.at("set");
  json["options"] = job.request.work.at("options");
  json["wall_limit"] = job.request.work.at("wall_limit");
  json["memory"] = job.request.work.at("memory");
  json["check"] = job.request.report;
  json["checkpoint"] = has_checkpoint(folder);
  json["progress"] = progress_in(folder);
  json["summary"] = at_rest(job.state) ? summary_in(folder) : ordered_json();
  return json;
}

}  // namespace sweepvi::service
