#include "app/progress.hpp"

#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>

#include "app/file_head.hpp"

namespace sweepvi::app {

namespace {
constexpr double terminal_interval = 0.2;  // s
constexpr double log_interval = 5.0;       // s
constexpr double file_interval = 0.2;      // s
constexpr double file_share = 1e-3;        // of the run so far: lines grow with the logarithm of its time
constexpr int bar_width = 30;
}  // namespace

Progress::Progress(MPI_Comm comm, std::int64_t first, std::int64_t steps,
                   const std::optional<std::string>& file)
    : first_(first), steps_(steps), start_(MPI_Wtime()), last_(start_), appended_(0.0) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  speaks_ = rank == 0;
  terminal_ = speaks_ && isatty(STDERR_FILENO) != 0;
  if (speaks_ && file) file_.emplace(*file);
}

Progress::~Progress() {
  if (drawn_) std::fputs("\r\033[K", stderr);
}

double Progress::seconds_left(std::int64_t step, double now) const {
  const auto taken = static_cast<double>(step - first_);
  return taken > 0.0 ? (now - start_) * static_cast<double>(steps_ - step) / taken : 0.0;
}

void Progress::show(std::int64_t step, double t, std::int64_t iterations, double residual) {
  if (!speaks_) return;
  const double now = MPI_Wtime();
  const double pause = std::max(file_interval, file_share * (now - start_));
  if (file_ && (now - appended_ >= pause || step == steps_)) {
    appended_ = now;
    append(step, t, iterations, residual, seconds_left(step, now));
  }
  if (now - last_ < (terminal_ ? terminal_interval : log_interval)) return;
  last_ = now;
  draw(step, t, iterations, seconds_left(step, now));
}

void Progress::draw(std::int64_t step, double t, std::int64_t iterations, double left) {
  const double done = static_cast<double>(step) / static_cast<double>(std::max<std::int64_t>(steps_, 1));
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

void Progress::append(std::int64_t step, double t, std::int64_t iterations, double residual, double left) {
  nlohmann::ordered_json line;
  line["step"] = step;
  line["steps"] = steps_;
  line["t"] = t;
  line["iterations"] = iterations;
  line["residual"] = residual;
  line["left"] = left;
  line["end"] = timestamp(left);
  file_->append(line.dump());
}

}  // namespace sweepvi::app
