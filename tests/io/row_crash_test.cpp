// What a killed writer leaves: the file as it is at some instant. So instead of killing writers we look at
// the file at every instant at which it changes. The functions below stand before those of the C library, for
// HDF5 and MPI-IO too; each change is made in two halves, with a look before, between and after.

#include <dlfcn.h>
#include <fcntl.h>
#include <sys/file.h>
#include <sys/uio.h>

#include <cerrno>
#include <fstream>
#include <functional>
#include <map>
#include <utility>

#include "io/field_reader.hpp"
#include "io/table_fixture.hpp"

namespace {

std::function<void()> on_look;  // empty: nobody looks
bool failing_disk = false;      // does fdatasync fail?
std::size_t looks = 0;

void look() {
  if (!on_look) return;
  const int code = errno;
  const std::function<void()> at_file = std::exchange(on_look, nullptr);
  at_file();
  on_look = at_file;
  ++looks;
  errno = code;
}

template <class Function>
Function* next(Function*, const char* name) {
  return reinterpret_cast<Function*>(dlsym(RTLD_NEXT, name));
}

}  // namespace

extern "C" {

ssize_t pwrite(int file, const void* bytes, std::size_t count, off_t at) {
  static auto* const real = next(&pwrite, "pwrite");
  if (!on_look || count < 2) return real(file, bytes, count, at);
  look();
  const ssize_t half = real(file, bytes, count / 2, at);
  if (half < ssize_t(count / 2)) return half;
  look();
  const ssize_t rest =
      real(file, static_cast<const char*>(bytes) + half, count - std::size_t(half), at + half);
  look();
  return rest < 0 ? half : half + rest;
}

ssize_t pwritev(int file, const iovec* parts, int count, off_t at) {
  ssize_t total = 0;
  for (int i = 0; i < count; ++i) {
    const ssize_t part = pwrite(file, parts[i].iov_base, parts[i].iov_len, at + total);
    if (part < 0) return total > 0 ? total : part;
    total += part;
  }
  return total;
}

int ftruncate(int file, off_t size) noexcept {
  static auto* const real = next(&ftruncate, "ftruncate");
  look();
  const int result = real(file, size);
  look();
  return result;
}

int fallocate(int file, int mode, off_t first, off_t size) {
  static auto* const real = next(&fallocate, "fallocate");
  const int result = real(file, mode, first, size);
  look();
  return result;
}

int rename(const char* from, const char* to) noexcept {
  static auto* const real = next(&rename, "rename");
  look();
  const int result = real(from, to);
  look();
  return result;
}

int fdatasync(int file) {
  static auto* const real = next(&fdatasync, "fdatasync");
  if (!failing_disk) return real(file);
  errno = EIO;
  return -1;
}

}  // extern "C"

namespace sweepvi {
namespace {

/// The rows of the mark, read without HDF5 or other ranks. "" if they are those that were marked.
std::string judge(const TableMark& mark, const std::vector<std::string>& names) {
  const auto name = std::find_if(names.begin(), names.end(), [](auto& n) { return fs::exists(n); });
  if (name == names.end()) return "no file";
  const PosixFile file(*name, O_RDONLY);
  for (const TableMark::Field& field : mark.fields) {
    FieldReader reader(mark, field, file.get(), 0, field.extents.empty() ? 1 : field.extents[0]);
    const std::uint64_t rows = field.name == "/events" ? mark.events : mark.rows;
    try {
      for (std::uint64_t row = 0; row < rows; ++row)
        reader.next();
    } catch (const Error& error) {
      return error.what();
    }
    if (reader.sum() != field.checksum) return "other bytes in " + field.name;
  }
  return "";
}

class RowCrashTest : public TableFileTest {
protected:
  /// From now on every change of the file is looked at, on the rank that knows where the rows are.
  void watch(const TableMark& mark) {
    if (rank() != 0) return;
    marks_.push_back(mark);
    on_look = [this] {
      for (const TableMark& known : marks_) {
        const std::string trouble = judge(known, {path(known.file), path("run.h5")});
        if (!trouble.empty()) ++bad_[trouble];
      }
    };
  }
  void TearDown() override {
    on_look = nullptr;
    failing_disk = false;
    TableFileTest::TearDown();
  }
  void fill(TableFile& file, const std::vector<FieldSpec>& fields, hsize_t rows) {
    for (const hsize_t last = file.rows() + rows; file.rows() < last;) {
      file.add_event({.t = 0.5 * double(file.rows()), .constraint = rank()});
      fill_row(file, fields, file.rows());
    }
  }

  std::vector<TableMark> marks_;
  std::map<std::string, int> bad_;
};

TEST_F(RowCrashTest, AWriterMayBeKilledAtAnyInstant) {
  struct Case {
    hsize_t n, rows;
    TableOptions options;
  };
  const Case cases[] = {{5, 40, {.events = true, .buffer_bytes = 400}},  // all in one chunk
                        {3000, 8, {.expected_rows = 20, .events = true, .buffer_bytes = 1}},  // many chunks
                        {150'000, 1, {.events = true}}};  // several per row
  for (const Case& c : cases) {
    looks = 0;
    const std::vector<FieldSpec> fields = some_fields(c.n);
    TableFile file(world(), path("run.h5"), fields, c.options);
    watch(file.mark());  // of nothing
    fill(file, fields, c.rows);
    for (int k = 0; k < 3; ++k) {
      watch(file.mark());
      fill(file, fields, c.rows / 2 + 1);
      file.attribute("status", std::string(std::size_t(1000 * k), 'x'));
    }
    file.embed("/checkpoint", std::vector<std::byte>(10'000));
    file.finish();
    on_look = nullptr;
    EXPECT_TRUE(bad_.empty()) << bad_.size() << " kinds of damage, such as " << bad_.begin()->first << ", "
                              << bad_.begin()->second << " times";
    if (rank() == 0) {
      EXPECT_GT(looks, 60u);  // about 100 to 400, depending on the ranks
      EXPECT_TRUE(fs::exists(path("run.h5")));
      EXPECT_FALSE(fs::exists(path("run.h5.partial")));
      // Those who look do see damage.
      const TableMark::Field& x = marks_.back().fields[1];
      const PosixFile damaged(path("run.h5"), O_RDWR);
      ASSERT_EQ(pwrite(damaged.get(), "?", 1, off_t(x.addresses.back() + 3)), 1);
      EXPECT_EQ(judge(marks_.back(), {path("run.h5")}), "other bytes in /x");
      fs::remove(path("run.h5"));
    }
    marks_.clear();
    MPI_Barrier(world());
  }
}

TEST_F(RowCrashTest, AFullDiskSpoilsNeitherTheMarkNorTheNext) {
  const hsize_t n = 100'000;
  const std::vector<FieldSpec> fields = some_fields(n);
  TableFile file(world(), path("run.h5"), fields, {.events = true});
  fill(file, fields, 1);
  watch(file.mark());
  fill(file, fields, 1);  // only in the buffer
  MPI_Barrier(world());
  {
    const FileSizeLimit limited(rank() == 0 ? fs::file_size(path("run.h5.partial")) : RLIM_INFINITY);
    while (!file.short_of_room()) {  // the room for these was taken before
      watch(file.mark());
      fill(file, fields, 1);
    }
    watch(file.mark());
    const Error error = error_of([&] {
      for (int i = 0; i < 10; ++i) {
        fill(file, fields, 1);
        watch(file.mark());
      }
    });
    EXPECT_EQ(error.code(), ExitCode::output);
    EXPECT_NE(std::string(error.what()).find("no room for"), std::string::npos) << error.what();
    MPI_Barrier(world());
  }
  EXPECT_FALSE(TableFile::damaged());
  const TableMark later = file.mark();  // somebody made room
  watch(later);
  fill(file, fields, 1);
  file.finish();
  EXPECT_TRUE(bad_.empty());
  if (rank() != 0) return;
  EXPECT_EQ(later.rows + 1, file.rows());
  expect_rows(open_file(path("run.h5")).get(), n, later.rows + 1, later.rows + 1);
}

TEST_F(RowCrashTest, ADiskThatFailsGivesNoMark) {
  const std::vector<FieldSpec> fields = some_fields(10);
  TableFile file(world(), path("run.h5"), fields, {.events = true});
  fill(file, fields, 5);
  watch(file.mark());
  fill(file, fields, 5);
  failing_disk = true;
  const auto lost = [&](auto&& work) {
    const Error error = error_of(work);
    EXPECT_EQ(error.code(), ExitCode::output);
    EXPECT_NE(std::string(error.what()).find("cannot make " + path("run.h5.partial") + " durable"),
              std::string::npos)
        << error.what();
  };
  EXPECT_FALSE(file.lost());
  lost([&] { file.mark(); });
  EXPECT_TRUE(file.lost());
  failing_disk = false;  // a second success would not bring back what the first one lost
  lost([&] { file.mark(); });
  lost([&] { file.finish(); });
  EXPECT_FALSE(fs::exists(path("run.h5")));
  EXPECT_TRUE(bad_.empty());
}

TEST_F(RowCrashTest, AFileThatSomebodyTookAwayIsNotMarkedAndNotFinished) {
  const std::vector<FieldSpec> fields = some_fields(10);
  TableFile file(world(), path("run.h5"), fields, {.events = true});
  fill(file, fields, 5);
  file.mark();
  TableFile second(world(), path("run.h5"), fields, {.events = true});  // another run with the same output
  fill(second, fields, 3);
  const auto lost = [&](auto&& work) {
    const Error error = error_of(work);
    EXPECT_EQ(error.code(), ExitCode::output);
    EXPECT_NE(std::string(error.what()).find("another run with the same output"), std::string::npos)
        << error.what();
  };
  lost([&] { file.mark(); });
  lost([&] { file.finish(); });
  EXPECT_FALSE(fs::exists(path("run.h5")));
  second.finish();
  if (rank() == 0) expect_rows(open_file(path("run.h5")).get(), 10, 3, 3);
}

TEST_F(RowCrashTest, WhoeverHoldsTheFileNeitherStopsTheRunNorLosesAnything) {
  const std::vector<FieldSpec> fields = some_fields(10);
  PosixFile left, running, old;  // in the hands of others, locked
  const auto hold = [&](PosixFile& file, const std::string& name) {
    if (rank() != 0) return;
    file = PosixFile(path(name), O_RDONLY);
    ASSERT_EQ(flock(file.get(), LOCK_EX | LOCK_NB), 0);
  };
  if (rank() == 0) {
    std::ofstream(path("run.h5.partial")) << "of an interrupted run";
    std::ofstream(path("run.h5")) << "of an old run";
  }
  hold(left, "run.h5.partial");
  hold(old, "run.h5");
  MPI_Barrier(world());
  TableFile file(world(), path("run.h5"), fields, {.overwrite = true, .events = true});
  fill(file, fields, 5);
  watch(file.mark());
  hold(running, "run.h5.partial");
  MPI_Barrier(world());
  fill(file, fields, 5);
  watch(file.mark());
  file.finish();
  EXPECT_TRUE(bad_.empty());
  if (rank() != 0) return;
  char text[64] = {};
  EXPECT_EQ(pread(left.get(), text, sizeof text, 0), 21);
  EXPECT_STREQ(text, "of an interrupted run");
  EXPECT_EQ(pread(old.get(), text, sizeof text, 0), 13);
  EXPECT_LT(fs::file_size(path("run.h5")), 1u << 20);  // what was reserved is cut off nevertheless
  running = PosixFile();                               // HDF5 would not open a file that others have locked
  expect_rows(open_file(path("run.h5")).get(), 10, 10, 10);
}

}  // namespace
}  // namespace sweepvi
