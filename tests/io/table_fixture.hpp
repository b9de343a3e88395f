// What the tests of TableFile share. What it writes is read back by rank 0 with plain serial HDF5, as any
// other program would.
#pragma once

#include <gtest/gtest.h>
#include <petscsys.h>
#include <sys/resource.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <vector>

#include "io/table_file.hpp"

namespace sweepvi {

namespace fs = std::filesystem;
inline MPI_Comm world() {
  return PETSC_COMM_WORLD;
}

inline int rank() {
  int value = 0;
  MPI_Comm_rank(world(), &value);
  return value;
}

inline int ranks() {
  int value = 0;
  MPI_Comm_size(world(), &value);
  return value;
}

/// A folder of its own for each test, the same on every rank, gone afterwards.
class TableFileTest : public testing::Test {
protected:
  void SetUp() override {
    char name[] = "/tmp/sweepvi_table_XXXXXX";
    if (rank() == 0 && !mkdtemp(name)) name[0] = '\0';
    MPI_Bcast(name, sizeof name, MPI_CHAR, 0, world());
    folder_ = name;
    ASSERT_FALSE(folder_.empty());
  }
  void TearDown() override {
    MPI_Barrier(world());
    if (rank() == 0) fs::remove_all(folder_);
  }
  std::string path(const std::string& name) const { return (folder_ / name).string(); }

  fs::path folder_;
};

/// Columns [first, first + count) of n for this rank; the last rank owns nothing, unless it is alone.
inline void share(hsize_t n, FieldSpec& field) {
  const hsize_t owners = hsize_t(std::max(ranks() - 1, 1)), me = std::min(hsize_t(rank()), owners);
  field.first = n * me / owners;
  field.count = n * std::min(me + 1, owners) / owners - field.first;
}

/// /t, /x of width n and /group/level [n][2]: enough for every kind of field.
inline std::vector<FieldSpec> some_fields(hsize_t n) {
  FieldSpec t{.name = "/t", .extents = {}, .units = "s", .description = "time", .names = {}};
  FieldSpec x{.name = "/x", .extents = {n}, .units = "m", .description = "state", .names = {"q", "v"}};
  FieldSpec level{.name = "/group/level",
                  .type = FieldSpec::Type::integer,
                  .extents = {n, 2},
                  .units = "1",
                  .description = "level used",
                  .names = {}};
  share(n, x);
  share(n, level);
  return {t, x, level};
}

inline void fill_row(TableFile& file, const std::vector<FieldSpec>& fields, hsize_t row) {
  file.real(0)[0] = 0.5 * double(row);
  for (hsize_t j = 0; j < fields[1].count; ++j)
    file.real(1)[j] = 1000.0 * double(row) + double(fields[1].first + j);
  for (hsize_t j = 0; j < 2 * fields[2].count; ++j)
    file.integer(2)[j] = std::int32_t(10 * row + 2 * fields[2].first + j);
  file.commit_row();
}

inline std::vector<hsize_t> shape_of(hid_t file, const char* name) {
  const Hdf5Dataset dataset(H5Dopen2(file, name, H5P_DEFAULT));
  const Hdf5Space space(H5Dget_space(dataset.get()));
  std::vector<hsize_t> shape(std::size_t(std::max(H5Sget_simple_extent_ndims(space.get()), 0)));
  H5Sget_simple_extent_dims(space.get(), shape.data(), nullptr);
  return shape;
}

template <class T>
std::vector<T> content(hid_t file, const char* name, hid_t type) {
  std::size_t size = 1;
  for (const hsize_t extent : shape_of(file, name))
    size *= extent;
  std::vector<T> values(size);
  const Hdf5Dataset dataset(H5Dopen2(file, name, H5P_DEFAULT));
  EXPECT_GE(H5Dread(dataset.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0) << name;
  return values;
}

/// The first `rows` rows are those of fill_row, and there are `in_all`.
inline void expect_rows(hid_t file, hsize_t n, hsize_t rows, hsize_t in_all) {
  ASSERT_EQ(shape_of(file, "/t"), (std::vector<hsize_t>{in_all}));
  ASSERT_EQ(shape_of(file, "/x"), (std::vector<hsize_t>{in_all, n}));
  ASSERT_EQ(shape_of(file, "/group/level"), (std::vector<hsize_t>{in_all, n, 2}));
  const auto t = content<double>(file, "/t", H5T_NATIVE_DOUBLE);
  const auto x = content<double>(file, "/x", H5T_NATIVE_DOUBLE);
  const auto level = content<std::int32_t>(file, "/group/level", H5T_NATIVE_INT32);
  for (hsize_t row = 0; row < rows; ++row) {
    ASSERT_EQ(t[row], 0.5 * double(row));
    for (hsize_t j = 0; j < n; ++j)
      ASSERT_EQ(x[row * n + j], 1000.0 * double(row) + double(j));
    for (hsize_t j = 0; j < 2 * n; ++j)
      ASSERT_EQ(level[row * 2 * n + j], std::int32_t(10 * row + j));
  }
}

inline Hdf5File open_file(const std::string& path) {
  return Hdf5File(H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
}

inline std::vector<std::string> texts(hid_t file, const char* object, const char* name) {
  const Hdf5Attribute attribute(H5Aopen_by_name(file, object, name, H5P_DEFAULT, H5P_DEFAULT));
  if (!attribute) return {"(no attribute)"};
  const Hdf5Space space(H5Aget_space(attribute.get()));
  const Hdf5Type type(H5Aget_type(attribute.get()));
  std::vector<char*> found(std::size_t(H5Sget_simple_extent_npoints(space.get())));
  H5Aread(attribute.get(), type.get(), found.data());
  std::vector<std::string> result(found.begin(), found.end());
  H5Dvlen_reclaim(type.get(), space.get(), H5P_DEFAULT, found.data());
  return result;
}

/// Lets no file of this process grow beyond `bytes` while in scope: a disk that is full, for one process.
class FileSizeLimit {
public:
  explicit FileSizeLimit(rlim_t bytes) : handler_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit limited{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &limited);
  }
  ~FileSizeLimit() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, handler_);
  }
  FileSizeLimit(const FileSizeLimit&) = delete;
  FileSizeLimit& operator=(const FileSizeLimit&) = delete;

private:
  void (*handler_)(int);
  rlimit before_{};
};

/// The Error that `work` throws, or one with ExitCode::done.
template <class Work>
Error error_of(Work&& work) {
  try {
    work();
  } catch (const Error& error) {
    return error;
  }
  return Error(ExitCode::done, "no error");
}

}  // namespace sweepvi
