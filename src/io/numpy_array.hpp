#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "io/byte_source.hpp"
#include "io/sparse_entries.hpp"

namespace sweepvi {

/// One array in NumPy's format .npy: its head is read by the constructor, its numbers once, by one of the
/// methods. Throws Error (bad_input); `where` of the messages is the source's name.
class NumpyArray {
public:
  /// @param length  bytes that the source holds; the head must announce just as many
  NumpyArray(ByteSource& source, std::uint64_t length);

  const std::vector<std::uint64_t>& shape() const { return shape_; }
  bool fortran_order() const { return fortran_; }
  std::uint64_t size() const;  ///< numbers in all

  /// All numbers in the order of the file.
  std::vector<double> reals(bool infinity);
  std::vector<std::int64_t> integers();
  /// A matrix of two axes.
  SparseEntries matrix();
  /// One axis, or two of which one has length 1.
  std::vector<double> vector(bool infinity);
  /// A single short text.
  std::string text();

  [[noreturn]] void refuse(const std::string& what) const;
  std::string shape_text() const;  ///< "(3, 4)", as Python has it

private:
  void read_head(const std::string& head);
  template <class To>
  void numbers(To* to, std::size_t count);
  template <class To>
  To number(const unsigned char* bytes) const;
  void expect_numbers(bool whole) const;
  void expect_end();

  ByteSource& source_;
  std::string type_;  ///< NumPy's descr without the order of bytes: f8, i4, u1, b1
  bool big_endian_ = false, fortran_ = false;
  std::uint64_t width_ = 0;  ///< bytes of a number
  std::vector<std::uint64_t> shape_;
};

}  // namespace sweepvi
