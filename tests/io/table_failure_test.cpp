#include <fstream>

#include "io/table_fixture.hpp"

namespace sweepvi {
namespace {

TEST_F(TableFileTest, AnExistingFileIsKeptUnlessOverwritten) {
  if (rank() == 0) std::ofstream(path("run.h5")) << "precious";
  MPI_Barrier(world());
  const std::vector<FieldSpec> fields = some_fields(2);
  const Error error = error_of([&] { TableFile(world(), path("run.h5"), fields); });
  EXPECT_EQ(error.code(), ExitCode::output);
  EXPECT_NE(std::string(error.what()).find("--force"), std::string::npos) << error.what();
  EXPECT_FALSE(fs::exists(path("run.h5.partial")));
  EXPECT_EQ(fs::file_size(path("run.h5")), 8u);

  TableFile file(world(), path("run.h5"), fields, {.overwrite = true});
  fill_row(file, fields, 0);
  EXPECT_EQ(fs::file_size(path("run.h5")), 8u);  // until the new one is complete
  file.finish();
  EXPECT_GT(fs::file_size(path("run.h5")), 8u);
}

TEST_F(TableFileTest, AFileThatAppearsMeanwhileIsKept) {
  const std::vector<FieldSpec> fields = some_fields(2);
  TableFile file(world(), path("run.h5"), fields);
  fill_row(file, fields, 0);
  if (rank() == 0) std::ofstream(path("run.h5")) << "precious";
  EXPECT_EQ(error_of([&] { file.finish(); }).code(), ExitCode::output);
  EXPECT_EQ(fs::file_size(path("run.h5")), 8u);
  EXPECT_TRUE(fs::exists(path("run.h5.partial")));
}

TEST_F(TableFileTest, PathsThatCannotBeWritten) {
  if (rank() == 0) {
    fs::create_directory(path("folder"));
    fs::create_directory(path("taken.h5.partial"));
    std::ofstream(path("file")) << "x";
  }
  MPI_Barrier(world());
  struct Case {
    std::string path, message;
  };
  const Case cases[] = {{path("missing/run.h5"), "there is no folder"},
                        {path("file/run.h5"), "there is no folder"},
                        {path("folder"), "not a regular file"},
                        {"/dev/null", "not a regular file"},
                        {"/proc/run.h5", "cannot"},
                        {path("taken.h5"), "Is a directory"}};
  for (const Case& c : cases) {
    const Error error = error_of([&] { TableFile(world(), c.path, some_fields(2), {.overwrite = true}); });
    EXPECT_EQ(error.code(), ExitCode::output) << c.path;
    EXPECT_NE(std::string(error.what()).find(c.message), std::string::npos) << error.what();
    EXPECT_NE(std::string(error.what()).find(c.path), std::string::npos) << error.what();
  }
  EXPECT_EQ(std::distance(fs::directory_iterator(folder_), fs::directory_iterator()), 3);
}

TEST_F(TableFileTest, FieldsThatMakeNoSense) {
  const auto attempt = [&](auto&& change) {
    std::vector<FieldSpec> fields = some_fields(4);
    change(fields);
    const Error error = error_of([&] { TableFile(world(), path("run.h5"), fields); });
    EXPECT_EQ(error.code(), ExitCode::internal) << error.what();
    EXPECT_TRUE(fs::is_empty(folder_));
  };
  attempt([](auto& fields) { fields[0].name = "/time"; });
  attempt([](auto& fields) { fields[0].type = FieldSpec::Type::integer; });
  attempt([](auto& fields) { fields[1].name = "x"; });
  attempt([](auto& fields) { fields[2].extents[1] = 0; });
  attempt([](auto& fields) {
    if (rank() == ranks() - 1) fields[1].first = 5;
  });
  attempt([](auto& fields) {
    if (rank() == 0) --fields[1].count;
  });
}

TEST_F(TableFileTest, AFullDiskIsEveryRanksErrorAndCostsNoRow) {
  // Rank 0 reserves the space; nobody gets to write what has no place.
  const hsize_t n = 100'000;
  const std::vector<FieldSpec> fields = some_fields(n);
  TableFile file(world(), path("run.h5"), fields, {.events = true, .buffer_bytes = 1});
  fill_row(file, fields, 0);
  file.add_event({.t = 0.5, .constraint = rank()});
  EXPECT_FALSE(file.short_of_room());
  MPI_Barrier(world());
  {
    const FileSizeLimit limited(rank() == 0 ? fs::file_size(path("run.h5.partial")) : RLIM_INFINITY);
    for (hsize_t row = 1; row < 5; ++row) {  // the room for these was taken before
      fill_row(file, fields, row);
      EXPECT_TRUE(file.short_of_room());
    }
    const Error error = error_of([&] { fill_row(file, fields, 5); });
    EXPECT_EQ(error.code(), ExitCode::output);
    EXPECT_NE(std::string(error.what()).find("no room for"), std::string::npos) << error.what();
    EXPECT_EQ(error_of([&] { file.real(0); }).code(), ExitCode::internal);  // the buffer is full
    MPI_Barrier(world());
  }
  EXPECT_FALSE(TableFile::damaged());
  file.flush();  // somebody made room
  EXPECT_FALSE(file.short_of_room());
  fill_row(file, fields, 6);
  file.finish();
  if (rank() != 0) return;
  const Hdf5File read(H5Fopen(path("run.h5").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  EXPECT_EQ(shape_of(read.get(), "/events"), (std::vector<hsize_t>{hsize_t(ranks())}));
  const auto x = content<double>(read.get(), "/x", H5T_NATIVE_DOUBLE);
  ASSERT_EQ(x.size(), 7 * n);
  for (hsize_t i = 0; i < x.size(); ++i)
    ASSERT_EQ(x[i], 1000.0 * double(i / n) + double(i % n));
}

TEST_F(TableFileTest, AFullDiskLeavesAReadablePartialFile) {
  const hsize_t n = 100'000;
  const std::vector<FieldSpec> fields = some_fields(n);
  {
    TableFile file(world(), path("run.h5"), fields, {.buffer_bytes = 1});
    fill_row(file, fields, 0);
    MPI_Barrier(world());
    const FileSizeLimit limited(rank() == 0 ? fs::file_size(path("run.h5.partial")) : RLIM_INFINITY);
    for (hsize_t row = 1; row < 5; ++row)
      fill_row(file, fields, row);
    EXPECT_EQ(error_of([&] { fill_row(file, fields, 5); }).code(), ExitCode::output);
    EXPECT_EQ(error_of([&] { file.finish(); }).code(), ExitCode::output);
    MPI_Barrier(world());
  }
  if (rank() != 0) return;
  const Hdf5File read(H5Fopen(path("run.h5.partial").c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
  EXPECT_EQ(shape_of(read.get(), "/x"), (std::vector<hsize_t>{5, n}));
}

TEST_F(TableFileTest, NoRoomEvenToBegin) {
  const FileSizeLimit limited(rank() == 0 ? 1 << 16 : RLIM_INFINITY);
  const Error error = error_of([&] { TableFile(world(), path("run.h5"), some_fields(2)); });
  EXPECT_EQ(error.code(), ExitCode::output);
  EXPECT_TRUE(fs::is_empty(folder_));
  MPI_Barrier(world());
}

}  // namespace
}  // namespace sweepvi
