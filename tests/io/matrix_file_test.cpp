// ranks: 1 2 3
#include "io/matrix_fixture.hpp"
#include "io/printable.hpp"

// MatrixMarket files; HDF5 files are in hdf5_matrix_test.cpp.

namespace sweepvi {
namespace {

TEST_F(MatrixFileTest, MatrixMarketForms) {
  struct Case {
    std::string text;
    Values expected;  // 2 columns
  };
  const Case cases[] = {
      {"%%MatrixMarket matrix coordinate real general\n2 2 3\n2 2 4\n1 2 2\n1 1 1e0\n", {1, 2, 0, 4}},
      // Capitals, comments, blank lines, other white space, Windows line ends, no newline at the end.
      {"%%MATRIXMARKET Matrix Coordinate REAL general\r\n% c\r\n\r\n 2\t2 1 \r\n%c\r\n  1 2  +2.5\r\n\r\n",
       {0, 2.5, 0, 0}},
      {"%%MatrixMarket matrix coordinate real general\n2 2 1\n2 1 -.5", {0, 0, -0.5, 0}},
      // An entry given more than once is the sum.
      {"%%MatrixMarket matrix coordinate real general\n2 2 4\n1 2 1\n1 1 5\n1 2 2\n1 2 4\n", {5, 7, 0, 0}},
      {"%%MatrixMarket matrix coordinate integer symmetric\n2 2 2\n1 1 3\n2 1 -7\n", {3, -7, -7, 0}},
      {"%%MatrixMarket matrix coordinate real skew-symmetric\n2 2 1\n2 1 -7\n", {0, 7, -7, 0}},
      {"%%MatrixMarket matrix coordinate pattern general\n2 2 2\n1 2\n2 1\n", {0, 1, 1, 0}},
      {"%%MatrixMarket matrix coordinate pattern symmetric\n2 2 2\n2 2\n2 1\n", {0, 1, 1, 1}},
      {"%%MatrixMarket matrix coordinate real general\n3 2 0\n", {0, 0, 0, 0, 0, 0}},
      {"%%MatrixMarket matrix array real general\n3 2\n1\n3\n5\n2\n4\n6\n", {1, 2, 3, 4, 5, 6}},
      {"%%MatrixMarket matrix array integer general\n1 2\n1 2\n", {1, 2}},
      {"%%MatrixMarket matrix array real symmetric\n2 2\n1\n2\n3\n", {1, 2, 2, 3}},
      {"%%MatrixMarket matrix array real skew-symmetric\n2 2\n2\n", {0, -2, 2, 0}},
      // Too small for a double: 0, not an error.
      {"%%MatrixMarket matrix array real general\n1 2\n1e-400\n4.9e-324\n", {0, 4.9e-324}},
  };
  for (const Case& c : cases) {
    const SparseEntries matrix = read_matrix_file(file(c.text));
    ASSERT_EQ(matrix.cols, 2) << c.text;
    EXPECT_EQ(dense(matrix), c.expected) << c.text;
  }
}

TEST_F(MatrixFileTest, ZerosAreKeptWhereTheyAreNamed) {
  EXPECT_EQ(
      read_matrix_file(file("%%MatrixMarket matrix coordinate real general\n1 2 1\n1 1 0\n")).values.size(),
      1u);
  EXPECT_EQ(read_matrix_file(file("%%MatrixMarket matrix array real general\n1 2\n1\n0\n")).values.size(),
            1u);
}

TEST_F(MatrixFileTest, MalformedMatrixMarket) {
  const std::string real = "%%MatrixMarket matrix coordinate real general\n";
  const std::string array = "%%MatrixMarket matrix array real general\n";
  struct Case {
    std::string text;
    int line;
    std::string message;
  };
  const Case cases[] = {
      {"", 1, "found nothing"},
      {"1 2 3\n", 1, "should begin with '%%MatrixMarket matrix', found '1 2 3'"},
      {"%MatrixMarket matrix coordinate real general\n1 1 0\n", 1, "no MatrixMarket file"},
      {"%%MatrixMarket vector coordinate real general\n", 1,
       "object 'vector' is not supported; expected one of: matrix"},
      {"%%MatrixMarket matrix sparse real general\n", 1, "format 'sparse'"},
      {"%%MatrixMarket matrix coordinate complex general\n", 1,
       "'complex' is not supported; expected one of: real"},
      {"%%MatrixMarket matrix coordinate real hermitian\n", 1, "'hermitian' is not supported"},
      {"%%MatrixMarket matrix coordinate real\n", 1, "symmetry is missing"},
      {"%%MatrixMarket matrix coordinate real general 3\n", 1, "expected five words"},
      {"%%MatrixMarket matrix array pattern general\n", 1, "no array form"},
      {"%%MatrixMarket matrix coordinate pattern skew-symmetric\n", 1, "cannot be skew-symmetric"},
      {real, 2, "ends before the size"},
      {real + "% only a comment", 3, "ends before the size"},
      {real + "2 2\n", 2, "number of entries should be a whole number, found nothing"},
      {real + "2 x 1\n", 2, "number of columns should be a whole number, found 'x'"},
      {real + "2.0 2 1\n", 2, "number of rows should be a whole number, found '2.0'"},
      {real + "2 2 1 1\n", 2, "found '2 2 1 1', expected the size"},
      {real + "0 2 0\n", 2, "size is 0 x 2"},
      {real + "-1 2 0\n", 2, "size is -1 x 2"},
      {real + "2147483648 2 0\n", 2, "expected 1 to 2147483647"},
      {real + "99999999999999999999 2 0\n", 2, "whole number"},
      {real + "2 2 -1\n", 2, "cannot be negative"},
      {real + "2 2 2\n1 1 1\n", 4, "ends after 1 of 2 entries"},
      {real + "2 2 2147483647\n1 1 1\n", 4, "ends after 1 of 2147483647"},
      {real + "2 2 2147483648\n1 1 1\n", 2, "expected at most 2147483647"},
      {real + "2 2 1\n1 1 1\n\n2 2 2\n", 5, "more entries than the 1 announced"},
      {real + "2 2 1\n0 1 1\n", 3, "row 0 is outside 1 ... 2"},
      {real + "2 2 1\n3 1 1\n", 3, "row 3 is outside"},
      {real + "2 2 1\n1 0 1\n", 3, "column 0 is outside 1 ... 2"},
      {real + "2 2 1\n1 3 1\n", 3, "column 3 is outside"},
      {real + "2 2 1\n1 1\n", 3, "found nothing"},
      {real + "2 2 1\n1 1 1 0\n", 3, "found '1 1 1 0', expected ROW COLUMN VALUE"},
      {real + "2 2 1\n1 1 one\n", 3, "should be a number, found 'one'"},
      {real + "2 2 1\n1 1 1.0x\n", 3, "should be a number, found '1.0x'"},
      {real + "2 2 1\n1 1 +\n", 3, "found '+'"},
      {real + "2 2 1\n1 1 +-1\n", 3, "found '+-1'"},
      {real + "2 2 1\n1 1 1,5\n", 3, "found '1,5'"},
      {real + "2 2 1\n1.5 1 1\n", 3, "row should be a whole number, found '1.5'"},
      {real + "% c\n\n2 2 1\n% c\n1 1 nan\n", 6, "finite number, found 'nan'"},
      {real + "2 2 1\n1 1 -Inf\n", 3, "finite number, found '-Inf'"},
      {real + "2 2 1\n1 1 1e999\n", 3, "finite number, found '1e999'"},
      {"%%MatrixMarket matrix coordinate integer general\n2 2 1\n1 1 1.5\n", 3, "says integer, found '1.5'"},
      {"%%MatrixMarket matrix coordinate pattern general\n2 2 1\n1 1 1\n", 3, "expected ROW COLUMN"},
      {"%%MatrixMarket matrix coordinate real symmetric\n2 3 1\n1 1 1\n", 2, "should be square"},
      {"%%MatrixMarket matrix coordinate real symmetric\n2 2 2\n1 2 1\n2 1 1\n", 5,
       "(1, 2) is given on both sides of the diagonal"},
      {"%%MatrixMarket matrix coordinate real skew-symmetric\n2 2 1\n1 1 1\n", 3, "lies on the diagonal"},
      {array + "2\n", 2, "number of columns"},
      {array + "2 1 2\n1\n2\n", 2, "expected the size, ROWS COLUMNS"},
      {array + "2 2\n1\n2\n3\n", 6, "ends after 3 values, before entry (2, 2)"},
      {array + "2 1\n1\n2\n3\n", 5, "more values than the 2"},
      {array + "2 1\n1\nx\n", 4, "found 'x'"},
      {"%%MatrixMarket matrix array real symmetric\n2 2\n1\n2\n3\n4\n", 6, "more values than the 3"},
  };
  for (const Case& c : cases) {
    const std::string message = complaint([&] { read_matrix_file(file(c.text)); });
    EXPECT_NE(message.find(c.message), std::string::npos) << c.text << "\n-> " << message;
    EXPECT_TRUE(message.starts_with(path("m.mtx") + ":" + std::to_string(c.line) + ": "))
        << c.text << "\n-> " << message;
  }
  const std::string huge = real + "1 1 2\n1 1 1e308\n1 1 1e308\n";
  EXPECT_NE(complaint([&] { read_matrix_file(file(huge)); }).find("sum to more"), std::string::npos);
  EXPECT_NE(complaint([&] { read_matrix_file(path("none.mtx")); }).find("no such file"), std::string::npos);
  EXPECT_NE(complaint([&] { read_matrix_file(folder_.string()); }).find("is a folder"), std::string::npos);
}

TEST(InQuotes, LongWordsEndBetweenCharactersAndOnOneLine) {
  EXPECT_EQ(in_quotes("short"), "'short'");
  EXPECT_EQ(in_quotes("two\nlines\x1b"), "'two\\nlines\\x1b'");
  EXPECT_EQ(in_quotes("abcd\xc3\xa9 and more", 5), "'abcd...'");
  EXPECT_EQ(in_quotes("abcd\xc3\xa9 and more", 6), "'abcd\xc3\xa9...'");
  EXPECT_EQ(in_quotes("\x80\x80\x80", 2), "'...'");
}

TEST_F(MatrixFileTest, ALargeMatrixMarketFile) {
  // The second difference, lower triangle, rows backwards.
  const int n = 20'000;
  std::string text = "%%MatrixMarket matrix coordinate real symmetric\n";
  text += std::to_string(n) + " " + std::to_string(n) + " " + std::to_string(2 * n - 1) + "\n";
  for (int i = n; i >= 1; --i) {
    text += std::to_string(i) + " " + std::to_string(i) + " 2\n";
    if (i > 1) text += std::to_string(i) + " " + std::to_string(i - 1) + " -1\n";
  }
  const SparseEntries matrix = read_matrix_file(file(text));
  ASSERT_EQ(matrix.values.size(), std::size_t(3 * n - 2));
  for (int i = 1; i < n - 1; ++i) {
    const auto k = std::size_t(matrix.row_starts[std::size_t(i)]);
    ASSERT_EQ(matrix.row_starts[std::size_t(i) + 1], std::int64_t(k) + 3);
    for (std::size_t l = 0; l < 3; ++l) {
      ASSERT_EQ(matrix.columns[k + l], i - 1 + int(l));
      ASSERT_EQ(matrix.values[k + l], l == 1 ? 2 : -1);
    }
  }
}

TEST_F(MatrixFileTest, MatrixMarketVectors) {
  const std::string array = "%%MatrixMarket matrix array real general\n";
  EXPECT_EQ(read_vector_file(file(array + "3 1\n1\n0\n3\n")), (Values{1, 0, 3}));
  EXPECT_EQ(read_vector_file(file(array + "1 3\n1\n0\n3\n")), (Values{1, 0, 3}));
  EXPECT_EQ(read_vector_file(file("%%MatrixMarket matrix coordinate real general\n4 1 1\n3 1 5\n")),
            (Values{0, 0, 5, 0}));
  EXPECT_EQ(read_vector_file(file(array + "1 1\n7\n")), (Values{7}));
  const std::string message = complaint([&] { read_vector_file(file(array + "2 2\n1\n2\n3\n4\n")); });
  EXPECT_NE(message.find("holds a 2 x 2 matrix"), std::string::npos) << message;
}

}  // namespace
}  // namespace sweepvi
