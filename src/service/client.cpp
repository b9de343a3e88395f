#include "service/client.hpp"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <system_error>

#include "io/output_file.hpp"
#include "io/printable.hpp"
#include "service/digest.hpp"
#include "service/files.hpp"
#include "service/local_words.hpp"
#include "service/refusal.hpp"
#include "service/remote.hpp"
#include "service/scene_files.hpp"

namespace sweepvi::service {

using nlohmann::json;

namespace {

constexpr int not_written = 5;

struct ClientVerb {
  const char* name;
  const char* operands;
  const char* text;
  std::vector<Option> options;
};

const std::vector<ClientVerb>& verbs() {
  static const Option output = {"-o", "FILE", "where to put it (default: job-ID.h5 or job-ID.csv)"};
  static const Option force = {"--force", "", "replace a file that exists"};
  static const std::vector<ClientVerb> entries = {
      {"submit",
       "run|solve|study FILE.toml ...",
       "hand in a scene or problem with the words it runs with here, and the matrices it names",
       {{"-n", "RANKS", "how many ranks (default: 1)"},
        {"--priority", "P", "-1000 to 1000, higher ones go first (default: 0)"},
        {"--memory", "BYTES", "address space of one rank"},
        {"--key", "TEXT", "the same key twice is one job (default: drawn at random)"},
        {"--wait", "",
         "until it ends; fetch the result to where the run would write it here, with its exit code"}}},
      {"jobs", "", "list jobs", {{"--state", "STATE", "only queued, running, done, ..."}}},
      {"watch", "ID", "follow a job until it ends; exit code of the job", {}},
      {"fetch",
       "ID",
       "download a result; where a download broke off it goes on",
       {output, force, {"--log", "", "what the program printed instead, on standard output"}}},
      {"cancel", "ID", "stop a job, with a checkpoint", {}},
      {"resume", "ID", "go on with a job that was cancelled or interrupted, or has failed", {}}};
  return entries;
}

const ClientVerb& verb_named(const std::string& name) {
  return *std::find_if(verbs().begin(), verbs().end(),
                       [&](const ClientVerb& verb) { return verb.name == name; });
}

std::string help_of(const ClientVerb& verb, std::vector<Option> options) {
  options.push_back({"--help", "", "this text"});
  return fmt::format("Usage: sweepvi {} [options] {}\n\n{}\n\n{}", verb.name, verb.operands, verb.text,
                     option_table(options));
}

std::string job_path(const Arguments& given, const std::string& verb) {
  const std::string id = given.operands().empty() ? "" : given.operands()[0];
  if (id.empty() || id.size() > 18 || id.find_first_not_of("0123456789") != std::string::npos)
    throw UsageError(fmt::format("'{0}' needs the number of a job: sweepvi {0} 17", verb));
  return "/v1/jobs/" + id;
}

void refuse_existing(const std::string& file, bool force) {
  std::error_code failure;
  if (!force && std::filesystem::exists(file, failure) &&
      output_target(file).kind == OutputTarget::Kind::regular)
    throw RemoteError(not_written, fmt::format("{} exists; choose another -o, or --force", file));
}

std::string line_of(const json& job) {
  const std::string message = job.value("message", "");
  return fmt::format("{:>6}  {:<11}  {:>5}  {:<24}  {}", job.value("id", 0),
                     printable(job.value("state", "")), job.value("ranks", 0),
                     printable(job.value("submitted", "")),
                     printable(job.value("name", "") + (message.empty() ? "" : ": " + message)));
}

/// Progress on standard error, the end as a line on standard output. @return the job as it ended
json follow(Remote& remote, const std::string& path) {
  const bool terminal = isatty(STDERR_FILENO) != 0;
  json last;
  remote.listen(path + "/events", [&](const Remote::Event& event) {
    const json data = json::parse(event.data, nullptr, false);
    if (data.is_discarded()) return true;
    if (event.name == "progress")
      fmt::print(
          stderr,
          "{}step {} of {}, t = {:.6g} s, {} Newton iterations, residual {:.2g}, about {:.0f} s left{}",
          terminal ? "\r" : "", data.value("step", 0), data.value("steps", 0), data.value("t", 0.0),
          data.value("iterations", 0), data.value("residual", 0.0), data.value("left", 0.0),
          terminal ? " \033[K" : "\n");
    if (event.name == "state" || event.name == "end") last = data;
    return event.name != "end";
  });
  if (terminal) std::fputs("\r\033[K", stderr);
  fmt::print("{}\n", line_of(last));
  return last;
}

int exit_of(const json& job) {
  if (job.value("state", "") == "done") return 0;
  constexpr int stopped = 4;
  const json exit = job.value("exit", json());
  if (exit.is_number() && exit.get<int>() > 0) return exit.get<int>();
  return job.value("state", "") == "failed" ? 1 : stopped;
}

int submit(Remote& remote, const Arguments& given) {
  LocalWords local = read_local_words(given.rest());
  const bool wait = given.has("--wait");
  if (wait) refuse_existing(local.output, local.force);
  json& description = local.description;
  const bool solves = description.at("verb") == "solve";
  constexpr double most = 1e6;
  description["ranks"] = given.number("-n", 1, 1, most);
  description["priority"] = given.number("--priority", 0, -most, most);
  constexpr double most_bytes = 1e15;
  if (given.has("--memory")) description["memory"] = given.number("--memory", 0, 1, most_bytes);
  httplib::MultipartFormDataItems parts;
  const std::vector<NamedFile> files = files_named_in(local.document, local.changes);
  description[solves ? "problem" : "scene"] = read_file(local.document).value_or("");
  if (!local.settings.empty()) {
    const std::optional<std::string> settings = read_file(local.settings);
    if (!settings) throw UsageError(local.settings + ": there is no such file");
    description["settings"] = *settings;
  }
  std::string text;
  try {
    text = description.dump();
  } catch (const json::exception&) {
    throw UsageError(local.document + " is not UTF-8 text");
  }
  parts.push_back({"job", text, "", "application/json"});
  for (const NamedFile& file : files)
    parts.push_back({"file", read_file(file.path).value_or(""), file.name, "application/octet-stream"});
  const json job = remote.post_form("/v1/jobs", parts, given.get("--key", random_hex(16)));
  const std::string path = fmt::format("/v1/jobs/{}", job.at("id").get<std::int64_t>());
  if (!wait) {
    fmt::print("{}\n", job.at("id").get<std::int64_t>());
    return 0;
  }
  const json end = follow(remote, path);
  if (!end.value("result", json()).is_null()) remote.download(path + "/result", local.output);
  if (!local.summary.empty() && !end.value("summary", json()).is_null()) try {
      write_output(local.summary, end.at("summary").dump(2) + "\n");
    } catch (const std::system_error& error) {
      throw RemoteError(not_written, fmt::format("{}: {}", local.summary, error.code().message()));
    }
  return exit_of(end);
}

int list(Remote& remote, const Arguments& given) {
  const std::string filter = given.has("--state") ? "?state=" + given.get("--state") : "";
  fmt::print("{:>6}  {:<11}  {:>5}  {:<24}  {}\n", "job", "state", "ranks", "submitted", "name");
  const json answer = remote.get("/v1/jobs" + filter);
  for (const json& job : answer.at("jobs"))
    fmt::print("{}\n", line_of(job));
  return 0;
}

int fetch(Remote& remote, const Arguments& given, const std::string& path) {
  const json job = remote.get(path);
  if (given.has("--log")) {
    fmt::print("{}", printable_lines(remote.text(path + "/log")));
    return 0;
  }
  const std::string kind = job.at("verb") == "study" ? ".csv" : ".h5";
  const std::string file = given.get("-o", "job-" + given.operands()[0] + kind);
  refuse_existing(file, given.has("--force"));
  remote.download(path + "/result", file);
  fmt::print("{}\n", file);
  return 0;
}

}  // namespace

bool is_client_verb(const std::string& verb) {
  return std::any_of(verbs().begin(), verbs().end(),
                     [&](const ClientVerb& known) { return known.name == verb; });
}

int act_as_client(const std::string& name, const std::vector<std::string>& words) {
  const ClientVerb& verb = verb_named(name);
  std::vector<Option> options = verb.options;
  for (const Option& option : Remote::options())
    options.push_back(option);
  if (!words.empty() && (words[0] == "--help" || words[0] == "-h")) {
    std::fputs(help_of(verb, options).c_str(), stdout);
    return 0;
  }
  const bool submits = name == "submit";
  const Arguments given(name, words, options, name == "jobs" || submits ? 0 : 1, submits ? 1 : 0);
  Remote remote(given);
  if (submits) return submit(remote, given);
  if (name == "jobs") return list(remote, given);
  const std::string path = job_path(given, name);
  if (name == "watch") return exit_of(follow(remote, path));
  if (name == "fetch") return fetch(remote, given, path);
  fmt::print("{}\n", line_of(remote.post(path + "/" + name)));
  return 0;
}

}  // namespace sweepvi::service
