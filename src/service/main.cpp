// The service: daemon, client and the supervisor of a run, in one program that needs neither MPI nor PETSc.

#include <csignal>
#include <cstdio>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "io/output_file.hpp"
#include "io/printable.hpp"
#include "service/child.hpp"
#include "service/client.hpp"
#include "service/fsck.hpp"
#include "service/refusal.hpp"
#include "service/remote.hpp"
#include "service/service.hpp"
#include "service/supervisor.hpp"

namespace {

using namespace sweepvi::service;

constexpr int bad_usage = 2;
constexpr int not_written = 5;

void complain(const std::exception& error) {
  std::fprintf(stderr, "sweepvi: %s\n", sweepvi::printable(error.what()).c_str());
}

int serve(const std::vector<std::string>& words) {
  if (!words.empty() && (words[0] == "--help" || words[0] == "-h")) {
    std::fputs(serve_help().c_str(), stdout);
    return 0;
  }
  // One thread waits for them; all others, started later, leave them alone.
  sigset_t endings;
  sigemptyset(&endings);
  sigaddset(&endings, SIGTERM);
  sigaddset(&endings, SIGINT);
  pthread_sigmask(SIG_BLOCK, &endings, nullptr);
  signal(SIGPIPE, SIG_IGN);
  const Settings settings = read_settings(words);
  std::optional<Service> service;
  try {
    service.emplace(settings);
  } catch (const UsageError&) {
    throw;
  } catch (
      const std::exception& error) {  // a disk, as a rule; nothing has been changed that a later start needs
    complain(error);
    return not_written;
  }
  std::thread([&service, endings] {
    int signal = 0;
    sigwait(&endings, &signal);
    service->stop();
  }).detach();
  service->listen();
  return 0;
}

int act(const std::string& verb, const std::vector<std::string>& words) {
  if (verb == "serve") return serve(words);
  if (verb == "fsck") return act_as_fsck(words);
  if (verb == "supervise" && words.size() == 1) return supervise(words[0]);
  if (verb == "limited") return become_limited(words);
  if (is_client_verb(verb)) return act_as_client(verb, words);
  throw UsageError("expected serve, fsck, submit, jobs, watch, fetch, cancel or resume; see 'sweepvi help'");
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> words(argv + 1, argv + argc);
  try {
    const int code =
        act(words.empty() ? "" : words[0], {words.empty() ? words.begin() : words.begin() + 1, words.end()});
    if (code == 0) sweepvi::flush_standard_output();
    return code;
  } catch (const UsageError& error) {
    complain(error);
    return bad_usage;
  } catch (const RemoteError& error) {
    complain(error);
    return error.exit();
  } catch (const std::exception& error) {
    complain(error);
    return std::ferror(stdout) != 0 ? not_written : 1;
  }
}
