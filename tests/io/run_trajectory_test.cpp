// Rows read when they are asked for: against the numbers written, however few of them stay in memory.
#include "io/run_trajectory.hpp"

#include <hdf5_hl.h>

#include <numeric>
#include <random>

#include "io/matrix_fixture.hpp"

namespace sweepvi {
namespace {

constexpr hsize_t rows = 500, width = 7;

double entry(std::size_t k, std::int64_t column) {
  return static_cast<double>(k) * 100.0 + static_cast<double>(column);
}

class RunTrajectoryTest : public MatrixFileTest {
protected:
  void SetUp() override {
    MatrixFileTest::SetUp();
    name_ = path("x.h5");
    std::vector<double> values(rows * width);
    for (std::size_t i = 0; i < values.size(); ++i)
      values[i] = entry(i / width, static_cast<std::int64_t>(i % width));
    values[321 * width + 4] = NAN;
    const Hdf5File file(H5Fcreate(name_.c_str(), H5F_ACC_TRUNC, H5P_DEFAULT, H5P_DEFAULT));
    const hsize_t shape[] = {rows, width}, chunk[] = {13, width};
    const Hdf5Properties properties(H5Pcreate(H5P_DATASET_CREATE));
    H5Pset_chunk(properties.get(), 2, chunk);
    const Hdf5Space space(H5Screate_simple(2, shape, nullptr));
    const Hdf5Dataset x(H5Dcreate2(file.get(), "/x", H5T_IEEE_F64LE, space.get(), H5P_DEFAULT,
                                   properties.get(), H5P_DEFAULT));
    ASSERT_GE(H5Dwrite(x.get(), H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()), 0);
  }

  RunTrajectory open(const std::vector<std::int64_t>& columns, std::size_t memory) const {
    Hdf5File file(H5Fopen(name_.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT));
    Hdf5Object x(H5Oopen(file.get(), "/x", H5P_DEFAULT));
    std::vector<double> t(rows);
    std::iota(t.begin(), t.end(), 0.0);
    return {name_, "x.h5: /x", std::move(file), std::move(x), t, columns, memory};
  }

  std::string name_;
};

TEST_F(RunTrajectoryTest, GivesTheColumnsAskedForAndKeepsEightRowsValid) {
  std::mt19937 random(1);
  for (const std::vector<std::int64_t>& columns : {std::vector<std::int64_t>{0, 1, 2, 5, 6}, {3}, {0, 6}}) {
    for (const std::size_t memory : {std::size_t{1}, std::size_t{3000}, std::size_t{1} << 20}) {
      RunTrajectory x = open(columns, memory);
      EXPECT_EQ(x.rows(), rows);
      ASSERT_EQ(x.components(), columns.size());
      std::vector<std::pair<std::size_t, const double*>> asked;
      for (int i = 0; i < 3000; ++i) {
        const std::size_t k = random() % rows;
        asked.emplace_back(k, x.row(k));
        for (std::size_t back = 0; back < std::min<std::size_t>(asked.size(), 9); ++back) {
          const auto& [row, values] = asked[asked.size() - 1 - back];
          for (std::size_t c = 0; c < columns.size(); ++c)
            ASSERT_EQ(values[c], entry(row, columns[c])) << "row " << row << ", asked for " << back << " ago";
        }
      }
    }
  }
}

TEST_F(RunTrajectoryTest, NamesAnEntryThatIsNotFinite) {
  RunTrajectory x = open({1, 4, 6}, 1);
  EXPECT_EQ(x.row(320)[1], entry(320, 4));
  EXPECT_NE(complaint([&] { x.row(321); }).find("x.h5: /x should hold finite numbers, found nan at [321, 4]"),
            std::string::npos);
  EXPECT_EQ(x.row(322)[2], entry(322, 6));
}

}  // namespace
}  // namespace sweepvi
