#include "service/events.hpp"

#include <fmt/format.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "service/files.hpp"
#include "service/representation.hpp"
#include "service/work.hpp"

namespace sweepvi::service {

namespace {

constexpr auto pause = std::chrono::milliseconds(200);
constexpr double longest_silence = 10.0;  // s; a comment then, so that a dead connection is found out
constexpr std::size_t most_at_once = 1U << 16U;

std::string event(std::int64_t id, const char* name, const std::string& data) {
  return fmt::format("id: {}\nevent: {}\ndata: {}\n\n", id, name, data);
}

}  // namespace

Events::Events(const Queue& queue, std::filesystem::path folder, std::int64_t id, std::int64_t last)
    : queue_(queue), folder_(std::move(folder)), id_(id), seen_(last) {
  // A file that is shorter than what was seen is another one.
  std::error_code none;
  const std::uintmax_t size = std::filesystem::file_size(folder_ / progress_file, none);
  if (none || seen_ > static_cast<std::int64_t>(size)) seen_ = 0;
}

std::string Events::new_lines() {
  std::ifstream file(folder_ / progress_file, std::ios::binary);
  if (!file || !file.seekg(seen_)) return {};
  std::string bytes(most_at_once, '\0');
  file.read(bytes.data(), static_cast<std::streamsize>(bytes.size()));
  bytes.resize(static_cast<std::size_t>(file.gcount()));
  std::string text;
  for (std::size_t begin = 0;;) {
    const std::size_t end = bytes.find('\n', begin);  // what has no end yet is still being written
    if (end == std::string::npos) return text;
    seen_ += static_cast<std::int64_t>(end + 1 - begin);
    text += event(seen_, "progress", bytes.substr(begin, end - begin));
    begin = end + 1;
  }
}

bool Events::next(const std::function<bool(const std::string&)>& send) {
  // The state first: lines that are there when a job is at rest are all there are.
  const std::optional<Job> job = queue_.find(id_);
  if (!job) return false;
  std::string text;
  for (std::string lines = new_lines(); !lines.empty(); lines = new_lines())
    text += lines;
  const std::string state = fmt::format("{} {} {}", name_of(job->state), job->attempt, job->stop_asked);
  const bool last = at_rest(job->state);
  if (state != told_ || last) {
    told_ = state;
    text += event(seen_, last ? "end" : "state", text_of(represent(*job, folder_)));
  }
  if (text.empty() && ticks() - spoke_ > longest_silence) text = ": still here\n\n";
  if (!text.empty()) {
    spoke_ = ticks();
    if (!send(text)) return false;
  }
  if (!last) std::this_thread::sleep_for(pause);
  return !last;
}

}  // namespace sweepvi::service
