// What PETSc's binary viewer writes (src/mat/impls/aij/seq/aij.c, MatView_SeqAIJ_Binary; dense.c; and
// src/vec/vec/utils/vecio.c): big-endian integers of 4 or 8 bytes and scalars, objects one after another.
//
//   matrix        1211216, rows, columns, entries, length of each row, column of each entry, value of each
//   entry dense matrix  1211216, rows, columns, -1, all values row by row vector        1211214, length,
//   values index set     1211218, length, integers
//
// Nothing says how wide integers and scalars are. A class number fits into 4 bytes, and of 8 the first 4 are
// then 0; scalars have the width with which objects fill the file.

#include <algorithm>
#include <array>
#include <bit>
#include <cstring>
#include <optional>
#include <type_traits>

#include "io/byte_source.hpp"
#include "io/compressed.hpp"
#include "io/matrix_file.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {
namespace {

constexpr std::int64_t matrix_class = 1211216, vector_class = 1211214, index_class = 1211218;
constexpr std::int64_t dense_mark = -1;

/// Where an object is, and what its head says. Matrices are entries x 1 where they are vectors.
struct Object {
  std::int64_t kind = 0, rows = 0, cols = 1, entries = 0;
  std::uint64_t content = 0;  ///< offset of what follows its head
};

template <class To>
To swapped(const char* from, std::size_t width) {
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < width; ++i)
    bits = bits << 8U | static_cast<unsigned char>(from[i]);
  if constexpr (std::is_floating_point_v<To>)
    return width == 4 ? To(std::bit_cast<float>(std::uint32_t(bits))) : std::bit_cast<double>(bits);
  else
    return width == 4 ? To(std::int32_t(bits)) : To(bits);
}

class PetscFile {
public:
  explicit PetscFile(FileSource& source) : source_(source), length_(source.length()) {
    std::array<char, 4> first{};
    source_.exactly(first.data(), first.size(), "its first number");
    index_width_ = swapped<std::int64_t>(first.data(), 4) == 0 ? 8 : 4;
    for (const std::uint64_t width : {8, 4, 16})
      if (walk(width)) {
        if (width == 16)
          refuse(
              "its numbers take 16 bytes each: PETSc wrote it with complex scalars or with quadruple "
              "precision; "
              "write it with real scalars in double precision");
        scalar_width_ = width;
        return;
      }
    refuse(
        "it begins like a file of PETSc's binary viewer, but does not hold whole matrices, vectors and index "
        "sets one after another: it is cut off or damaged, or of another kind");
  }

  /// The only object of this kind, or none.
  std::optional<Object> only(std::int64_t kind, const std::string& what) const {
    std::optional<Object> found;
    for (const Object& object : objects_) {
      if (object.kind != kind) continue;
      if (found) refuse("it holds more than one " + what + "; write each into a file of its own");
      found = object;
    }
    return found;
  }

  SparseEntries matrix(const Object& object) {
    check_size(name(), std::uint64_t(object.rows), std::uint64_t(object.cols));
    go_to(object);
    if (object.entries == dense_mark) {
      DenseRows dense(std::uint64_t(object.rows), std::uint64_t(object.cols), false, name());
      std::vector<double> block;
      for (std::uint64_t first = 0; first < std::uint64_t(object.rows); first += dense.block_rows()) {
        const std::uint64_t count = std::min(dense.block_rows(), std::uint64_t(object.rows) - first);
        block.resize(count * std::uint64_t(object.cols));
        numbers(block.data(), block.size(), scalar_width_);
        dense.append(block.data(), count);
      }
      return dense.finish();
    }
    if (object.entries > most_entries)
      refuse("its matrix has " + std::to_string(object.entries) + " entries; expected at most 2147483647");
    require_memory(16.0 * double(object.entries) + 8.0 * double(object.rows), name() + ": its matrix takes");
    Compressed arrays{.rows = object.rows,
                      .cols = object.cols,
                      .starts_name = name() + ": the sum of the lengths of its rows",
                      .indices_name = name() + ": the list of columns",
                      .values_name = name() + ": the list of values"};
    arrays.starts.resize(std::size_t(object.rows) + 1);
    numbers(arrays.starts.data() + 1, std::size_t(object.rows), index_width_);
    for (std::size_t i = 0; i < std::size_t(object.rows); ++i) {
      const std::int64_t length = arrays.starts[i + 1];
      if (length < 0 || length > object.entries)
        refuse("row " + std::to_string(i) + " of its matrix has " + std::to_string(length) +
               " entries of the " + std::to_string(object.entries) + " of all rows");
      arrays.starts[i + 1] += arrays.starts[i];
    }
    arrays.indices.resize(std::size_t(object.entries));
    numbers(arrays.indices.data(), arrays.indices.size(), index_width_);
    arrays.values.resize(std::size_t(object.entries));
    numbers(arrays.values.data(), arrays.values.size(), scalar_width_);
    return checked(std::move(arrays));
  }

  std::vector<double> vector(const Object& object, bool infinity) {
    check_size(name(), std::uint64_t(object.rows), 1);
    require_memory(8.0 * double(object.rows), name() + ": its vector takes");
    std::vector<double> values(std::size_t(object.rows));
    go_to(object);
    numbers(values.data(), values.size(), scalar_width_);
    if (!infinity) check_finite(values.data(), values.size(), name());
    return values;
  }

  [[noreturn]] void refuse(const std::string& what) const { throw InputError(name() + ": " + what); }

private:
  const std::string& name() const { return source_.name(); }

  /// Whether objects with scalars of this width fill the file; objects_ are then what it holds.
  bool walk(std::uint64_t width) {
    objects_.clear();
    source_.rewind();
    std::uint64_t position = 0;
    while (position < length_) {
      const std::optional<Object> object = head(position);
      constexpr std::size_t most_objects = 1000;
      if (!object || objects_.size() == most_objects) return false;
      const std::uint64_t bytes = bytes_of(*object, width);
      if (bytes > length_ - object->content) return false;
      objects_.push_back(*object);
      source_.skip(bytes);
      position = object->content + bytes;
    }
    return true;
  }

  std::optional<Object> head(std::uint64_t position) {
    std::array<std::int64_t, 4> words{};
    const auto next = [&](std::size_t count, std::int64_t* to) {
      if (length_ - position < count * index_width_) return false;
      numbers(to, count, index_width_);
      position += count * index_width_;
      return true;
    };
    if (!next(2, words.data()) || words[1] < 0) return std::nullopt;
    Object object{.kind = words[0], .rows = words[1], .entries = words[1]};
    if (object.kind == matrix_class) {
      if (!next(2, words.data() + 2) || words[2] < 0 || words[3] < dense_mark) return std::nullopt;
      object.cols = words[2];
      object.entries = words[3];
    } else if (object.kind != vector_class && object.kind != index_class) {
      return std::nullopt;
    }
    object.content = position;
    return object;
  }

  /// Of what follows its head; all the bytes there are and more if that is no number.
  std::uint64_t bytes_of(const Object& object, std::uint64_t width) const {
    const auto sum = [&](double bytes) {
      return bytes > double(length_) ? length_ + 1 : static_cast<std::uint64_t>(bytes);
    };
    const auto rows = double(object.rows), entries = double(object.entries);
    const auto index = double(index_width_), scalar = double(width);
    if (object.kind == index_class) return sum(rows * index);
    if (object.kind == vector_class) return sum(rows * scalar);
    if (object.entries == dense_mark) return sum(rows * double(object.cols) * scalar);
    return sum((rows + entries) * index + entries * scalar);
  }

  void go_to(const Object& object) {
    source_.rewind();
    source_.skip(object.content);
  }

  template <class To>
  void numbers(To* to, std::size_t count, std::uint64_t width) {
    std::array<char, 1U << 16U> bytes;
    while (count > 0) {
      const std::size_t block = std::min(count, bytes.size() / width);
      source_.exactly(bytes.data(), block * width, "its numbers");
      for (std::size_t i = 0; i < block; ++i)
        *to++ = swapped<To>(bytes.data() + i * width, width);
      count -= block;
    }
  }

  FileSource& source_;
  std::uint64_t length_ = 0, index_width_ = 4, scalar_width_ = 8;
  std::vector<Object> objects_;
};

}  // namespace

SparseEntries read_petsc_matrix(FileSource& source) {
  PetscFile file(source);
  const std::optional<Object> matrix = file.only(matrix_class, "matrix");
  if (!matrix) file.refuse("a matrix is expected here, and PETSc wrote none into it");
  return file.matrix(*matrix);
}

std::vector<double> read_petsc_vector(FileSource& source, bool infinity) {
  PetscFile file(source);
  if (const std::optional<Object> vector = file.only(vector_class, "vector"))
    return file.vector(*vector, infinity);
  const std::optional<Object> matrix = file.only(matrix_class, "matrix");
  if (!matrix) file.refuse("a vector is expected here, and PETSc wrote none into it");
  return as_vector(file.matrix(*matrix), source.name());
}

}  // namespace sweepvi
