#include "app/progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <string>

namespace sweepvi::app {

namespace {
constexpr double terminal_interval = 0.2;  // s
constexpr double log_interval = 5.0;       // s
constexpr int bar_width = 30;
}  // namespace

Progress::Progress(MPI_Comm comm, std::int64_t steps) : steps_(steps), start_(MPI_Wtime()), last_(start_) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  speaks_ = rank == 0;
  terminal_ = speaks_ && isatty(STDERR_FILENO) != 0;
}

Progress::~Progress() {
  if (drawn_) std::fputs("\r\033[K", stderr);
}

void Progress::show(std::int64_t step, double t, std::int64_t iterations) {
  if (!speaks_) return;
  const double now = MPI_Wtime();
  if (now - last_ < (terminal_ ? terminal_interval : log_interval)) return;
  last_ = now;
  const double done = static_cast<double>(step) / static_cast<double>(std::max<std::int64_t>(steps_, 1));
  const double left = done > 0.0 ? (now - start_) * (1.0 - done) / done : 0.0;
  if (terminal_) {
    const auto filled = static_cast<std::size_t>(done * bar_width);
    const std::string bar = std::string(filled, '#') + std::string(bar_width - filled, '.');
    std::fprintf(stderr, "\r[%s] %3.0f %%  t = %.6g s  %.0f s left \033[K", bar.c_str(), 100.0 * done, t,
                 left);
    drawn_ = true;
  } else {
    std::fprintf(stderr, "step %lld of %lld, t = %.6g s, %lld Newton iterations, about %.0f s left\n",
                 static_cast<long long>(step), static_cast<long long>(steps_), t,
                 static_cast<long long>(iterations), left);
  }
}

}  // namespace sweepvi::app
