// A crash while HDF5 reads ends the process with exit code 2 and a sentence; before and after, signals are as
// they were.
//
// ranks: 1
#include "io/hdf5_guard.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstdlib>

namespace sweepvi {
namespace {

[[noreturn]] void crash(int signal) {
  const Hdf5Guard guard("m.h5");
  std::raise(signal);
  _exit(0);
}

TEST(Hdf5Guard, Crashes) {
  for (const int signal : {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT})
    EXPECT_EXIT(crash(signal), testing::ExitedWithCode(2), "^sweepvi: m.h5: the HDF5 library crashed")
        << signal;
}

// What damaged files also do to the library: recursion without end. The handler needs a stack of its own.
int deeper(volatile int* depth) {
  volatile int room[1000] = {*depth};
  *depth = *depth - 1;
  return *depth == 0 ? 0 : deeper(depth) + room[0];
}

[[noreturn]] void overflow() {
  rlimit small{1U << 20U, 1U << 20U};
  setrlimit(RLIMIT_STACK, &small);
  const Hdf5Guard guard("m.h5");
  volatile int depth = 1000000;
  _exit(deeper(&depth) == 0 ? 0 : 1);
}

TEST(Hdf5Guard, EndlessRecursion) {
  EXPECT_EXIT(overflow(), testing::ExitedWithCode(2), "^sweepvi: m.h5: the HDF5 library crashed");
}

TEST(Hdf5Guard, LeavesSignalsAlone) {
  struct sigaction before {};
  struct sigaction after {};
  sigaction(SIGSEGV, nullptr, &before);
  { const Hdf5Guard guard("m.h5"); }
  sigaction(SIGSEGV, nullptr, &after);
  EXPECT_EQ(before.sa_handler, after.sa_handler);
}

}  // namespace
}  // namespace sweepvi
