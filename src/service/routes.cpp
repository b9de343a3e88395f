#include <fmt/format.h>

#include "service/child.hpp"
#include "service/embedded.hpp"
#include "service/events.hpp"
#include "service/refusal.hpp"
#include "service/representation.hpp"
#include "service/result.hpp"
#include "service/service.hpp"
#include "service/submission.hpp"
#include "service/work.hpp"
#include "sweepvi_config.hpp"

namespace sweepvi::service {

using httplib::Response;
using nlohmann::ordered_json;
// Request is what a job asks for; what a client sends is a
using Asked = httplib::Request;

namespace {

constexpr const char* json_type = "application/json";

void answer(Response& response, int status, const ordered_json& json) {
  response.status = status;
  response.set_content(text_of(json), json_type);
}

/// A number among the parameters behind the question mark.
std::int64_t parameter(const Asked& request, const char* name, std::int64_t otherwise, std::int64_t most) {
  if (!request.has_param(name)) return otherwise;
  const std::string text = request.get_param_value(name);
  const bool digits =
      !text.empty() && text.size() < 19 && text.find_first_not_of("0123456789") == std::string::npos;
  const std::int64_t number = digits ? std::stoll(text) : -1;
  if (number < 0 || number > most)
    throw Refusal(400, fmt::format("'{}' is not a number from 0 to {}", name, most));
  return number;
}

/// Of the job in a path.
std::int64_t number_of(const Asked& request) {
  return std::stoll(request.matches[1]);
}

/// Anything but bad input: its limits of memory and time, or something is wrong with this machine.
void answer_refused(Response& response, const Checked& checked) {
  constexpr int bad_input = 2;
  answer(response, checked.exit == bad_input || checked.exit < 0 ? 400 : 500,
         {{"error", checked.text}, {"exit", checked.exit}});
}

void replace_all(std::string& text, const std::string& from, const std::string& to) {
  for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
}

/// A folder that is removed unless it was kept.
class Incoming {
public:
  explicit Incoming(const Store& store) : store_(store), name_(store.receive()) {}
  ~Incoming() {
    if (!kept_) store_.discard(name_);
  }
  Incoming(const Incoming&) = delete;
  Incoming& operator=(const Incoming&) = delete;
  const std::string& name() const { return name_; }
  std::filesystem::path folder() const { return store_.folder(name_); }
  void keep() {
    kept_ = true;
    store_.promise(name_);
  }

private:
  const Store& store_;
  std::string name_;
  bool kept_ = false;
};

/// Counts those who are somewhere.
class Counted {
public:
  explicit Counted(std::atomic<int>& count) : count_(count) { ++count_; }
  ~Counted() { --count_; }
  Counted(const Counted&) = delete;
  Counted& operator=(const Counted&) = delete;

private:
  std::atomic<int>& count_;
};

}  // namespace

void Service::set_routes() {
  const auto on = [this](void (Service::*handler)(const Asked&, Response&)) {
    return [this, handler](const Asked& request, Response& response) { (this->*handler)(request, response); };
  };
  const std::string job = R"(/v1/jobs/(\d{1,18}))";
  server_.Post("/v1/jobs", [this](const Asked& request, Response& response, const Reader& reader) {
    post_job(request, response, reader);
  });
  server_.Get("/v1/jobs", on(&Service::list_jobs));
  server_.Get(job, on(&Service::get_job));
  server_.Delete(job, on(&Service::remove));
  server_.Get(job + "/events", on(&Service::get_events));
  server_.Post(job + "/cancel", on(&Service::cancel));
  server_.Post(job + "/resume", on(&Service::resume));
  server_.Get(job + "/result", on(&Service::get_result));
  server_.Get(job + "/picture", on(&Service::get_picture));
  server_.Get(job + "/log", on(&Service::get_log));
  server_.Get("/healthz", [this](const Asked&, Response& response) { health(response); });
  server_.Get("/", [](const Asked&, Response& response) {
    response.set_content(embedded::page(), "text/html; charset=utf-8");
  });
  server_.Get("/openapi.json",
              [](const Asked&, Response& response) { response.set_content(embedded::openapi(), json_type); });
}

std::optional<std::string> Service::owner_seen_by(const User& user) {
  return user.admin ? std::nullopt : std::optional(user.name);
}

// The jobs of others are as if there were none.
Job Service::job_of(const Asked& request) const {
  const std::int64_t id = number_of(request);
  const User& user = access_.user_of(request);
  std::optional<Job> job;
  try {
    job = queue_.find(id);
  } catch (const Refusal&) {  // a damaged row: nobody knows whose
    if (user.admin) throw;
  }
  if (!job || job->request.owner != owner_seen_by(user).value_or(job->request.owner))
    throw Refusal(404, fmt::format("there is no job {}", id));
  return std::move(*job);
}

void Service::check_quota(const User& user, std::int64_t more) const {
  if (user.jobs == 0 && user.disk == 0) return;
  const Queue::Kept kept = queue_.kept_by(user.name);
  if (user.jobs > 0 && kept.jobs >= user.jobs)
    throw Refusal(429,
                  fmt::format("you have {} jobs, as many as you may keep; delete some first", kept.jobs));
  if (user.disk > 0 && kept.bytes + more > user.disk)
    throw Refusal(507, fmt::format("your jobs together may keep {} bytes; delete some first", user.disk));
}

void Service::check_room(std::int64_t more) const {
  if (queue_.bytes_kept() + scheduler_->running_bytes() + more > settings_.disk)
    throw Refusal(507, fmt::format("all jobs together may keep {} bytes; delete some first", settings_.disk));
}

sweepvi::service::Request Service::receive(const Asked& request, const Reader& reader,
                                           const std::filesystem::path& folder) {
  const auto too_long = [&] {
    return Refusal(413, fmt::format("the body has more than {} bytes", settings_.body));
  };
  if (std::strtoll(request.get_header_value("Content-Length").c_str(), nullptr, 10) > settings_.body)
    throw too_long();
  Submission submission(folder, settings_);
  std::int64_t bytes = 0;
  std::optional<Refusal> refusal;
  bool describes = true;
  // The reader does not pass exceptions on in every case: they wait until it is done.
  const auto guarded = [&](auto&& work) {
    try {
      work();
    } catch (const Refusal& complaint) {
      refusal = complaint;
    }
    return !refusal;
  };
  const auto take = [&](const char* data, std::size_t size) {
    return guarded([&] {
      bytes += static_cast<std::int64_t>(size);
      if (bytes > settings_.body) throw too_long();
      if (describes)
        submission.add_description({data, size});
      else
        submission.add_to_file({data, size});
    });
  };
  bool complete = false;
  if (request.is_multipart_form_data()) {
    const auto begin = [&](const httplib::MultipartFormData& part) {
      return guarded([&] {
        describes = part.name == "job";
        if (describes) return;
        if (part.name != "file") throw Refusal(400, "parts are called 'job' or 'file'");
        submission.begin_file(part.filename);
      });
    };
    complete = reader(begin, take);
  } else if (request.get_header_value("Content-Type").starts_with(json_type)) {
    complete = reader(take);
  } else {
    throw Refusal(415, "expected application/json, or multipart/form-data with parts 'job' and 'file'");
  }
  if (refusal) throw Refusal(*refusal);
  if (!complete) throw Refusal(400, "the body cannot be read: too long, too slow, or not what its head says");
  return submission.finish(request.get_header_value("Idempotency-Key"));
}

Checked Service::check(const sweepvi::service::Request& wanted, const std::filesystem::path& folder) {
  struct Turn {
    explicit Turn(std::counting_semaphore<>& checks) : checks_(checks) { checks_.acquire(); }
    ~Turn() { checks_.release(); }
    Turn(const Turn&) = delete;
    Turn& operator=(const Turn&) = delete;
    std::counting_semaphore<>& checks_;
  };
  const Turn turn(checks_);
  Checked checked = check_work(wanted.work, folder, settings_);
  replace_all(checked.text, scene_file, wanted.title);
  return checked;
}

void Service::post_job(const Asked& request, Response& response, const Reader& reader) {
  // Most of them wait for a check: some threads are for others.
  const Counted counted(submitters_);
  if (submitters_ > settings_.threads / 2) throw Refusal(503, "too many hand in jobs at once; try again");
  const User& user = access_.user_of(request);
  check_room(0);
  Incoming incoming(store_);
  sweepvi::service::Request wanted = receive(request, reader, incoming.folder());
  wanted.owner = user.name;
  // One user's key tells nothing of another's jobs.
  if (!wanted.key.empty() && !user.name.empty()) wanted.key = user.name + "/" + wanted.key;
  const auto tell = [&](const Job& job, int status) {
    response.set_header("Location", fmt::format("/v1/jobs/{}", job.id));
    answer(response, status, represent(job, store_.job(job)));
  };
  if (const std::optional<Job> known = queue_.with_key(wanted.key, wanted.digest)) return tell(*known, 200);
  check_room(wanted.bytes);
  check_quota(user, wanted.bytes);

  const Checked checked = check(wanted, incoming.folder());
  if (!checked.good) return answer_refused(response, checked);
  wanted.report = checked.text;
  const Queue::Added added =
      queue_.add(wanted, incoming.name(), settings_.jobs, [&](const Job& job) { store_.note(job); });
  if (added.is_new) incoming.keep();
  scheduler_->wake();
  tell(added.job, added.is_new ? 201 : 200);
}

void Service::list_jobs(const Asked& request, Response& response) {
  constexpr std::int64_t most = 1000;
  constexpr std::int64_t usual = 100;
  Queue::Selection wanted;
  wanted.owner = owner_seen_by(access_.user_of(request));
  if (request.has_param("state")) {
    wanted.state = state_named(request.get_param_value("state"));
    if (!wanted.state)
      throw Refusal(400, "'state' is none of queued, running, done, failed, cancelled, interrupted");
  }
  wanted.before = parameter(request, "before", 0, std::numeric_limits<std::int64_t>::max());
  ordered_json jobs = ordered_json::array();
  for (const Job& job : queue_.list(wanted, parameter(request, "limit", usual, most)))
    jobs.push_back(represent_briefly(job));
  ordered_json counts = ordered_json::object();
  for (const auto& [known, count] : queue_.counts(wanted.owner))
    counts[name_of(known)] = count;
  answer(response, 200, {{"jobs", jobs}, {"counts", counts}});
}

void Service::get_job(const Asked& request, Response& response) {
  const Job job = job_of(request);
  answer(response, 200, represent(job, store_.job(job)));
}

void Service::get_events(const Asked& request, Response& response) {
  const Job job = job_of(request);
  const std::string last = request.get_header_value("Last-Event-ID");
  const bool number =
      !last.empty() && last.size() < 19 && last.find_first_not_of("0123456789") == std::string::npos;
  // Each listener keeps a thread; others need some, too.
  if (++listeners_ > settings_.threads / 2) {
    --listeners_;
    throw Refusal(503, "too many listen to events already; ask for /v1/jobs/ID now and then");
  }
  const auto events =
      std::make_shared<Events>(queue_, store_.job(job), job.id, number ? std::stoll(last) : 0);
  response.set_header("Cache-Control", "no-store");
  response.set_chunked_content_provider(
      "text/event-stream",
      [this, events](std::size_t, httplib::DataSink& sink) {
        const bool more = !ends_ && events->next([&](const std::string& text) {
          return sink.write(text.data(), text.size());
        });
        if (!more) sink.done();
        return true;
      },
      [this](bool) { --listeners_; });
}

void Service::cancel(const Asked& request, Response& response) {
  const Job job = queue_.ask_to_stop(job_of(request).id);
  scheduler_->wake();
  answer(response, 202, represent(job, store_.job(job)));
}

// What a job is given on its way is checked as it was at first: it could not get rid of it again.
void Service::resume(const Asked& request, Response& response) {
  Job job = job_of(request);
  if (change_work(request.body, job.request.work, settings_) && at_rest(job.state) &&
      job.state != State::done) {
    const Checked checked = check(job.request, store_.job(job));
    if (!checked.good) return answer_refused(response, checked);
  }
  job = queue_.resume(job.id, job.request.work);
  scheduler_->wake();
  answer(response, 202, represent(job, store_.job(job)));
}

void Service::get_result(const Asked& request, Response& response) {
  const Job job = job_of(request);
  if (job.result_sha256.empty())
    throw Refusal(404, fmt::format("job {} is {} and has no result", job.id, name_of(job.state)));
  const std::string file = result_file(job);
  response.set_header("Content-Disposition", fmt::format("attachment; filename=\"job-{}-{}\"", job.id, file));
  send_file(request, response, store_.job(job) / file,
            file.ends_with(".csv") ? "text/csv" : "application/x-hdf5", job.result_sha256);
}

void Service::get_picture(const Asked& request, Response& response) {
  const Job job = job_of(request);
  if (settings_.plot.empty()) throw Refusal(404, "scripts/plot is not beside the daemon");
  if (job.result_sha256.empty() || job.request.work.at("verb") == "solve")
    throw Refusal(404, fmt::format("job {} has nothing to draw", job.id));
  const std::filesystem::path folder = store_.job(job);
  const std::string picture = "picture-" + job.result_sha256.substr(0, 16) + ".png";
  {
    const std::lock_guard lock(drawing_);
    std::error_code failure;
    if (!std::filesystem::exists(folder / picture, failure)) {
      const ChildResult drawn =
          run_child({settings_.plot.string(), result_file(job), "-o", picture, "--dpi", "80"}, folder,
                    {.seconds = settings_.check_seconds, .memory = settings_.check_memory});
      if (drawn.code != 0) throw Refusal(404, "it cannot be drawn: " + drawn.err.substr(0, 300));
    }
  }
  send_file(request, response, folder / picture, "image/png", digest_of_file((folder / picture).string()));
}

void Service::get_log(const Asked& request, Response& response) {
  constexpr std::size_t most = 1U << 20U;
  const Job job = job_of(request);
  response.set_content(read_tail(store_.job(job) / log_file, most), "text/plain; charset=utf-8");
}

void Service::remove(const Asked& request, Response& response) {
  const std::int64_t id = number_of(request);
  if (!access_.user_of(request).admin) static_cast<void>(job_of(request));
  const std::string folder = queue_.folder_of(id);
  if (!folder.empty()) store_.take_back(folder);
  try {
    queue_.remove(id);
  } catch (...) {
    if (!folder.empty()) store_.promise(folder);
    throw;
  }
  if (!folder.empty()) store_.discard(folder);
  response.status = 204;
}

void Service::health(Response& response) {
  const auto counts = queue_.counts();
  answer(response, 200,
         {{"status", "ok"},
          {"version", config::version},
          {"launcher", launcher_->describe()},
          {"queued", counts.at(State::queued)},
          {"running", counts.at(State::running)}});
}

}  // namespace sweepvi::service
