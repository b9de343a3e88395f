#include "io/problem_file.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <vector>

#include "io/hdf5_handle.hpp"
#include "io/output_file.hpp"
#include "io/sparse_entries.hpp"
#include "parallel/gather.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

ProblemPaths::ProblemPaths(const std::string& output) {
  const std::filesystem::path path(output);
  const std::string stem = (path.extension() == ".h5" ? path.parent_path() / path.stem() : path).string();
  toml = stem + ".problem.toml";
  numbers = stem + ".problem.h5";
}

namespace {

[[noreturn]] void fail(const std::string& what) {
  throw Error(ExitCode::output, what);
}

std::vector<double> on_root(MPI_Comm comm, Vec vector) {
  const ReadArray mine(vector);
  return gather(comm, std::vector<double>(mine.data(), mine.data() + mine.size()));
}

/// What PETSC_INFINITY means to the solver, infinite means to everybody.
std::vector<double> bounds_on_root(MPI_Comm comm, Vec bounds) {
  std::vector<double> values = on_root(comm, bounds);
  for (double& value : values) {
    if (value >= PETSC_INFINITY) value = HUGE_VAL;
    if (value <= PETSC_NINFINITY) value = -HUGE_VAL;
  }
  return values;
}

SparseEntries on_root(MPI_Comm comm, Mat matrix) {
  std::vector<std::int64_t> lengths, columns;
  std::vector<double> values;
  for_each_row(matrix, [&](PetscInt, auto row_columns, auto row_values) {
    lengths.push_back(static_cast<std::int64_t>(row_columns.size()));
    columns.insert(columns.end(), row_columns.begin(), row_columns.end());
    values.insert(values.end(), row_values.begin(), row_values.end());
  });
  SparseEntries all;
  lengths = gather(comm, lengths);
  all.rows = all.cols = static_cast<std::int64_t>(lengths.size());
  all.row_starts.assign(1, 0);
  for (const std::int64_t length : lengths)
    all.row_starts.push_back(all.row_starts.back() + length);
  all.columns = gather(comm, columns);
  all.values = gather(comm, values);
  return all;
}

void put(hid_t place, const char* name, hid_t type, const void* data, std::size_t count) {
  const hsize_t size = count;
  const Hdf5Space space(H5Screate_simple(1, &size, nullptr));
  const Hdf5Dataset dataset(
      H5Dcreate2(place, name, type, space.get(), H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  if (!dataset || H5Dwrite(dataset.get(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, data) < 0)
    fail(fmt::format("{}: {}", name, hdf5_reason()));
}
void put(hid_t place, const char* name, const std::vector<double>& values) {
  put(place, name, H5T_NATIVE_DOUBLE, values.data(), values.size());
}
void put(hid_t place, const char* name, const std::vector<std::int64_t>& values) {
  put(place, name, H5T_NATIVE_INT64, values.data(), values.size());
}

/// The bytes of an HDF5 file made in memory: HDF5 itself does not survive a full disk.
std::vector<char> image(const SparseEntries& M,
                        const std::vector<std::pair<const char*, std::vector<double>>>& vectors) {
  constexpr std::size_t increment = std::size_t{1} << 20;
  const QuietHdf5 quiet;
  const Hdf5Properties access(H5Pcreate(H5P_FILE_ACCESS));
  H5Pset_fapl_core(access.get(), increment, false);
  const Hdf5File file(H5Fcreate("problem", H5F_ACC_TRUNC, H5P_DEFAULT, access.get()));
  if (!file) fail(hdf5_reason());
  const Hdf5Object group(H5Gcreate2(file.get(), "M", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT));
  put(group.get(), "indptr", M.row_starts);
  put(group.get(), "indices", M.columns);
  put(group.get(), "data", M.values);
  const std::int64_t shape[2] = {M.rows, M.cols};
  const hsize_t two = 2;
  const Hdf5Space space(H5Screate_simple(1, &two, nullptr));
  const Hdf5Attribute attribute(
      H5Acreate2(group.get(), "shape", H5T_NATIVE_INT64, space.get(), H5P_DEFAULT, H5P_DEFAULT));
  if (!attribute || H5Awrite(attribute.get(), H5T_NATIVE_INT64, shape) < 0) fail(hdf5_reason());
  for (const auto& [name, values] : vectors)
    put(file.get(), name, values);
  if (H5Fflush(file.get(), H5F_SCOPE_GLOBAL) < 0) fail(hdf5_reason());
  const ssize_t size = H5Fget_file_image(file.get(), nullptr, 0);
  std::vector<char> bytes(size > 0 ? static_cast<std::size_t>(size) : 0);
  if (size <= 0 || H5Fget_file_image(file.get(), bytes.data(), bytes.size()) != size) fail(hdf5_reason());
  return bytes;
}

/// In double quotes, for TOML.
std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') result += '\\';
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
      result += fmt::format("\\u{:04x}", static_cast<unsigned>(c));
    else
      result += c;
  }
  return result + "\"";
}

std::string commented(const std::string& text) {
  std::string result = "# ";
  for (const char c : text) {
    const bool printable = static_cast<unsigned char>(c) >= 0x20 && c != 0x7f;
    result += c == '\n' ? "\n# " : std::string(1, printable ? c : ' ');
  }
  return result + "\n";
}

std::string text(const ProblemPaths& paths, bool affine, const std::string& head) {
  std::string content = commented(head);
  content +=
      commented(affine ? "F(u) = M u + q is the step's own."
                       : "The step is nonlinear: M = dF/du and q are its linearisation at u0, the best point "
                         "found. That may have a\nsolution where the step has none.");
  content += commented(
      "terms: sums of the absolute values of what q was summed from; its rounding is theirs.\n"
      "Try: sweepvi solve " +
      paths.toml + ", in the folder where the run was started.");
  content += "[problem]\n";
  const std::string file = quoted(std::filesystem::path(paths.numbers).filename().string());
  for (const char* name : {"M", "q", "terms", "lower", "upper", "u0"})
    content += fmt::format("{} = {{file = {}, dataset = \"/{}\"}}\n", name, file, name);
  return content;
}

}  // namespace

std::string write_problem(MPI_Comm comm, const ProblemPaths& paths, const StepProblem& problem,
                          const std::string& head) {
  constexpr std::int64_t most_entries = 1'000'000'000;  // gathered with 32-bit counts, in 16 GB
  MatInfo info;
  check(MatGetInfo(problem.M.get(), MAT_GLOBAL_SUM, &info));
  if (info.nz_used > static_cast<double>(most_entries))
    return fmt::format("it has {:.3g} entries, too many for one rank", info.nz_used);
  const SparseEntries M = on_root(comm, problem.M.get());
  const std::vector<std::pair<const char*, std::vector<double>>> vectors = {
      {"q", on_root(comm, problem.q.get())},
      {"terms", on_root(comm, problem.terms.get())},
      {"lower", bounds_on_root(comm, problem.lower.get())},
      {"upper", bounds_on_root(comm, problem.upper.get())},
      {"u0", on_root(comm, problem.u0.get())}};
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  if (rank != 0) return {};
  const auto finite = [](double value) { return std::isfinite(value); };
  bool numbers = std::ranges::all_of(M.values, finite);
  for (const auto& [name, values] : vectors)
    numbers = numbers && (std::strchr("lu", name[0]) != nullptr || std::ranges::all_of(values, finite));
  if (!numbers) return "its numbers have left the range that can be represented";
  try {
    const std::vector<char> numbers_file = image(M, vectors);
    write_output(paths.numbers, {numbers_file.data(), numbers_file.size()});
    const std::string content = text(paths, problem.affine, head);
    write_output(paths.toml, content);
  } catch (const std::exception& error) {
    return error.what();
  }
  return {};
}

}  // namespace sweepvi
