#include "service/files.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <sstream>
#include <system_error>
#include <thread>
#include <utility>

#include "service/database.hpp"

namespace sweepvi::service {

namespace fs = std::filesystem;

Descriptor::Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  Descriptor taken(std::move(other));
  std::swap(number_, taken.number_);
  return *this;
}

Descriptor::~Descriptor() {
  close();
}

void Descriptor::close() {
  if (number_ >= 0) ::close(number_);
  number_ = -1;
}

std::optional<std::string> read_file(const fs::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  std::stringstream text;
  text << file.rdbuf();
  return std::move(text).str();
}

std::string read_tail(const fs::path& path, std::size_t bytes) {
  std::ifstream file(path, std::ios::binary | std::ios::ate);
  if (!file) return {};
  const std::streamoff size = file.tellg();
  file.seekg(size - std::min(size, static_cast<std::streamoff>(bytes)));
  std::stringstream text;
  text << file.rdbuf();
  return std::move(text).str();
}

void sync_folder(const fs::path& folder) {
  const Descriptor file(open(folder.c_str(), O_RDONLY | O_CLOEXEC | O_DIRECTORY));
  // Some file systems have nothing to do for a folder, and say so.
  if (!file || (fsync(file.get()) != 0 && errno != EINVAL))
    throw std::system_error(errno, std::generic_category(), folder.string());
}

void sync_below(const fs::path& folder) {
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    const Descriptor file(open(entry.path().c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
    if (!file || fsync(file.get()) != 0)
      throw std::system_error(errno, std::generic_category(), entry.path().string());
  }
  sync_folder(folder);
}

void log_line(const std::string& text) noexcept {
  std::fprintf(stderr, "sweepvi-serve: %s\n", text.c_str());
}

bool for_want_of_room(const std::exception& error) {
  if (const auto* database = dynamic_cast<const DatabaseError*>(&error)) return database->no_room();
  const auto* system = dynamic_cast<const std::system_error*>(&error);
  return system != nullptr && (system->code() == std::errc::no_space_on_device ||
                               system->code() == std::error_code(EDQUOT, std::generic_category()));
}

std::int64_t size_below(const fs::path& folder) {
  std::int64_t bytes = 0;
  std::error_code failure;
  // Files come and go while a run lasts: what cannot be asked is not there any more.
  for (fs::recursive_directory_iterator at(folder, failure), end; at != end; at.increment(failure)) {
    std::error_code gone;
    if (!at->is_regular_file(gone)) continue;
    const std::uintmax_t size = at->file_size(gone);
    if (!gone) bytes += static_cast<std::int64_t>(size);
  }
  return bytes;
}

int signal_processes_with(const std::string& name, const std::string& value, int signal) {
  std::string mark = name + "=" + value;
  mark.push_back('\0');
  std::error_code failure;
  int found = 0;
  for (const fs::directory_entry& entry : fs::directory_iterator("/proc", failure)) {
    const int pid = static_cast<int>(std::strtol(entry.path().filename().c_str(), nullptr, 10));
    if (pid <= 1 || pid == getpid()) continue;
    const std::optional<std::string> environment = read_file(entry.path() / "environ");
    if (!environment || environment->find(mark) == std::string::npos) continue;
    ++found;
    kill(pid, signal);
  }
  return found;
}

void end_processes_with(const std::string& name, const std::string& value) {
  for (int round = 0; round < 20 && signal_processes_with(name, value, SIGKILL) > 0; ++round)
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
}

double now() {
  return std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
}

double ticks() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string utc(double time) {
  const auto milliseconds = static_cast<std::int64_t>(std::floor(time * 1000.0));
  const auto seconds = static_cast<std::time_t>(milliseconds / 1000);
  std::tm fields{};
  gmtime_r(&seconds, &fields);
  std::array<char, 32> text{};
  const std::size_t length = std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%S", &fields);
  return fmt::format("{}.{:03}Z", std::string_view(text.data(), length), milliseconds % 1000);
}

fs::path own_path() {
  return fs::read_symlink("/proc/self/exe");
}

}  // namespace sweepvi::service
