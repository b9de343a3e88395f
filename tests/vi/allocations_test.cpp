// What a step asks of the heap: nothing that grows with the number of elements.
// ranks: 1
#include <gtest/gtest.h>

#include <atomic>
#include <cstddef>
#include <cstdlib>
#include <string>

#include "app/case.hpp"
#include "chain/chain_scene.hpp"
#include "sweepvi/time_march.hpp"

#if defined(__SANITIZE_ADDRESS__)
constexpr bool counts = false;  // its own allocator
std::size_t allocations_so_far() {
  return 0;
}
#else
constexpr bool counts = true;

namespace {
std::atomic<std::size_t> allocations{0};

std::size_t allocations_so_far() {
  return allocations;
}
}  // namespace

extern "C" {
void* __libc_malloc(std::size_t size);                       // NOLINT: glibc's name
void* __libc_calloc(std::size_t count, std::size_t size);    // NOLINT
void* __libc_realloc(void* memory, std::size_t size);        // NOLINT
void* __libc_memalign(std::size_t align, std::size_t size);  // NOLINT

void* malloc(std::size_t size) {
  ++allocations;
  return __libc_malloc(size);
}
void* calloc(std::size_t count, std::size_t size) {
  ++allocations;
  return __libc_calloc(count, size);
}
void* realloc(void* memory, std::size_t size) {
  ++allocations;
  return __libc_realloc(memory, size);
}
int posix_memalign(void** memory, std::size_t align, std::size_t size) {
  ++allocations;
  *memory = __libc_memalign(align, size);
  return *memory != nullptr ? 0 : 12;
}
}
#endif

namespace sweepvi::test {
namespace {

/// In a step, mean over twenty, of a chain of examples/scaling.
double allocations_per_step(const std::string& name, int elements) {
  const std::string folder = std::getenv("SWEEPVI_SOURCE");
  Scene scene = read_scene(PETSC_COMM_WORLD, folder + "/examples/scaling/" + name + ".toml",
                           {{"model.count", std::to_string(elements)}});
  const auto model = app::make_case(PETSC_COMM_WORLD, scene);
  TimeMarch march(model->dvi(), scene.time.grid());
  const auto take = [&](int steps) {
    for (int i = 0; i < steps; ++i)
      EXPECT_TRUE(march.step().certified);
  };
  take(40);  // what is made when it is first needed
  constexpr int steps = 20;
  const std::size_t before = allocations_so_far();
  take(steps);
  return static_cast<double>(allocations_so_far() - before) / steps;
}

// PETSc's own are there at any size; ours are lists of events that grow to their largest.
TEST(Allocations, OfAStepDoNotGrowWithTheChain) {
  if (!counts) GTEST_SKIP();
  for (const char* name : {"jerk", "flexible", "wall", "contact", "zi"}) {
    SCOPED_TRACE(name);
    const double few = allocations_per_step(name, 100);
    const double many = allocations_per_step(name, 2000);
    std::printf("%s: %.2f and %.2f allocations a step\n", name, few, many);
    EXPECT_LE(many, 20.0);        // a copy of a matrix would be some, an allocation for each element 2000
    EXPECT_LE(many, few + 10.0);  // lists that grow by doubling
  }
}

}  // namespace
}  // namespace sweepvi::test
