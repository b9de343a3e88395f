#include "app/watch.hpp"

#include <fmt/format.h>

#include <array>

namespace sweepvi::app {

namespace {

volatile std::sig_atomic_t noted = 0;

extern "C" void note(int signal) {
  noted = signal;
}

}  // namespace

void note_signals() {
  struct sigaction action {};
  action.sa_handler = note;
  action.sa_flags = SA_RESTART;
  sigemptyset(&action.sa_mask);
  for (const int signal : {SIGUSR1, SIGTERM, SIGINT})
    sigaction(signal, &action, nullptr);
}

Watch::Watch(MPI_Comm comm, double started, std::optional<double> wall_limit, double interval)
    : comm_(comm), started_(started), interval_(interval), last_(MPI_Wtime()), wall_limit_(wall_limit) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  clock_ = rank == 0;
}

Watch::Asked Watch::ask() {
  const double now = MPI_Wtime();
  const bool late = clock_ && wall_limit_ && now - started_ >= *wall_limit_;
  const bool due = clock_ && interval_ > 0.0 && now - last_ >= interval_;
  std::array<int, 3> asked = {static_cast<int>(noted), late ? 1 : 0, due ? 1 : 0};
  MPI_Allreduce(MPI_IN_PLACE, asked.data(), 3, MPI_INT, MPI_MAX, comm_);
  stop_signal_ = asked[0];
  return {asked[0] != 0 || asked[1] != 0, asked[2] != 0};
}

std::string Watch::reason() const {
  switch (stop_signal_) {
    case SIGUSR1:
      return "SIGUSR1";
    case SIGTERM:
      return "SIGTERM";
    case SIGINT:
      return "SIGINT";
    default:
      return wall_limit_ ? fmt::format("--wall-limit {:g}", *wall_limit_) : "nothing";
  }
}

}  // namespace sweepvi::app
