// ranks: 1 2 3
#include <hdf5_hl.h>

#include <array>
#include <cmath>
#include <filesystem>
#include <fstream>

#include "io/hdf5_handle.hpp"
#include "io/matrix_fixture.hpp"

namespace sweepvi {
namespace {

/// An HDF5 file with good and bad matrices.
class Hdf5MatrixTest : public MatrixFileTest {
protected:
  void SetUp() override {
    MatrixFileTest::SetUp();
    name_ = path("m.h5");
    file_ = Hdf5File(H5Fcreate(name_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
    ASSERT_TRUE(file_);
  }
  void put(const std::string& name, std::vector<hsize_t> shape, const std::vector<double>& values) {
    ASSERT_GE(
        H5LTmake_dataset_double(file_.get(), name.c_str(), int(shape.size()), shape.data(), values.data()),
        0);
  }
  void put(const std::string& name, const std::vector<long>& values) {
    const hsize_t size = values.size();
    ASSERT_GE(H5LTmake_dataset_long(file_.get(), name.c_str(), 1, &size, values.data()), 0);
  }
  /// A group /g with the matrix [1 0 2; 0 0 0; 3 0 0], changed by `change` before it is written.
  struct Group {
    Values data{1, 2, 3};
    std::vector<long> indices{0, 2, 0}, indptr{0, 2, 2, 3}, shape{3, 3};
  };
  void put(const Group& group) {
    const Hdf5Object made(H5Gcreate2(file_.get(), "/g", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
    put("/g/data", {group.data.size()}, group.data);
    put("/g/indices", group.indices);
    put("/g/indptr", group.indptr);
    if (!group.shape.empty())
      H5LTset_attribute_long(file_.get(), "/g", "shape", group.shape.data(), group.shape.size());
  }
  void close() { file_.close(); }
  void expect(const std::string& dataset, const std::string& message) {
    close();
    const std::string found = complaint([&] { read_hdf5_matrix(name_, dataset); });
    EXPECT_NE(found.find(message), std::string::npos) << found;
    EXPECT_TRUE(found.starts_with(name_ + ": " + dataset)) << found;
  }

  std::string name_;
  Hdf5File file_;
};

TEST_F(Hdf5MatrixTest, Dense) {
  put("/A", {2, 3}, {1, 0, 2, 0, 0, 3});
  close();
  const SparseEntries matrix = read_hdf5_matrix(name_, "/A");
  EXPECT_EQ(matrix.rows, 2);
  EXPECT_EQ(matrix.cols, 3);
  EXPECT_EQ(matrix.values.size(), 3u);
  EXPECT_EQ(dense(matrix), (Values{1, 0, 2, 0, 0, 3}));
  EXPECT_EQ(dense(read_hdf5_matrix(name_, "A")), dense(matrix));
}

TEST_F(Hdf5MatrixTest, DenseInSeveralBlocks) {
  const hsize_t rows = 3000, cols = 1000;
  Values values(rows * cols);
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] = i % 7 == 0 ? double(i) : 0.0;
  put("/A", {rows, cols}, values);
  close();
  EXPECT_EQ(dense(read_hdf5_matrix(name_, "/A")), values);
}

/// Bytes that this process has read so far.
double bytes_read() {
  std::ifstream file("/proc/self/io");
  std::string name;
  double count = 0.0;
  file >> name >> count;
  return name == "rchar:" ? count : 0.0;
}

// Chunks larger than HDF5's usual cache, and read in blocks of rows: each is read, and unpacked, once.
TEST_F(Hdf5MatrixTest, DenseInLargeChunks) {
  constexpr hsize_t size = 1500;
  const std::array<hsize_t, 2> shape = {size, size};
  for (const hsize_t width : {size, hsize_t{500}}) {
    const std::string name = "/A" + std::to_string(width);
    const std::array<hsize_t, 2> chunk = {size, width};
    const Hdf5Properties creation(H5Pcreate(H5P_DATASET_CREATE));
    H5Pset_chunk(creation.get(), 2, chunk.data());
    H5Pset_deflate(creation.get(), 1);
    const Hdf5Space space(H5Screate_simple(2, shape.data(), nullptr));
    const Hdf5Dataset dataset(H5Dcreate2(file_.get(), name.c_str(), H5T_NATIVE_DOUBLE, space.get(),
                                         H5P_DEFAULT, creation.get(), H5P_DEFAULT));
    Values values(size * size);
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = std::fmod(double(i) * 0.6180339887498949, 1.0) + 0.1;
    ASSERT_GE(H5Dwrite(dataset.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
  }
  close();
  const auto file_bytes = double(std::filesystem::file_size(name_));
  for (const char* name : {"/A1500", "/A500"}) {
    const double before = bytes_read();
    const SparseEntries matrix = read_hdf5_matrix(name_, name);
    EXPECT_EQ(matrix.values.size(), size * size);
    EXPECT_LT(bytes_read() - before, 1.2 * file_bytes) << "of two matrices of the same size";
  }
}

TEST_F(Hdf5MatrixTest, Sparse) {
  put(Group{});
  close();
  EXPECT_EQ(dense(read_hdf5_matrix(name_, "/g")), (Values{1, 0, 2, 0, 0, 0, 3, 0, 0}));
}

TEST_F(Hdf5MatrixTest, SparseInAnyOrderWithDuplicates) {
  put(Group{.data = {1, 2, 4}, .indices = {2, 0, 2}, .indptr = {0, 3}, .shape = {1, 3}});
  close();
  EXPECT_EQ(dense(read_hdf5_matrix(name_, "/g")), (Values{2, 0, 5}));
}

TEST_F(Hdf5MatrixTest, Vectors) {
  put("/v", {3}, {1, 2, 3});
  put("/column", {3, 1}, {1, 2, 3});
  put("/row", {1, 3}, {1, 2, 3});
  put("/whole", {1, 2, 3});
  put("/A", {2, 2}, {1, 2, 3, 4});
  put("/bad", {2}, {1, HUGE_VAL});
  close();
  for (const char* name : {"/v", "/column", "/row", "/whole"})
    EXPECT_EQ(read_hdf5_vector(name_, name), (Values{1, 2, 3})) << name;
  EXPECT_NE(complaint([&] { read_hdf5_vector(name_, "/A"); }).find("has shape 2 x 2; a vector"),
            std::string::npos);
  EXPECT_NE(complaint([&] { read_hdf5_vector(name_, "/bad"); }).find("found inf at [1]"), std::string::npos);
  EXPECT_NE(complaint([&] { read_hdf5_vector(name_, "/none"); }).find("not in the file"), std::string::npos);
}

TEST_F(Hdf5MatrixTest, FilesThatAreNone) {
  close();
  std::ofstream(path("text.h5")) << "not HDF5";
  fs::resize_file(name_, fs::file_size(name_) / 2);
  EXPECT_NE(complaint([&] { read_hdf5_matrix(path("none.h5"), "/A"); }).find("no such file"),
            std::string::npos);
  EXPECT_NE(complaint([&] { read_hdf5_matrix(folder_.string(), "/A"); }).find("is a folder"),
            std::string::npos);
  EXPECT_NE(complaint([&] { read_hdf5_matrix(path("text.h5"), "/A"); }).find("not an HDF5 file"),
            std::string::npos);
  EXPECT_NE(complaint([&] { read_hdf5_matrix(name_, "/A"); }).find("cannot be opened"), std::string::npos);
}

TEST_F(Hdf5MatrixTest, AMissingDatasetListsWhatIsThere) {
  put("/B", {1, 1}, {1});
  put(Group{});
  expect("/A", "not in the file, which holds /B, /g, /g/data, /g/indices, /g/indptr;");
}

TEST_F(Hdf5MatrixTest, OnlyTheFirstOfManyAreListed) {
  for (int i = 0; i < 30; ++i)
    put("/d" + std::to_string(10 + i), {1}, {1});
  expect("/A", "/d28, /d29, ...;");
}

TEST_F(Hdf5MatrixTest, DenseOfWrongShape) {
  put("/A", {4}, {1, 2, 3, 4});
  expect("/A", "has shape 4; a matrix with two axes");
}

TEST_F(Hdf5MatrixTest, DenseNotFinite) {
  put("/A", {2, 2}, {1, 2, NAN, 4});
  expect("/A", "found nan at [1, 0]");
}

TEST_F(Hdf5MatrixTest, DenseText) {
  H5LTmake_dataset_string(file_.get(), "/A", "text");
  expect("/A", "a matrix with two axes");
}

TEST_F(Hdf5MatrixTest, DenseComplex) {
  const Hdf5Type type(H5Tcreate(H5T_COMPOUND, 16));
  H5Tinsert(type.get(), "r", 0, H5T_NATIVE_DOUBLE);
  H5Tinsert(type.get(), "i", 8, H5T_NATIVE_DOUBLE);
  const hsize_t shape[] = {1, 1};
  const double value[] = {1, 2};
  H5LTmake_dataset(file_.get(), "/A", 2, shape, type.get(), value);
  expect("/A", "compound, as complex numbers are");
}

TEST_F(Hdf5MatrixTest, DenseEmpty) {
  put("/A", {0, 3}, {});
  expect("/A", "has shape 0 x 3");
}

TEST_F(Hdf5MatrixTest, SparseWithoutParts) {
  const Hdf5Object made(H5Gcreate2(file_.get(), "/g", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  put("/g/data", {1}, {1});
  expect("/g", "is a group without indices, indptr");
}

TEST_F(Hdf5MatrixTest, SparseWithoutShape) {
  put(Group{.shape = {}});
  expect("/g", "attribute shape with two whole numbers");
}

TEST_F(Hdf5MatrixTest, SparseWithLongShape) {
  put(Group{.shape = {3, 3, 3}});
  expect("/g", "attribute shape with two whole numbers");
}

TEST_F(Hdf5MatrixTest, SparseWithNegativeShape) {
  put(Group{.shape = {3, -3}});
  expect("/g", "attribute shape is (3, -3)");
}

TEST_F(Hdf5MatrixTest, SparseWithWrongPointerLength) {
  put(Group{.indptr = {0, 2, 3}});
  expect("/g", "/indptr has length 3; expected rows + 1 = 4");
}

TEST_F(Hdf5MatrixTest, SparseWithDecreasingPointers) {
  put(Group{.indptr = {0, 2, 1, 3}});
  expect("/g", "/indptr should not decrease, found 1 after 2 at [2]");
}

TEST_F(Hdf5MatrixTest, SparseWithWrongPointerEnds) {
  put(Group{.indptr = {0, 2, 2, 4}});
  expect("/g", "/indptr goes from 0 to 4; expected 0 to the length of data, 3");
}

TEST_F(Hdf5MatrixTest, SparseWithTooFewIndices) {
  put(Group{.indices = {0, 2}});
  expect("/g", "/indices has length 2; expected that of data, 3");
}

TEST_F(Hdf5MatrixTest, SparseWithIndicesFromOne) {
  put(Group{.indices = {1, 3, 1}});
  expect("/g", "/indices holds column 3 at [1]; expected 0 ... 2");
}

TEST_F(Hdf5MatrixTest, SparseNotFinite) {
  put(Group{.data = {1, NAN, 3}});
  expect("/g", "/data should hold finite numbers, found nan at [1]");
}

TEST_F(Hdf5MatrixTest, SparseWithFloatingIndices) {
  put(Group{});
  H5Ldelete(file_.get(), "/g/indices", H5P_DEFAULT);
  put("/g/indices", {3}, {0, 2, 0});
  expect("/g", "/indices should hold whole numbers, found another type (floating point)");
}

TEST_F(Hdf5MatrixTest, SparseByColumns) {
  put(Group{});
  H5LTset_attribute_string(file_.get(), "/g", "encoding-type", "csc_matrix");
  close();
  EXPECT_EQ(dense(read_hdf5_matrix(name_, "/g")), (Values{1, 0, 3, 0, 0, 0, 2, 0, 0}));
}

}  // namespace
}  // namespace sweepvi
