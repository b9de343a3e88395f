#pragma once

#include <atomic>
#include <memory>
#include <mutex>
#include <semaphore>

#include "service/access.hpp"
#include "service/connection.hpp"
#include "service/launcher.hpp"
#include "service/queue.hpp"
#include "service/scheduler.hpp"
#include "service/settings.hpp"
#include "service/store.hpp"
#include "service/work.hpp"

namespace sweepvi::service {

/// The daemon: queue, scheduler and the HTTP interface in front of them.
class Service {
public:
  /// Takes up what an earlier daemon left. @throws UsageError, std::exception
  explicit Service(const Settings& settings);

  /// Listens until stop(). @throws std::runtime_error if it cannot
  void listen();
  /// From any thread; jobs go on.
  void stop();

private:
  using Reader = httplib::ContentReader;

  void set_routes();
  void set_answers();
  void post_job(const httplib::Request& request, httplib::Response& response, const Reader& reader);
  void list_jobs(const httplib::Request& request, httplib::Response& response);
  void get_job(const httplib::Request& request, httplib::Response& response);
  void get_events(const httplib::Request& request, httplib::Response& response);
  void cancel(const httplib::Request& request, httplib::Response& response);
  void resume(const httplib::Request& request, httplib::Response& response);
  void get_result(const httplib::Request& request, httplib::Response& response);
  void get_picture(const httplib::Request& request, httplib::Response& response);
  void get_log(const httplib::Request& request, httplib::Response& response);
  void remove(const httplib::Request& request, httplib::Response& response);
  void health(httplib::Response& response);

  /// The jobs that a user may see: all, or his own.
  static std::optional<std::string> owner_seen_by(const User& user);
  void check_quota(const User& user, std::int64_t more) const;
  Job job_of(const httplib::Request& request) const;
  Request receive(const httplib::Request& request, const Reader& reader, const std::filesystem::path& folder);
  void check_room(std::int64_t more) const;
  /// `sweepvi check`, when it is this job's turn.
  Checked check(const Request& wanted, const std::filesystem::path& folder);

  Settings settings_;
  Store store_;
  Queue queue_;
  Access access_;
  std::unique_ptr<Launcher> launcher_;
  std::unique_ptr<Scheduler> scheduler_;
  std::counting_semaphore<> checks_;  // as many at once as there are processors
  std::mutex drawing_;                // one picture at a time
  std::atomic<int> listeners_ = 0;    // to events
  std::atomic<int> submitters_ = 0;   // who are being served
  std::atomic<bool> ends_ = false;
  Server server_;
};

}  // namespace sweepvi::service
