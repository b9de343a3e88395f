#include <fmt/format.h>
#include <sys/wait.h>

#include <csignal>
#include <map>

#include "service/child.hpp"
#include "service/launcher.hpp"

namespace sweepvi::service {

namespace {

class LocalLauncher : public Launcher {
public:
  explicit LocalLauncher(const Settings& settings) : settings_(settings) {}

  void launch(const Attempt& attempt, const Job&) override {
    supervisors_[attempt.folder()] =
        start_apart({own_path().string(), "supervise", attempt.folder().string()}, "/",
                    supervisor_mark + ("=" + attempt.folder().string()));
  }

  Whereabouts poll(const Attempt& attempt, const Job&) override {
    using Kind = Whereabouts::Kind;
    // Those of an earlier daemon are not our children, and need not be waited for.
    const auto ours = supervisors_.find(attempt.folder());
    const bool began = ours != supervisors_.end();
    const bool gone = began && waitpid(ours->second, nullptr, WNOHANG) != 0;
    if (gone) supervisors_.erase(ours);
    if (attempt.ending()) return {Kind::ended, {}};
    if (attempt.alive()) return {Kind::under_way, {}};
    if (attempt.ending()) return {Kind::ended, {}};  // it may have ended between these lines
    if (attempt.claimed()) return {Kind::lost, {}};
    // Its supervisor has not claimed it: it will in a moment, or an earlier daemon died before it was
    // started. Who claims it now decides.
    if (began && !gone) return {Kind::under_way, {}};
    if (!attempt.claim()) return {Kind::under_way, {}};
    return {Kind::never_began, began ? "its supervisor could not work" : ""};
  }

  void stop(const Attempt&, const Job&) override {}  // its supervisor looks

  void wake(const Attempt& attempt) override {
    signal_processes_with(supervisor_mark, attempt.folder().string(), SIGCONT);
  }

  void end(const Attempt& attempt) override {
    end_processes_with(supervisor_mark, attempt.folder().string());
    end_processes_with(attempt_mark, attempt.folder().string());
  }

  std::string describe() const override {
    return fmt::format("{} cores of this machine, by mpirun", settings_.cores);
  }

private:
  const Settings& settings_;
  std::map<std::filesystem::path, pid_t> supervisors_;  // ours, until they are reaped
};

}  // namespace

std::unique_ptr<Launcher> make_local_launcher(const Settings& settings) {
  return std::make_unique<LocalLauncher>(settings);
}

}  // namespace sweepvi::service
