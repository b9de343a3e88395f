#pragma once

#include <memory>
#include <string>

#include "service/attempt.hpp"
#include "service/job.hpp"
#include "service/settings.hpp"

namespace sweepvi::service {

/// Where an attempt is, as far as its launcher can tell.
struct Whereabouts {
  enum class Kind {
    under_way,   ///< it runs, or will
    ended,       ///< see Attempt::ending()
    lost,        ///< it began and ended without a word: killed with its supervisor, or its machine went down
    never_began  ///< and never will; without a reason it may be launched anew
  };
  Kind kind = Kind::under_way;
  std::string reason;  ///< of `lost` and `never_began`, if there is one to tell
};

/// What starts attempts: another batch system is another one of these. It starts the supervisor of an attempt
/// (`sweepvi-serve supervise FOLDER`) somewhere; that does the rest.
class Launcher {
public:
  Launcher() = default;
  virtual ~Launcher() = default;
  Launcher(const Launcher&) = delete;
  Launcher& operator=(const Launcher&) = delete;

  /// @throws std::exception if it cannot be started; then it never will
  virtual void launch(const Attempt& attempt, const Job& job) = 0;
  /// Asked again and again while an attempt is under way, also about those that an earlier daemon launched.
  virtual Whereabouts poll(const Attempt& attempt, const Job& job) = 0;
  /// Has it stop in order, if it can; called once, after Attempt::ask_to_stop().
  virtual void stop(const Attempt& attempt, const Job& job) = 0;
  /// Lets a supervisor that is overdue go on, if somebody stopped its process.
  virtual void wake(const Attempt& /*attempt*/) {}
  /// Ends the processes of an attempt whose supervisor does not.
  virtual void end(const Attempt& /*attempt*/) {}
  /// "2 cores of this machine, by mpirun".
  virtual std::string describe() const = 0;
};

/// On this machine. @param settings  outlives it, as below
std::unique_ptr<Launcher> make_local_launcher(const Settings& settings);
/// By sbatch, scancel, squeue and sacct. @param queue  the queue's name
std::unique_ptr<Launcher> make_slurm_launcher(const Settings& settings, const std::string& queue);

}  // namespace sweepvi::service
