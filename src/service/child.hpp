#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace sweepvi::service {

struct ChildLimits {
  int seconds = 60;                ///< until it is killed
  std::int64_t memory = 0;         ///< address space [B]; 0: no limit
  std::size_t output = 1U << 16U;  ///< of each stream; what comes after is dropped [B]
};

struct ChildResult {
  int code = -1;   ///< its exit code
  int signal = 0;  ///< that ended it; 0: none
  std::string out, err;
};

// Programs get nothing of this process but what its environment says of how programs are found, loaded and
// started on several ranks.

/// Runs a program to its end.
/// @throws std::system_error if it cannot be started
ChildResult run_child(const std::vector<std::string>& words, const std::filesystem::path& folder,
                      const ChildLimits& limits);

/// Starts a program as the leader of a session of its own, with nothing open but /dev/null.
/// @param mark  NAME=value, more of its environment
/// @return its process number
/// @throws std::system_error
int start_apart(const std::vector<std::string>& words, const std::filesystem::path& folder, std::string mark);

/// From here on neither this process nor what it starts gets more rights, as by set-user-ID programs, or
/// leaves a core.
void give_up_privileges();

/// `sweepvi-serve limited SECONDS BYTES WORDS...`: becomes that program, with limits that outlive whoever
/// started it, 0 stands for none, and its privileges given up. Returns only if that fails, with the exit
/// code.
int become_limited(const std::vector<std::string>& words);

}  // namespace sweepvi::service
