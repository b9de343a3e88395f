// ranks: 1 2 3
#include <hdf5_hl.h>

#include "io/table_fixture.hpp"

// What TableFile writes; what it refuses and how it fails is in table_failure_test.cpp.

namespace sweepvi {
namespace {

TEST_F(TableFileTest, WhatWasWrittenIsRead) {
  // Many more rows than fit into the buffer, and a rest at the end.
  for (const hsize_t n : {1, 7, 100}) {
    const hsize_t rows = 53;
    const std::vector<FieldSpec> fields = some_fields(n);
    const std::string name = path("run" + std::to_string(n) + ".h5");
    TableFile file(world(), name, fields, {.buffer_bytes = 10 * (16 * n + 8)});
    for (hsize_t row = 0; row < rows; ++row)
      fill_row(file, fields, row);
    EXPECT_EQ(file.rows(), rows);
    EXPECT_FALSE(fs::exists(name));
    file.finish();
    EXPECT_TRUE(fs::exists(name));
    EXPECT_FALSE(fs::exists(name + ".partial"));
    if (rank() != 0) continue;

    const Hdf5File read = open_file(name);
    ASSERT_TRUE(read);
    expect_rows(read.get(), n, rows, rows);
  }
}

TEST_F(TableFileTest, ARowWiderThanAChunkAndTheBuffer) {
  const hsize_t n = 300'000;  // 2.4 MB
  std::vector<FieldSpec> fields = some_fields(n);
  TableFile file(world(), path("wide.h5"), fields, {.buffer_bytes = 1});
  for (hsize_t row = 0; row < 3; ++row)
    fill_row(file, fields, row);
  file.finish();
  if (rank() != 0) return;
  const Hdf5File read(H5Fopen(path("wide.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  const auto x = content<double>(read.get(), "/x", H5T_NATIVE_DOUBLE);
  ASSERT_EQ(x.size(), 3 * n);
  for (hsize_t i = 0; i < x.size(); ++i)
    ASSERT_EQ(x[i], 1000.0 * double(i / n) + double(i % n));

  const Hdf5Dataset dataset(H5Dopen2(read.get(), "/x", H5P_DEFAULT));
  const Hdf5Properties properties(H5Dget_create_plist(dataset.get()));
  hsize_t chunk[2];
  ASSERT_EQ(H5Pget_chunk(properties.get(), 2, chunk), 2);
  EXPECT_EQ(chunk[0], 1u);
  EXPECT_EQ(chunk[1], n / 3);  // three chunks of 0.8 MB
}

TEST_F(TableFileTest, ShortFilesStaySmall) {
  const std::vector<FieldSpec> fields = some_fields(3);
  TableFile file(world(), path("short.h5"), fields, {.expected_rows = 2});
  for (hsize_t row = 0; row < 2; ++row)
    fill_row(file, fields, row);
  file.finish();
  EXPECT_LT(fs::file_size(path("short.h5")), 32u << 10);
}

TEST_F(TableFileTest, AttributesAndScales) {
  std::vector<FieldSpec> fields = some_fields(4);
  fields[2].names.assign(4000, "a name");  // does not fit: left out
  TableFile file(world(), path("run.h5"), fields, {.events = true, .impulse_units = "N s"});
  fill_row(file, fields, 0);
  const std::string scene(100'000, 'x');  // longer than an HDF5 attribute, if it were not of variable length
  file.attribute("scene", scene);
  file.attribute("status", "running");
  file.attribute("status", "done");
  file.attribute("host", "rank " + std::to_string(rank()));
  file.attribute("format_version", 1);
  file.attribute("step", 1e-3);
  const std::vector<std::int64_t> elements{3, 5, 8};
  file.list("/element", rank() == 0 ? elements : std::vector<std::int64_t>{}, "1", "recorded elements");
  file.finish();
  if (rank() != 0) return;

  const Hdf5File read(H5Fopen(path("run.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  using Texts = std::vector<std::string>;
  EXPECT_EQ(texts(read.get(), "/x", "units"), Texts{"m"});
  EXPECT_EQ(texts(read.get(), "/x", "description"), Texts{"state"});
  EXPECT_EQ(texts(read.get(), "/x", "names"), (Texts{"q", "v"}));
  EXPECT_EQ(H5Aexists_by_name(read.get(), "/group/level", "names", H5P_DEFAULT), 0);
  EXPECT_EQ(texts(read.get(), "/", "scene"), Texts{scene});
  EXPECT_EQ(texts(read.get(), "/", "status"), Texts{"done"});
  EXPECT_EQ(texts(read.get(), "/", "host"), Texts{"rank 0"});
  EXPECT_EQ(content<std::int64_t>(read.get(), "/element", H5T_NATIVE_INT64), elements);
  long version = 0;
  double step = 0;
  H5LTget_attribute_long(read.get(), "/", "format_version", &version);
  H5LTget_attribute_double(read.get(), "/", "step", &step);
  EXPECT_EQ(version, 1);
  EXPECT_EQ(step, 1e-3);

  const Hdf5Dataset t(H5Dopen2(read.get(), "/t", H5P_DEFAULT));
  EXPECT_GT(H5DSis_scale(t.get()), 0);
  for (const char* name : {"/x", "/group/level"}) {
    const Hdf5Dataset dataset(H5Dopen2(read.get(), name, H5P_DEFAULT));
    EXPECT_GT(H5DSis_attached(dataset.get(), t.get(), 0), 0) << name;
  }
}

TEST_F(TableFileTest, EventsAreSorted) {
  const std::vector<FieldSpec> fields = some_fields(5);
  const hsize_t rows = 40;
  {
    // Each step every rank sees two constraints' impacts and a lift-off, in the wrong order.
    TableFile file(world(), path("run.h5"), fields, {.events = true, .buffer_bytes = 1000});
    for (hsize_t row = 0; row < rows; ++row) {
      const double t = 0.5 * double(row);
      file.add_event({.t = t, .constraint = ranks() + rank(), .level = 2, .impulse = 1.5});
      file.add_event({.t = t, .constraint = rank(), .level = 2, .kind = Event::Kind::liftoff});
      file.add_event({.t = t, .constraint = rank(), .level = 1, .impulse = double(row)});
      fill_row(file, fields, row);
    }
    file.finish();
  }
  if (rank() != 0) return;
  const Hdf5File read(H5Fopen(path("run.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  const Hdf5Dataset dataset(H5Dopen2(read.get(), "/events", H5P_DEFAULT));
  const Hdf5Type type(H5Dget_type(dataset.get()));
  ASSERT_EQ(H5Tget_nmembers(type.get()), 5);
  const Hdf5Type kind(H5Tget_member_type(type.get(), 3));
  char name[16];
  const std::int32_t one = 1;
  ASSERT_GE(H5Tenum_nameof(kind.get(), &one, name, sizeof name), 0);
  EXPECT_STREQ(name, "liftoff");

  const auto events = content<Event>(read.get(), "/events", type.get());
  const auto per_row = std::size_t(3 * ranks());
  ASSERT_EQ(events.size(), rows * per_row);
  for (std::size_t i = 0; i < events.size(); ++i) {
    const std::size_t row = i / per_row, place = i % per_row;
    ASSERT_EQ(events[i].t, 0.5 * double(row));
    if (place >= std::size_t(2 * ranks())) {  // constraints ranks() ... 2 ranks() - 1
      ASSERT_EQ(events[i].constraint, std::int64_t(place) - ranks());
      ASSERT_EQ(events[i].impulse, 1.5);
    } else {  // both levels of constraint place/2
      ASSERT_EQ(events[i].constraint, std::int64_t(place / 2));
      ASSERT_EQ(events[i].level, std::int32_t(1 + place % 2));
      ASSERT_EQ(events[i].kind, place % 2 ? Event::Kind::liftoff : Event::Kind::impact);
      ASSERT_EQ(events[i].impulse, place % 2 ? 0.0 : double(row));
    }
  }
}

TEST_F(TableFileTest, NoRowsAndNoEvents) {
  TableFile file(world(), path("empty.h5"), some_fields(2), {.events = true});
  file.finish();
  if (rank() != 0) return;
  const Hdf5File read(H5Fopen(path("empty.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  EXPECT_EQ(shape_of(read.get(), "/x"), (std::vector<hsize_t>{0, 2}));
  EXPECT_EQ(shape_of(read.get(), "/events"), (std::vector<hsize_t>{0}));
}

TEST_F(TableFileTest, AFlushedPartialFileCanBeRead) {
  const std::vector<FieldSpec> fields = some_fields(2);
  {
    TableFile file(world(), path("run.h5"), fields);
    fill_row(file, fields, 0);
    file.flush();
    fill_row(file, fields, 1);
  }  // never finished
  EXPECT_FALSE(fs::exists(path("run.h5")));
  if (rank() != 0) return;
  const Hdf5File read(H5Fopen(path("run.h5.partial").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  EXPECT_EQ(shape_of(read.get(), "/x"), (std::vector<hsize_t>{1, 2}));
}

TEST_F(TableFileTest, DiscardLeavesNothing) {
  const std::vector<FieldSpec> fields = some_fields(2);
  TableFile file(world(), path("run.h5"), fields);
  fill_row(file, fields, 0);
  file.discard();
  EXPECT_TRUE(fs::is_empty(folder_));
  const Error error = error_of([&] { file.flush(); });
  EXPECT_EQ(error.code(), ExitCode::internal);
}

}  // namespace
}  // namespace sweepvi
