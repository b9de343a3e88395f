// A trajectory in a file of ours.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "io/compressed.hpp"
#include "io/hdf5_guard.hpp"
#include "io/hdf5_input.hpp"
#include "io/recorded.hpp"
#include "io/run_trajectory.hpp"
#include "parallel/memory.hpp"
#include "sweepvi/error.hpp"

namespace sweepvi {

namespace {

/// A dataset of `axes` axes, and its shape.
struct Dataset {
  Hdf5Object object;
  std::string where;
  std::vector<hsize_t> shape;

  Dataset(hid_t file, const std::string& path, const std::string& name, std::size_t axes)
      : object(H5Oopen(file, name.c_str(), H5P_DEFAULT)), where(place_in(path, name)) {
    if (!object || H5Iget_type(object.get()) != H5I_DATASET)
      throw InputError(where + " is missing; a file that 'sweepvi run' wrote is needed");
    shape = shape_of(Hdf5Space(H5Dget_space(object.get())).get());
    if (shape.size() != axes || (axes > 1 && *std::min_element(shape.begin() + 1, shape.end()) == 0))
      throw InputError(where + " has " + shape_text(shape) + "; a file that 'sweepvi run' wrote has " +
                       std::to_string(axes) + (axes == 1 ? " axis" : " axes") + " there");
    check_extent(object.get(), shape, where);
  }

  std::size_t rows() const { return static_cast<std::size_t>(shape[0]); }

  template <class T>
  std::vector<T> read(hid_t type) const {
    require_memory(double(sizeof(T)) * double(shape[0]), where + ": " + shape_text(shape) + " takes");
    std::vector<T> values(rows());
    if (H5Dread(object.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values.data()) < 0)
      throw InputError(where + " cannot be read: " + hdf5_reason());
    return values;
  }
};

bool has(hid_t file, const char* name) {
  return H5Lexists(file, name, H5P_DEFAULT) > 0;
}

/// Refuses what is not a finished or stopped run.
void check_head(hid_t file, const std::string& path) {
  std::int64_t version = 0;
  const Hdf5Attribute format = single_attribute(file, "format_version");
  if (!format || H5Aread(format.get(), H5T_NATIVE_INT64, &version) < 0)
    throw InputError(path + " was not written by sweepvi: it has no number as attribute format_version");
  if (version != 1)
    throw InputError(path + " has format_version " + std::to_string(version) +
                     ", this program knows 1; use the version that wrote it");
  if (text_attribute(file, "status") == "running")
    throw InputError(path + " is of a run that was not done when this was written; go on with its --restart");
  if (!has(file, "x"))
    throw InputError(path + " holds no trajectory (/x); a file that 'sweepvi run' wrote is needed");
}

std::vector<double> times_of(const Dataset& dataset) {
  check_numbers(dataset.object.get(), dataset.where, false);
  std::vector<double> t = dataset.read<double>(H5T_NATIVE_DOUBLE);
  if (t.empty()) throw InputError(dataset.where + " has no rows; a trajectory has one at least");
  check_finite(t.data(), t.size(), dataset.where, 0, 0);
  const auto drop = std::is_sorted_until(t.begin(), t.end());
  if (drop != t.end())
    throw InputError(dataset.where + " should not decrease, found " + std::to_string(*drop) + " s after " +
                     std::to_string(*(drop - 1)) + " s at [" + std::to_string(drop - t.begin()) + "]");
  return t;
}

std::vector<Event> events_of(const Dataset& dataset) {
  const Hdf5Type type(H5Tcreate(H5T_COMPOUND, sizeof(Event)));
  const Hdf5Type stored(H5Dget_type(dataset.object.get()));
  const int kind =
      H5Tget_class(stored.get()) == H5T_COMPOUND ? H5Tget_member_index(stored.get(), "kind") : -1;
  const Hdf5Type kinds(kind < 0 ? H5I_INVALID_HID : H5Tget_member_type(stored.get(), unsigned(kind)));
  const bool good = kinds && H5Tget_size(kinds.get()) == sizeof(std::int32_t) &&
                    H5Tinsert(type.get(), "t", HOFFSET(Event, t), H5T_NATIVE_DOUBLE) >= 0 &&
                    H5Tinsert(type.get(), "constraint", HOFFSET(Event, constraint), H5T_NATIVE_INT64) >= 0 &&
                    H5Tinsert(type.get(), "level", HOFFSET(Event, level), H5T_NATIVE_INT32) >= 0 &&
                    H5Tinsert(type.get(), "kind", HOFFSET(Event, kind), kinds.get()) >= 0 &&
                    H5Tinsert(type.get(), "impulse", HOFFSET(Event, impulse), H5T_NATIVE_DOUBLE) >= 0;
  if (!good) throw InputError(dataset.where + " should have entries of t, constraint, level, kind, impulse");
  std::vector<Event> events = dataset.read<Event>(type.get());
  for (std::size_t i = 0; i < events.size(); ++i)
    check_finite(&events[i].t, 1, dataset.where + ", t", i, 0);
  return events;
}

/// Refuses what has more or fewer rows than /t.
void check_rows(const Dataset& dataset, std::size_t times) {
  if (dataset.rows() != times)
    throw InputError(dataset.where + " has " + shape_text(dataset.shape) + ", and /t " +
                     std::to_string(times) + " rows; they should be equally many");
}

/// This rank's part of the rows, summed.
MeasureSums sums_of(const Dataset& dataset, int rank, int ranks) {
  check_numbers(dataset.object.get(), dataset.where, false);
  // Before anything is multiplied in 64 bits, which a dataset made of others may claim to exceed.
  require_memory(8.0 * double(dataset.shape[1]) * double(dataset.shape[2]), dataset.where + ": a row takes");
  const hsize_t width = dataset.shape[1] * dataset.shape[2];
  MeasureSums result{static_cast<std::size_t>(dataset.shape[2]), std::vector<double>(width, 0.0)};
  const hsize_t rows = dataset.shape[0], n = hsize_t(ranks), r = hsize_t(rank);
  const hsize_t begin = rows / n * r + std::min(r, rows % n);
  const hsize_t end = begin + rows / n + (r < rows % n ? 1 : 0);
  const hsize_t block = std::max<hsize_t>((hsize_t{1} << 19) / width, 1);
  const Hdf5Space file(H5Dget_space(dataset.object.get()));
  std::vector<double> values(std::min(block, rows) * width);
  for (hsize_t first = begin; first < end; first += block) {
    const hsize_t from[] = {first, 0, 0};
    const hsize_t count[] = {std::min(block, end - first), dataset.shape[1], dataset.shape[2]};
    const Hdf5Space buffer(H5Screate_simple(3, count, nullptr));
    if (H5Sselect_hyperslab(file.get(), H5S_SELECT_SET, from, nullptr, count, nullptr) < 0 ||
        H5Dread(dataset.object.get(), H5T_NATIVE_DOUBLE, buffer.get(), file.get(), H5P_DEFAULT,
                values.data()) < 0)
      throw InputError(dataset.where + " cannot be read: " + hdf5_reason());
    check_finite(values.data(), count[0] * width, dataset.where + " (constraints and levels as columns)",
                 first * width, width);
    for (hsize_t i = 0; i < count[0] * width; ++i)
      result.sums[i % width] += values[i];
  }
  return result;
}

}  // namespace

Recorded read_run(const std::string& path, const std::vector<std::int64_t>& columns, int rank, int ranks) {
  const QuietHdf5 quiet;
  const Hdf5Guard guard(path);
  Hdf5File file = open_hdf5(path);
  check_head(file.get(), path);
  std::vector<double> t = times_of({file.get(), path, "/t", 1});
  Dataset x(file.get(), path, "/x", 2);
  check_numbers(x.object.get(), x.where, false);
  check_rows(x, t.size());
  Recorded recorded;
  recorded.run = true;
  recorded.columns = static_cast<std::size_t>(x.shape[1]);
  check_columns(path, columns, recorded.columns);
  require_memory(20.0 * 8.0 * double(columns.empty() ? recorded.columns : columns.size()),
                 x.where + ": twenty of its rows take");  // RunTrajectory keeps so many at least
  std::vector<std::int64_t> wanted = columns;
  if (wanted.empty()) {
    wanted.resize(recorded.columns);
    std::iota(wanted.begin(), wanted.end(), 0);
  }
  if (has(file.get(), "element")) {
    const Dataset elements(file.get(), path, "/element", 1);
    check_numbers(elements.object.get(), elements.where, true);
    recorded.elements = elements.read<std::int64_t>(H5T_NATIVE_INT64);
  }
  if (has(file.get(), "events")) recorded.events = events_of({file.get(), path, "/events", 1});
  if (has(file.get(), "mu")) {
    const Dataset mu(file.get(), path, "/mu", 3);
    check_rows(mu, t.size());
    recorded.measures = sums_of(mu, rank, ranks);
  }
  recorded.trajectory = std::make_unique<RunTrajectory>(path, x.where, std::move(file), std::move(x.object),
                                                        std::move(t), wanted);
  return recorded;
}

}  // namespace sweepvi
