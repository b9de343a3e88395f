// What ranks do while they wait for each other.
//
// Open MPI waits in a loop of looks for messages. Where ranks share cores (mpi_yield_when_idle, which mpirun
// sets when there are more ranks than cores), it calls sched_yield() after each look that finds nothing. That
// gives a core to who wants it, and otherwise comes back at once: a rank that waits for another one's file
// burns a core all the while, half of it in the kernel. This is the sched_yield() that it finds, in place of
// the C library's: after many looks in vain one after the other it sleeps, each time longer. Where ranks have
// cores of their own, Open MPI does not call it.
#include <sched.h>
#include <sys/syscall.h>
#include <time.h>
#include <unistd.h>

namespace {

constexpr long long one_look =
    4'000;  // ns; a loop that only looks comes back sooner: what takes longer was work
constexpr long long patience = 200;       // looks, some 0.1 ms: messages of a step come within
constexpr long long longer = 10'000;      // ns that each sleep is longer than the one before
constexpr long long longest = 1'000'000;  // ns

long long now() {
  timespec time{};
  clock_gettime(CLOCK_MONOTONIC, &time);
  return 1'000'000'000LL * time.tv_sec + time.tv_nsec;
}

}  // namespace

extern "C" int sched_yield() noexcept {
  thread_local long long last = 0;
  thread_local long long looks = 0;
  if (now() - last > one_look) looks = 0;
  int result = 0;
  if (++looks <= patience) {
    result = static_cast<int>(syscall(SYS_sched_yield));
  } else {
    const long long sleep = (looks - patience) * longer;
    const timespec time{.tv_sec = 0, .tv_nsec = static_cast<long>(sleep < longest ? sleep : longest)};
    nanosleep(&time, nullptr);
  }
  last = now();
  return result;
}
