#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>

#include "service/queue.hpp"

namespace sweepvi::service {

/// Server-sent events of one job: `progress` for each line that its runs append to their progress file,
/// `state` when its state changes and at the beginning, `end` when it is at rest. The identifier of an event
/// is how much of the file it has seen: a client that comes back with its last one misses nothing and hears
/// nothing twice.
class Events {
public:
  /// @param last  what the client saw last, as it says; 0: from the beginning
  Events(const Queue& queue, std::filesystem::path folder, std::int64_t id, std::int64_t last);

  /// Passes on what is new, as text to be sent; waits a little if there is nothing.
  /// @return whether there will be more
  bool next(const std::function<bool(const std::string&)>& send);

private:
  std::string new_lines();

  const Queue& queue_;
  std::filesystem::path folder_;
  std::int64_t id_, seen_;
  std::string told_;  // the state, as it was told last
  double spoke_ = 0.0;
};

}  // namespace sweepvi::service
