#include "io/hdf5_guard.hpp"

#include <unistd.h>

#include <array>
#include <csignal>
#include <vector>

#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

constexpr std::array deadly = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};

std::string message;  // ready before anything can happen
std::vector<char> stack;
stack_t old_stack{};
std::array<struct sigaction, deadly.size()> old_actions{};

void report_and_end(int) {
  static_cast<void>(!write(STDERR_FILENO, message.data(), message.size()));
  _exit(static_cast<int>(ExitCode::bad_input));
}

}  // namespace

Hdf5Guard::Hdf5Guard(const std::string& file) {
  message = "sweepvi: " + file +
            ": the HDF5 library crashed while reading it; the file is damaged, or was made to do so. h5dump "
            "or h5check "
            "may say more\n";
  // A stack of its own: the crash may be the end of the usual one.
  stack.resize(std::size_t{1} << 16U);
  const stack_t own{.ss_sp = stack.data(), .ss_flags = 0, .ss_size = stack.size()};
  sigaltstack(&own, &old_stack);
  struct sigaction action {};
  action.sa_handler = report_and_end;
  action.sa_flags = SA_ONSTACK;
  for (std::size_t i = 0; i < deadly.size(); ++i)
    sigaction(deadly[i], &action, &old_actions[i]);
}

Hdf5Guard::~Hdf5Guard() {
  for (std::size_t i = 0; i < deadly.size(); ++i)
    sigaction(deadly[i], &old_actions[i], nullptr);
  sigaltstack(&old_stack, nullptr);
}

}  // namespace sweepvi
