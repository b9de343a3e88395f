#pragma once

#include <sys/types.h>

#include <cstdint>
#include <exception>
#include <filesystem>
#include <optional>
#include <string>

namespace sweepvi::service {

/// An open file of the system, closed with it.
class Descriptor {
public:
  explicit Descriptor(int number = -1) : number_(number) {}
  Descriptor(Descriptor&& other) noexcept;
  Descriptor& operator=(Descriptor&& other) noexcept;
  ~Descriptor();
  explicit operator bool() const { return number_ >= 0; }
  int get() const { return number_; }
  void close();

private:
  int number_;
};

/// The whole file; nothing if there is none.
std::optional<std::string> read_file(const std::filesystem::path& path);
/// At most its last `bytes`.
std::string read_tail(const std::filesystem::path& path, std::size_t bytes);
/// Has all files in a folder, and their names, on the disk. @throws std::system_error
void sync_below(const std::filesystem::path& folder);
/// The names in a folder only.
void sync_folder(const std::filesystem::path& folder);

/// A line of the daemon's log, standard error. That nobody can write it, for the disk is full, say, is no
/// failure of what goes on.
void log_line(const std::string& text) noexcept;

/// Whether something failed because a disk, or a share of it, is full.
bool for_want_of_room(const std::exception& error);

/// Bytes of all files below a folder; 0 if there is none.
std::int64_t size_below(const std::filesystem::path& folder);

/// Sends a signal to every process, but for this one, that began with NAME=value in its environment.
/// @return their number
int signal_processes_with(const std::string& name, const std::string& value, int signal);
/// Ends them, and waits until they are gone (for a second at most).
void end_processes_with(const std::string& name, const std::string& value);

/// Seconds since 1970, UTC.
double now();
/// Seconds since whenever, by a clock that nobody sets: for what lasts.
double ticks();
/// As in 2026-01-31T12:00:00.125Z.
std::string utc(double time);

/// Where this program is.
std::filesystem::path own_path();

}  // namespace sweepvi::service
