#pragma once

#include <httplib.h>

#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>

#include "service/arguments.hpp"

namespace sweepvi::service {

/// What went wrong on the other side, or on the way there; with the exit code it leads to.
class RemoteError : public std::runtime_error {
public:
  RemoteError(int exit, const std::string& message) : std::runtime_error(message), exit_(exit) {}
  int exit() const noexcept { return exit_; }

private:
  int exit_;
};

/// A daemon, seen from its client.
class Remote {
public:
  /// --server URL or $SWEEPVI_SERVER (http://127.0.0.1:8750 by default; unix:/path), --token-file FILE or
  /// $SWEEPVI_TOKEN_FILE. @throws UsageError
  explicit Remote(const Arguments& given);

  /// The options above, for tables of options.
  static std::vector<Option> options();

  /// An answer as JSON. @throws RemoteError with what the daemon says, if it refuses
  nlohmann::json get(const std::string& path);
  nlohmann::json post(const std::string& path, const std::string& body = {}, const std::string& type = {});
  nlohmann::json post_form(const std::string& path, const httplib::MultipartFormDataItems& parts,
                           const std::string& key);

  std::string text(const std::string& path);

  struct Event {
    std::string id, name, data;
  };
  /// Events of a job, until `take` returns false. Comes back where it was if the connection breaks.
  void listen(const std::string& path, const std::function<bool(const Event&)>& take);

  /// Downloads a file; goes on where it was if the connection breaks, and compares digests.
  /// @throws RemoteError (5) if it cannot be written
  void download(const std::string& path, const std::string& file);

private:
  nlohmann::json read(const httplib::Result& result, const std::string& path) const;

  std::string server_;
  httplib::Headers headers_;
  std::unique_ptr<httplib::Client> client_;
};

}  // namespace sweepvi::service
