#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

namespace sweepvi::service {

enum class State { queued, running, done, failed, cancelled, interrupted };

const char* name_of(State state);
std::optional<State> state_named(const std::string& name);

/// Whether a job in this state takes part in nothing any more.
bool at_rest(State state);

/// What somebody asked for, as it was checked: how to run it is in `work`.
struct Request {
  std::string title;  ///< a file name, for people; never a path
  int ranks = 1;
  int priority = 0;        ///< higher ones go first
  nlohmann::json work;     ///< verb, set, options, wall_limit, memory, ...
  std::string key;         ///< idempotency key; empty: none
  std::string digest;      ///< of all that was sent
  std::string report;      ///< what `sweepvi check` said
  std::int64_t bytes = 0;  ///< of what it keeps on the disk
  std::string owner;       ///< the user who asked; empty: whoever had the only token, or anybody
};

/// Why nothing can be run by a job's `work`; empty if it can.
std::string complaint_about(const nlohmann::json& work);

/// A job as the queue knows it.
struct Job {
  std::int64_t id = 0;
  std::string folder;  ///< its name, see Store
  State state = State::queued;
  Request request;
  double submitted = 0.0;                   ///< as all times: seconds since 1970
  std::optional<double> started, finished;  ///< of the last attempt
  int attempt = 0;                          ///< how often it was started
  bool stop_asked = false;
  std::optional<int> exit, signal;  ///< of the last attempt
  std::string message;              ///< why it is in this state
  std::int64_t result_bytes = 0;
  std::string result_sha256;
};

/// What a job's folder says of it: enough to take it up again if the queue is lost.
std::string notes_of(const Job& job);
/// @param bytes  what notes_of() made, perhaps damaged since. @return nothing if it cannot be read
std::optional<Job> job_in_notes(const std::string& bytes);

}  // namespace sweepvi::service
