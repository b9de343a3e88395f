// NumPy's files: .npy holds one array, .npz is a zip archive of them. libzip knows zip archives; members are
// read from their beginning to their end, and checked there against the archive's checksums.

#include <zip.h>

#include <algorithm>
#include <map>
#include <memory>
#include <set>

#include "io/byte_source.hpp"
#include "io/compressed.hpp"
#include "io/matrix_file.hpp"
#include "io/numpy_array.hpp"
#include "io/printable.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {
namespace {

struct Discard {
  void operator()(zip_t* archive) const { zip_discard(archive); }
  void operator()(zip_file_t* member) const { zip_fclose(member); }
};

class Member final : public ByteSource {
public:
  Member(const std::string& name, zip_file_t* file, std::uint64_t length)
      : ByteSource(name), file_(file), length_(length) {}
  std::size_t read(void* to, std::size_t most) override {
    std::size_t read = 0;
    while (read < most) {
      const zip_int64_t count = zip_fread(file_.get(), static_cast<char*>(to) + read, most - read);
      if (count < 0)
        throw InputError(name() + ": it cannot be unpacked: " + printable(zip_file_strerror(file_.get())));
      if (count == 0) break;
      read += static_cast<std::size_t>(count);
    }
    return read;
  }
  std::uint64_t length() const { return length_; }

private:
  std::unique_ptr<zip_file_t, Discard> file_;
  std::uint64_t length_;
};

/// Arrays by name.
class Archive {
public:
  explicit Archive(const std::string& path) : path_(path) {
    int code = 0;
    archive_.reset(zip_open(path.c_str(), ZIP_RDONLY | ZIP_CHECKCONS, &code));
    if (!archive_) {
      zip_error_t error;
      zip_error_init_with_code(&error, code);
      const std::string reason = zip_error_strerror(&error);
      zip_error_fini(&error);
      refuse("the zip archive cannot be opened: " + reason);
    }
    constexpr zip_int64_t most_members = 100'000;
    const zip_int64_t count = zip_get_num_entries(archive_.get(), 0);
    if (count > most_members) refuse("the zip archive has " + std::to_string(count) + " members, too many");
    for (zip_int64_t i = 0; i < count; ++i) {
      const char* raw = zip_get_name(archive_.get(), zip_uint64_t(i), ZIP_FL_ENC_RAW);
      std::string name = raw != nullptr ? raw : "";
      if (!name.ends_with(".npy")) continue;  // NumPy passes over them, too
      name.resize(name.size() - 4);
      if (!members_.emplace(name, zip_uint64_t(i)).second)
        refuse("the zip archive has two arrays of the name " + in_quotes(name));
    }
    if (members_.empty())
      refuse("the zip archive holds no NumPy array, NAME.npy; numpy.savez writes such files");
  }

  bool has(const std::string& name) const { return members_.contains(name); }
  /// It is what scipy.sparse.save_npz writes.
  bool sparse() const { return has("format") && has("shape") && has("data"); }

  /// `dataset`, or the only array there is.
  std::string chosen(const std::string& dataset) const {
    std::string wanted = dataset.starts_with("/") ? dataset.substr(1) : dataset;
    if (has(wanted)) return wanted;
    if (dataset.empty() && members_.size() == 1) return members_.begin()->first;
    if (dataset.empty())
      refuse("the file holds several arrays, " + content() +
             "; say which, {file = ..., dataset = \"name\"}, or save a sparse matrix with "
             "scipy.sparse.save_npz");
    refuse("no array " + in_quotes(dataset) + " is in the file, which holds " + content());
  }

  /// Calls use(array).
  template <class Use>
  auto with(const std::string& name, Use&& use) const {
    const auto found = members_.find(name);
    if (found == members_.end())
      refuse("the array " + in_quotes(name) + " is missing; the file holds " + content());
    zip_stat_t about;
    zip_stat_init(&about);
    constexpr zip_uint64_t needed = ZIP_STAT_SIZE | ZIP_STAT_COMP_SIZE | ZIP_STAT_COMP_METHOD;
    if (zip_stat_index(archive_.get(), found->second, 0, &about) != 0 || (about.valid & needed) != needed)
      refuse(in_quotes(name) + ": " + zip_strerror(archive_.get()));
    const bool packed = about.comp_method == ZIP_CM_DEFLATE;
    if (!packed && about.comp_method != ZIP_CM_STORE)
      refuse(in_quotes(name) +
             " is packed in a way that NumPy does not use; write it with numpy.savez_compressed");
    constexpr double best_compression = 1032.0;  // of deflate, https://zlib.net/zlib_tech.html
    if (double(about.size) >
        (packed ? best_compression * double(about.comp_size) + 1024.0 : double(about.comp_size)))
      refuse(in_quotes(name) + " claims " + std::to_string(about.size) +
             " bytes, which cannot have been packed into " + std::to_string(about.comp_size));
    zip_file_t* file = zip_fopen_index(archive_.get(), found->second, 0);
    if (file == nullptr) refuse(in_quotes(name) + " cannot be read: " + zip_strerror(archive_.get()));
    Member member(path_ + ": " + printable(name), file, about.size);
    NumpyArray array(member, about.size);
    return use(array);
  }

  [[noreturn]] void refuse(const std::string& what) const { throw InputError(path_ + ": " + what); }

private:
  std::string content() const {
    std::string list;
    std::size_t listed = 0;
    for (const auto& [name, index] : members_) {
      if (++listed > 20) return list + ", ...";
      list += (list.empty() ? "" : ", ") + printable(std::string_view(name).substr(0, 100));
    }
    return list;
  }

  std::string path_;
  std::unique_ptr<zip_t, Discard> archive_;
  std::map<std::string, zip_uint64_t> members_;
};

/// What scipy.sparse.save_npz writes, and scipy.sparse.load_npz reads.
class SparseArchive {
public:
  SparseArchive(const std::string& path, const Archive& archive) : path_(path), archive_(archive) {}

  SparseEntries read() {
    const std::string format = archive_.with("format", [](NumpyArray& array) { return array.text(); });
    const std::vector<std::int64_t> shape = integers("shape");
    if (shape.size() != 2)
      archive_.refuse("shape has " + std::to_string(shape.size()) +
                      " entries; a matrix with two axes is expected here");
    check_size(path_, std::uint64_t(shape[0]), std::uint64_t(shape[1]));
    rows_ = shape[0];
    cols_ = shape[1];
    require_memory(8.0 * double(rows_) + 8.0 * double(cols_), path_ + ": a matrix of " +
                                                                  std::to_string(rows_) + " rows and " +
                                                                  std::to_string(cols_) + " columns takes");
    if (format == "csr" || format == "csc") return compressed(format == "csc");
    if (format == "coo") return coordinates();
    if (format == "bsr") return blocks();
    if (format == "dia") return diagonals();
    archive_.refuse("the format of the sparse matrix is " + in_quotes(format) +
                    "; expected csr, csc, coo, bsr or dia");
  }

private:
  std::vector<std::int64_t> integers(const std::string& name) const {
    return archive_.with(name, [](NumpyArray& array) {
      if (array.shape().size() != 1) array.refuse("shape " + array.shape_text() + "; expected one axis");
      return array.integers();
    });
  }
  std::vector<double> reals(const std::string& name) const {
    return archive_.with(name, [](NumpyArray& array) {
      if (array.shape().size() != 1) array.refuse("shape " + array.shape_text() + "; expected one axis");
      return array.reals(false);
    });
  }
  /// Numbers of several axes, in C order.
  std::vector<double> reals(const std::string& name, std::vector<std::uint64_t>& shape,
                            std::size_t axes) const {
    return archive_.with(name, [&](NumpyArray& array) {
      shape = array.shape();
      if (shape.size() != axes)
        array.refuse("shape " + array.shape_text() + "; expected " + std::to_string(axes) + " axes");
      const bool flat =
          std::count_if(shape.begin(), shape.end(), [](std::uint64_t n) { return n != 1; }) <= 1;
      std::vector<double> values = array.reals(false);
      if (!array.fortran_order() || flat) return values;
      std::vector<double> ordered(values.size());
      // Entry [i][j]...[l] of the result stands at i + n_0 (j + n_1 (...)) of the file.
      for (std::size_t at = 0; at < values.size(); ++at) {
        std::size_t rest = at, place = 0;
        for (const std::uint64_t extent : shape) {
          place = place * extent + rest % extent;
          rest /= extent;
        }
        ordered[place] = values[at];
      }
      return ordered;
    });
  }

  Compressed arrays(std::int64_t rows, std::int64_t cols, bool by_columns) const {
    return {.rows = rows,
            .cols = cols,
            .by_columns = by_columns,
            .starts = integers("indptr"),
            .indices = integers("indices"),
            .starts_name = path_ + ": indptr",
            .indices_name = path_ + ": indices",
            .values_name = path_ + ": data"};
  }

  SparseEntries compressed(bool by_columns) const {
    Compressed matrix = arrays(rows_, cols_, by_columns);
    matrix.values = reals("data");
    return checked(std::move(matrix));
  }

  SparseEntries coordinates() const {
    const std::vector<std::int64_t> row = integers("row"), col = integers("col");
    const std::vector<double> data = reals("data");
    return from_coordinates(row, col, data, rows_, cols_, path_);
  }

  /// Block k of block row I is the dense block data[k], at block column indices[k].
  SparseEntries blocks() const {
    std::vector<std::uint64_t> shape;
    const std::vector<double> data = reals("data", shape, 3);
    const auto height = std::int64_t(shape[1]), width = std::int64_t(shape[2]);
    if (height < 1 || width < 1 || rows_ % height != 0 || cols_ % width != 0)
      archive_.refuse("blocks of " + std::to_string(height) + " x " + std::to_string(width) +
                      " do not divide a matrix of " + std::to_string(rows_) + " x " + std::to_string(cols_));
    Compressed pattern = arrays(rows_ / height, cols_ / width, false);
    pattern.values.assign(shape[0], 0.0);
    const std::vector<std::int64_t> starts = pattern.starts, indices = pattern.indices;
    checked(std::move(pattern));
    Triplets entries;
    for (std::int64_t i = 0; i < rows_ / height; ++i)
      for (auto k = starts[std::size_t(i)]; k < starts[std::size_t(i) + 1]; ++k)
        for (std::int64_t r = 0; r < height; ++r)
          for (std::int64_t c = 0; c < width; ++c)
            if (const double value = data[std::size_t((k * height + r) * width + c)]; value != 0)
              entries.add(i * height + r, indices[std::size_t(k)] * width + c, value);
    return finite(compress(entries, rows_, cols_, 0, path_));
  }

  /// data[k][j] is entry (j - offsets[k], j).
  SparseEntries diagonals() const {
    const std::vector<std::int64_t> offsets = integers("offsets");
    std::vector<std::uint64_t> shape;
    const std::vector<double> data = reals("data", shape, 2);
    if (shape[0] != offsets.size())
      archive_.refuse("data has " + std::to_string(shape[0]) + " diagonals; expected one for each of the " +
                      std::to_string(offsets.size()) + " offsets");
    if (std::set<std::int64_t>(offsets.begin(), offsets.end()).size() != offsets.size())
      archive_.refuse("offsets holds a number twice; each diagonal should be there once");
    Triplets entries;
    for (std::size_t k = 0; k < offsets.size(); ++k) {
      if (offsets[k] <= -rows_ || offsets[k] >= cols_) continue;  // as SciPy does
      const std::int64_t last = std::min({std::int64_t(shape[1]), cols_, rows_ + offsets[k]});
      for (std::int64_t j = std::max<std::int64_t>(0, offsets[k]); j < last; ++j)
        if (const double value = data[k * shape[1] + std::size_t(j)]; value != 0)
          entries.add(j - offsets[k], j, value);
    }
    return compress(entries, rows_, cols_, 0, path_);
  }

  SparseEntries finite(SparseEntries matrix) const {
    check_finite(matrix.values.data(), matrix.values.size(), path_ + ": data, after summing equal places,");
    return matrix;
  }

  const std::string& path_;
  const Archive& archive_;
  std::int64_t rows_ = 0, cols_ = 0;
};

}  // namespace

SparseEntries read_numpy_matrix(FileSource& source) {
  const std::uint64_t length = source.length();
  return NumpyArray(source, length).matrix();
}

std::vector<double> read_numpy_vector(FileSource& source, bool infinity) {
  const std::uint64_t length = source.length();
  return NumpyArray(source, length).vector(infinity);
}

SparseEntries read_numpy_archive_matrix(const std::string& path, const std::string& dataset) {
  const Archive archive(path);
  if (dataset.empty() && archive.sparse()) return SparseArchive(path, archive).read();
  return archive.with(archive.chosen(dataset), [](NumpyArray& array) { return array.matrix(); });
}

std::vector<double> read_numpy_archive_vector(const std::string& path, const std::string& dataset,
                                              bool infinity) {
  const Archive archive(path);
  if (dataset.empty() && archive.sparse()) return as_vector(SparseArchive(path, archive).read(), path);
  return archive.with(archive.chosen(dataset), [&](NumpyArray& array) { return array.vector(infinity); });
}

}  // namespace sweepvi
