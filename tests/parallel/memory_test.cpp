// How much memory there is, read from files like those of Linux; and what is refused because it does not fit.
// ranks: 1 2
#include "parallel/memory.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "app/room.hpp"
#include "parallel/gather.hpp"
#include "sweepvi/petsc.hpp"

namespace sweepvi {
namespace {

namespace fs = std::filesystem;

/// A folder that stands for /; each rank has its own.
class MemoryTest : public testing::Test {
protected:
  void SetUp() override {
    char name[] = "/tmp/sweepvi_memory_XXXXXX";
    ASSERT_NE(mkdtemp(name), nullptr);
    root_ = name;
    put("proc/meminfo", "MemTotal: 9000 kB\nMemAvailable:    8000 kB\nSwapFree:        1000 kB\n");
  }
  void TearDown() override {
    fs::remove_all(root_);
    check(PetscOptionsClearValue(nullptr, "-sweepvi_memory_limit"));
  }
  void put(const std::string& name, const std::string& text) const {
    fs::create_directories((root_ / name).parent_path());
    std::ofstream(root_ / name) << text;
  }
  static void limit(const char* gigabytes) {
    check(PetscOptionsSetValue(nullptr, "-sweepvi_memory_limit", gigabytes));
  }

  fs::path root_;
};

std::string complaint(const std::function<void()>& work) {
  try {
    work();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::bad_input);
    return error.what();
  }
  return "(no error)";
}

TEST_F(MemoryTest, Machine) {
  const Memory memory = available_memory(root_);
  EXPECT_EQ(memory.node, 9000.0 * 1024);
  EXPECT_EQ(memory.source, "available on this machine");
}

TEST_F(MemoryTest, NothingKnown) {
  const Memory memory = available_memory(root_ / "missing");
  EXPECT_TRUE(std::isinf(memory.node));
}

// Pages of files that a group has read count as used, but make room: 3 MB - (2.5 MB - 1.5 MB) = 2 MB, and the
// swap.
TEST_F(MemoryTest, ControlGroup2) {
  put("proc/self/cgroup", "0::/job/step\n");
  put("sys/fs/cgroup/memory.max", "max\n");
  put("sys/fs/cgroup/job/memory.max", "3000000\n");
  put("sys/fs/cgroup/job/memory.current", "2500000\n");
  put("sys/fs/cgroup/job/memory.stat",
      "anon 1000000\nfile 1500000\ninactive_file 1000000\nactive_file 500000\n");
  put("sys/fs/cgroup/job/step/memory.max", "max\n");
  const Memory memory = available_memory(root_);
  EXPECT_EQ(memory.node, 2e6 + 1000.0 * 1024);
  EXPECT_EQ(memory.source, "left to the control group of this process");
}

// In a container the path is that of the host, and the limit stands at the root.
TEST_F(MemoryTest, ControlGroup1OfContainer) {
  put("proc/self/cgroup", "5:cpu,cpuacct:/docker/abc\n4:memory:/docker/abc\n");
  put("sys/fs/cgroup/memory/memory.limit_in_bytes", "4000000\n");
  put("sys/fs/cgroup/memory/memory.usage_in_bytes", "1000000\n");
  put("sys/fs/cgroup/memory/memory.stat", "total_inactive_file 0\ntotal_active_file 0\n");
  EXPECT_EQ(available_memory(root_).node, 3e6 + 1000.0 * 1024);
}

TEST_F(MemoryTest, MoreThanTheGroupMayHave) {
  put("proc/self/cgroup", "0::/\n");
  put("sys/fs/cgroup/memory.max", "1000000\n");
  put("sys/fs/cgroup/memory.current", "2000000\n");
  EXPECT_EQ(available_memory(root_).node, 1000.0 * 1024);
}

// The machine that runs this test has between 10 MB and 1000 TB left, and it is Linux.
TEST_F(MemoryTest, ThisMachine) {
  const Memory memory = available_memory();
  EXPECT_GT(memory.node, 1e7);
  EXPECT_LT(memory.node, 1e15);
  EXPECT_GT(memory.process, 1e7);
}

TEST_F(MemoryTest, Option) {
  limit("3.5");
  EXPECT_EQ(available_memory().node, 3.5e9);
  EXPECT_EQ(complaint([] { require_memory(3.4e9, "this takes"); }), "(no error)");
  EXPECT_EQ(complaint([] { require_memory(3.6e9, "this takes"); }),
            "this takes at least 3.6 GB of memory, and there are 3.5 GB (-sweepvi_memory_limit). If there is "
            "more, say "
            "so: -sweepvi_memory_limit GIGABYTES");
}

// The ranks of this test share a node: what each takes adds up.
TEST_F(MemoryTest, Together) {
  int ranks = 1;
  MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
  limit("6");
  EXPECT_EQ(complaint([&] { require_memory(PETSC_COMM_WORLD, 5.9e9 / ranks, "they take"); }), "(no error)");
  const std::string text = complaint([&] { require_memory(PETSC_COMM_WORLD, 6.1e9 / ranks, "they take"); });
  EXPECT_TRUE(text.starts_with("they take at least 6.1 GB of memory")) << text;
  EXPECT_EQ(text.find(std::to_string(ranks) + " ranks") != std::string::npos, ranks > 1) << text;
}

// `ulimit -v` is each process's own. Lowered to 1 GB more than is taken by now.
TEST_F(MemoryTest, AddressSpace) {
  rlimit before{};
  getrlimit(RLIMIT_AS, &before);
  double pages = 0.0;
  std::ifstream("/proc/self/statm") >> pages;
  rlimit tight = before;
  tight.rlim_cur = static_cast<rlim_t>(pages * static_cast<double>(sysconf(_SC_PAGESIZE)) + 1e9);
  if (tight.rlim_cur > before.rlim_max) GTEST_SKIP() << "the limit is lower already";
  ASSERT_EQ(setrlimit(RLIMIT_AS, &tight), 0);
  const double process = available_memory().process;
  const std::string text = complaint([] { require_memory(1.1e9, "this takes"); });
  setrlimit(RLIMIT_AS, &before);
  EXPECT_NEAR(process, 1e9, 1e8);  // the test itself takes some
  EXPECT_NE(text.find("(ulimit -v)"), std::string::npos) << text;
}

Scene chain_scene(std::int64_t count) {
  Scene scene;
  scene.path = "scene.toml";
  scene.model = ChainSpec::of(*find_element("jerk"), count);
  return scene;
}

TEST_F(MemoryTest, Scenes) {
  limit("1");
  EXPECT_EQ(complaint([] { app::require_room(PETSC_COMM_WORLD, chain_scene(700000)); }), "(no error)");
  const std::string text = complaint([] { app::require_room(PETSC_COMM_WORLD, chain_scene(900000)); });
  EXPECT_TRUE(
      text.starts_with("scene.toml: model.count = 900000 elements with 5 states each take at least 1.12 GB"))
      << text;
}

// No file that says so need exist: sizes are all that is asked for.
TEST_F(MemoryTest, UnknownsBeyond32Bits) {
  limit("1e9");
  Scene scene;
  scene.path = "scene.toml";
  LinearSpec spec;
  spec.A = {1200000000, 1200000000, {}, {}, {}};
  spec.C = {1, 1200000000, {}, {}, {}};
  scene.model = spec;
  const std::string text = complaint([&] { app::require_room(PETSC_COMM_WORLD, scene); });
  EXPECT_TRUE(
      text.starts_with("scene.toml: the model makes up to 2400000001 unknowns; expected at most 2147483647"))
      << text;
}

TEST(Counts, OfMpi) {
  EXPECT_EQ(mpi_count(2147483647), 2147483647);
  EXPECT_THROW(mpi_count(2147483648), Error);
  EXPECT_EQ(starts_of_pieces({1, 2147483645, 1}), (std::vector<int>{0, 1, 2147483646}));
  EXPECT_THROW(starts_of_pieces({1073741824, 1073741824}), Error);
}

}  // namespace
}  // namespace sweepvi
