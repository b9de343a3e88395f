// ranks: 1 2 3
#include <fcntl.h>

#include <fstream>

#include "io/checksum.hpp"
#include "io/row_source.hpp"
#include "io/table_fixture.hpp"

// Rows that TableFile has marked are read back; what is refused instead. That a killed writer leaves them
// readable is in row_crash_test.cpp.

namespace sweepvi {
namespace {

/// As some_fields, for one rank that has everything.
std::vector<FieldSpec> whole(std::vector<FieldSpec> fields) {
  for (FieldSpec& field : fields) {
    field.first = 0;
    field.count = field.extents.empty() ? 0 : field.extents[0];
  }
  return fields;
}

void add_events(TableFile& file, hsize_t row) {
  for (int k = 0; k < 3; ++k)
    file.add_event(
        {.t = 0.5 * double(row), .constraint = rank() + k * ranks(), .level = 1, .impulse = double(row)});
}

/// Rows [first, last) with the events of add_events.
void fill_rows(TableFile& file, const std::vector<FieldSpec>& fields, hsize_t first, hsize_t last) {
  for (hsize_t row = first; row < last; ++row) {
    add_events(file, row);
    fill_row(file, fields, row);
  }
}

void expect_events(hid_t file, hsize_t rows) {
  const Hdf5Dataset dataset(H5Dopen2(file, "/events", H5P_DEFAULT));
  const Hdf5Type type(H5Dget_type(dataset.get()));
  const auto events = content<Event>(file, "/events", type.get());
  const auto per_row = std::size_t(3 * ranks());
  ASSERT_EQ(events.size(), rows * per_row);
  for (std::size_t i = 0; i < events.size(); ++i) {
    ASSERT_EQ(events[i].t, 0.5 * double(i / per_row));
    ASSERT_EQ(events[i].constraint, std::int64_t(i % per_row));
    ASSERT_EQ(events[i].impulse, double(i / per_row));
  }
}

TEST(Checksum, IsTheSumOfItsParts) {
  std::vector<double> values(100);
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = 1.0 / double(i + 1);
  const auto bytes = std::as_bytes(std::span(values));
  for (const std::uint64_t size : {4, 8, 16}) {
    const std::uint64_t count = bytes.size() / size, first = std::uint64_t{1} << 40;
    const std::uint64_t all = checksum(bytes.data(), count, size, first);
    EXPECT_EQ(all, checksum(bytes.data() + 10 * size, count - 10, size, first + 10) +
                       checksum(bytes.data(), 10, size, first));
    EXPECT_NE(all, checksum(bytes.data(), count, size, first + 1));
    EXPECT_NE(all, checksum(bytes.data(), count - 1, size, first));
  }
}

TEST(Checksum, NoticesWhatDamagedFilesHave) {
  std::vector<double> values(64, 0.0);
  values[1] = -0.0;
  const auto bytes = std::as_writable_bytes(std::span(values));
  for (const std::uint64_t size : {4, 8}) {
    const auto sum = [&] { return checksum(bytes.data(), bytes.size() / size, size, 0); };
    const std::uint64_t right = sum();
    for (std::size_t bit = 0; bit < 8 * bytes.size(); ++bit) {
      bytes[bit / 8] ^= std::byte(1 << bit % 8);
      ASSERT_NE(sum(), right) << bit;
      // Two bits of the same kind, such as two signs.
      bytes[(bit / 8 + 24) % bytes.size()] ^= std::byte(1 << bit % 8);
      ASSERT_NE(sum(), right) << bit;
      bytes[(bit / 8 + 24) % bytes.size()] ^= std::byte(1 << bit % 8);
      bytes[bit / 8] ^= std::byte(1 << bit % 8);
    }
    std::swap(values[0], values[1]);
    EXPECT_NE(sum(), right);
    std::swap(values[0], values[1]);
    EXPECT_EQ(sum(), right);
  }
}

class RowSourceTest : public TableFileTest {
protected:
  /// Reads the mark into path(name) and closes that.
  void copy(const TableMark& mark, const std::vector<FieldSpec>& fields, const std::string& name,
            MPI_Comm comm = world(), const TableOptions& options = {.events = true}) {
    RowSource source(comm, folder_, mark, {"run.h5"});
    TableFile file(comm, path(name), fields, options);
    source.copy_into(file);
    EXPECT_EQ(file.rows(), mark.rows);
    file.finish();
  }
  /// The message of the InputError that reading the mark must end in.
  std::string refusal(const TableMark& mark, const std::vector<FieldSpec>& fields) {
    const Error error = error_of([&] {
      RowSource source(world(), folder_, mark);
      TableFile file(world(), path("refused.h5"), fields, {.events = true});
      source.copy_into(file);
    });
    EXPECT_EQ(error.code(), ExitCode::bad_input) << error.what();
    MPI_Barrier(world());
    return error.what();
  }
};

TEST_F(RowSourceTest, MarkedRowsAreReadBack) {
  struct Case {
    hsize_t n, marked, rows;
    TableOptions options;
  };
  const Case cases[] = {{1, 30, 53, {.events = true, .buffer_bytes = 200}},
                        {7, 5000, 5001, {.events = true}},                         // several chunks of events
                        {1000, 200, 220, {.expected_rows = 300, .events = true}},  // several chunks of rows
                        {20'000, 40, 41, {.events = true, .buffer_bytes = 1}},   // slices far from each other
                        {300'000, 2, 3, {.expected_rows = 3, .events = true}}};  // rows wider than a chunk
  for (const Case& c : cases) {
    const std::vector<FieldSpec> fields = some_fields(c.n);
    TableFile file(world(), path("run.h5"), fields, c.options);
    fill_rows(file, fields, 0, c.marked);
    const TableMark mark = file.mark();
    fill_rows(file, fields, c.marked, c.rows);
    file.flush();
    if (rank() == 0) {
      EXPECT_EQ(mark.file, "run.h5.partial");
      EXPECT_EQ(mark.rows, c.marked);
      EXPECT_EQ(mark.events, 3 * hsize_t(ranks()) * c.marked);
      EXPECT_EQ(mark.fields.size(), 4u);
    }
    copy(mark, fields, "copy.h5");  // while the file is open, as if its writer had been killed
    if (rank() == 0) {              // on another number of ranks
      std::vector<FieldSpec> alone = whole(fields);
      copy(mark, alone, "alone.h5", MPI_COMM_SELF);
      for (const char* name : {"copy.h5", "alone.h5"}) {
        const Hdf5File read = open_file(path(name));
        expect_rows(read.get(), c.n, c.marked, c.marked);
        expect_events(read.get(), c.marked);
        fs::remove(path(name));
      }
    }
    file.discard();
  }
}

TEST_F(RowSourceTest, ARunThatWentOnIsTheSameAsOneThatWasNotInterrupted) {
  const std::vector<FieldSpec> fields = some_fields(50);
  const TableOptions options{.expected_rows = 90, .events = true, .buffer_bytes = 5000};
  TableMark mark;
  {
    TableFile file(world(), path("run.h5"), fields, options);
    fill_rows(file, fields, 0, 20);
    file.mark();
    fill_rows(file, fields, 20, 61);
    mark = file.mark();
    fill_rows(file, fields, 61, 70);  // lost
  }
  RowSource source(world(), folder_, mark);
  EXPECT_EQ(source.path(), path("run.h5.partial"));
  TableOptions aside = options;
  aside.partial = source.partial_beside(path("run.h5"));
  EXPECT_EQ(aside.partial, path("run.h5.restart"));
  TableFile file(world(), path("run.h5"), fields, aside);
  source.copy_into(file);
  TableMark copied = file.mark();
  if (rank() == 0) {
    EXPECT_EQ(copied.file, "run.h5.restart");
    EXPECT_EQ(copied.rows, 61u);
    for (std::size_t i = 0; i < mark.fields.size(); ++i)
      EXPECT_EQ(copied.fields[i].checksum, mark.fields[i].checksum);
    EXPECT_TRUE(fs::exists(path("run.h5.partial")));
  }
  // Who is killed here goes on from the new rows, which must not be overwritten either.
  EXPECT_EQ(RowSource(world(), folder_, copied).partial_beside(path("run.h5")), path("run.h5.partial"));
  MPI_Barrier(world());
  file.rename_partial();
  EXPECT_FALSE(fs::exists(path("run.h5.restart")));
  fill_rows(file, fields, 61, 90);
  copied = file.mark();
  EXPECT_EQ(copied.file, "run.h5.partial");
  file.finish();
  TableFile whole_run(world(), path("whole.h5"), fields, options);
  fill_rows(whole_run, fields, 0, 90);
  const TableMark straight = whole_run.mark();
  whole_run.finish();
  if (rank() != 0) return;
  for (std::size_t i = 0; i < straight.fields.size(); ++i)
    EXPECT_EQ(copied.fields[i].checksum, straight.fields[i].checksum);
  const Hdf5File read = open_file(path("run.h5"));
  expect_rows(read.get(), 50, 90, 90);
  expect_events(read.get(), 90);
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 2);
}

TEST_F(RowSourceTest, AFinishedFileStillHasItsRowsWhereTheMarkSays) {
  const std::vector<FieldSpec> fields = some_fields(30);
  TableFile file(world(), path("run.h5"), fields, {.events = true});
  fill_rows(file, fields, 0, 12);
  TableMark mark = file.mark();
  mark.file = file.name();
  EXPECT_EQ(mark.file, "run.h5");
  std::vector<std::byte> bytes(100'000);
  for (std::size_t i = 0; i < bytes.size(); ++i)
    bytes[i] = std::byte(i * i);
  file.embed("/checkpoint", rank() == 0 ? bytes : std::vector<std::byte>{});
  file.attribute("status", "stopped");
  file.finish();
  copy(mark, fields, "copy.h5");
  if (rank() != 0) return;
  const Hdf5File copied = open_file(path("copy.h5")), read = open_file(path("run.h5"));
  expect_rows(copied.get(), 30, 12, 12);
  expect_rows(read.get(), 30, 12, 12);
  expect_events(copied.get(), 12);
  EXPECT_EQ(content<std::byte>(read.get(), "/checkpoint", H5T_NATIVE_UINT8), bytes);
}

TEST_F(RowSourceTest, NothingIsAMarkToo) {
  const std::vector<FieldSpec> fields = some_fields(3);
  {
    TableFile file(world(), path("run.h5"), fields, {.events = true});
    copy(file.mark(), fields, "empty.h5");
    fill_row(file, fields, 0);  // a row without events
    const TableMark first = file.mark(), again = file.mark();
    copy(again, fields, "one.h5");
    if (rank() == 0) {
      EXPECT_EQ(first.fields[1].addresses, again.fields[1].addresses);
    }
  }
  if (rank() != 0) return;
  expect_rows(open_file(path("empty.h5")).get(), 3, 0, 0);
  expect_rows(open_file(path("one.h5")).get(), 3, 1, 1);
  EXPECT_EQ(shape_of(open_file(path("one.h5")).get(), "/events"), (std::vector<hsize_t>{0}));
}

TEST_F(RowSourceTest, AFileWithoutEvents) {
  const std::vector<FieldSpec> fields = some_fields(3);
  TableFile file(world(), path("run.h5"), fields);
  for (hsize_t row = 0; row < 5; ++row)
    fill_row(file, fields, row);
  copy(file.mark(), fields, "copy.h5", world(), {});
  if (rank() == 0) expect_rows(open_file(path("copy.h5")).get(), 3, 5, 5);
}

TEST_F(RowSourceTest, ADamagedFileIsRefused) {
  const std::vector<FieldSpec> fields = some_fields(40);
  TableFile file(world(), path("run.h5"), fields, {.events = true});
  fill_rows(file, fields, 0, 10);
  const TableMark mark = file.mark();
  // The last byte of each dataset, as the mark has it.
  const auto flip = [&](std::size_t field) {
    if (rank() == 0) {
      const TableMark::Field& f = mark.fields[field];
      std::uint64_t entries = f.name == "/events" ? mark.events : mark.rows;
      for (const std::uint64_t extent : f.extents)
        entries *= extent;
      std::fstream damaged(path("run.h5.partial"), std::ios::in | std::ios::out | std::ios::binary);
      const auto at = std::streamoff(f.addresses.at(0) + entries * f.entry_bytes - 1);
      damaged.seekg(at);
      const char byte = char(damaged.get() ^ 0x10);
      damaged.seekp(at);
      damaged.put(byte);
    }
    MPI_Barrier(world());
  };
  const char* names[] = {"/t", "/x", "/group/level", "/events"};
  for (std::size_t i = 0; i < 4; ++i) {
    flip(i);
    const std::string message = refusal(mark, fields);
    EXPECT_NE(message.find(std::string("dataset ") + names[i] + " are not those"), std::string::npos)
        << message;
    EXPECT_NE(message.find(path("run.h5.partial")), std::string::npos) << message;
    flip(i);
  }
  copy(mark, fields, "copy.h5");  // the bits are back
  if (rank() == 0) fs::resize_file(path("run.h5.partial"), 20'000);
  MPI_Barrier(world());
  const std::string message = refusal(mark, fields);
  EXPECT_NE(message.find("has been cut off or replaced: it has 20000 bytes"), std::string::npos) << message;
  MPI_Barrier(world());
}

TEST_F(RowSourceTest, AnotherRunsFileIsRefused) {
  const std::vector<FieldSpec> fields = some_fields(4);
  const auto run = [&](hsize_t first) {
    TableFile file(world(), path("run.h5"), fields, {.events = true});
    fill_rows(file, fields, first, first + 10);
    return file.mark();
  };
  const TableMark mark = run(0);
  run(1);
  EXPECT_NE(refusal(mark, fields).find("or of another run"), std::string::npos);
  if (rank() == 0) fs::remove(path("run.h5.partial"));
  MPI_Barrier(world());
  const std::string message = refusal(mark, fields);
  EXPECT_NE(message.find("are missing: no file " + path("run.h5.partial")), std::string::npos) << message;
}

TEST_F(RowSourceTest, OtherFieldsAreRefused) {
  const std::vector<FieldSpec> fields = some_fields(4);
  TableFile file(world(), path("run.h5"), fields, {.events = true});
  fill_rows(file, fields, 0, 3);
  const TableMark mark = file.mark();
  const auto attempt = [&](auto&& change) {
    std::vector<FieldSpec> other = fields;
    change(other);
    return refusal(mark, other);
  };
  const std::string wider = attempt([](auto& other) { other = some_fields(5); });
  EXPECT_NE(wider.find("it has /x [4] of 8 bytes each, now it would be /x [5]"), std::string::npos) << wider;
  const std::string fewer = attempt([](auto& other) { other.pop_back(); });
  EXPECT_NE(fewer.find("/group/level"), std::string::npos) << fewer;
  const std::string type = attempt([](auto& other) { other[1].type = FieldSpec::Type::integer; });
  EXPECT_NE(type.find("of 4 bytes each"), std::string::npos) << type;
}

TEST_F(RowSourceTest, AMarkThatMakesNoSenseIsRefused) {
  const std::vector<FieldSpec> fields = some_fields(4);
  TableFile file(world(), path("run.h5"), fields, {.events = true});
  fill_rows(file, fields, 0, 3);
  const TableMark mark = file.mark();
  const auto attempt = [&](auto&& change) {
    TableMark wrong = mark;
    if (rank() == 0) change(wrong);
    const Error error = error_of([&] { RowSource(world(), folder_, wrong); });
    EXPECT_EQ(error.code(), ExitCode::bad_input) << error.what();
  };
  constexpr std::uint64_t huge = ~std::uint64_t{0};
  attempt([](TableMark& m) { m.rows = huge; });
  attempt([](TableMark& m) { m.events = 5000; });
  attempt([](TableMark& m) { m.fields[1].entry_bytes = 0; });
  attempt([](TableMark& m) { m.fields[1].entry_bytes = huge - 3; });
  attempt([](TableMark& m) { m.fields[1].extents = {0}; });
  attempt([](TableMark& m) { m.fields[1].extents = {huge}; });
  attempt([](TableMark& m) { m.fields[1].extents.push_back(2); });
  attempt([](TableMark& m) { m.fields[1].chunk[0] = 0; });
  attempt([](TableMark& m) { m.fields[1].chunk[0] = 1; });
  attempt([](TableMark& m) { m.fields[1].chunk[1] = huge; });
  attempt([](TableMark& m) { m.fields[2].chunk[2] = 1; });
  attempt([](TableMark& m) { m.fields[1].addresses.clear(); });
  attempt([](TableMark& m) { m.fields[1].addresses[0] = huge; });
  attempt([](TableMark& m) { m.fields[1].addresses[0] = huge / 2; });
  attempt([](TableMark& m) { m.file = ""; });
}

TEST_F(RowSourceTest, BytesBeyondFourGigabytes) {
  // One row per chunk; the second chunk lies far out in a sparse file.
  const std::uint64_t far = (std::uint64_t{1} << 33) + 8;
  TableMark mark;
  if (rank() == 0) {
    const double t[] = {0.0, 0.5};
    std::ofstream file(path("run.h5"), std::ios::binary);
    file.seekp(100);
    file.write(reinterpret_cast<const char*>(t), 8);
    file.seekp(std::streamoff(far));
    file.write(reinterpret_cast<const char*>(t + 1), 8);
    mark = {.file = "run.h5", .rows = 2};
    mark.fields = {{.name = "/t",
                    .chunk = {1},
                    .addresses = {100, far},
                    .checksum = checksum(reinterpret_cast<const std::byte*>(t), 2, 8, 0)}};
  }
  RowSource source(world(), folder_, mark);
  TableFile file(world(), path("copy.h5"), {some_fields(1)[0]});
  source.copy_into(file);
  file.finish();
  if (rank() != 0) return;
  EXPECT_EQ(content<double>(open_file(path("copy.h5")).get(), "/t", H5T_NATIVE_DOUBLE),
            (std::vector<double>{0.0, 0.5}));
}

}  // namespace
}  // namespace sweepvi
