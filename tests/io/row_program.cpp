// Writes or reads rows, as a program that can be killed.
//
//     row_program write FOLDER SEED   writes file after file, marking now and then, until it is killed.
//     Prints its
//                                     ranks' process ids, then the rows of each mark; the mark is in
//                                     mark.json.
//     row_program read FOLDER         reads what mark.json says; prints the rows if they are those written.
//     row_program drive FILE          obeys lines "rows N", "mark", "finish", and answers each with the rows
//     so far.
#include <fmt/format.h>
#include <unistd.h>

#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>
#include <random>

#include "io/row_source.hpp"
#include "io/table_fixture.hpp"
#include "sweepvi/petsc.hpp"

namespace sweepvi {
namespace {

constexpr hsize_t width = 2000;

void fill(TableFile& file, hsize_t rows) {
  for (const hsize_t last = file.rows() + rows; file.rows() < last;) {
    if (file.rows() % 3 == 0) file.add_event({.t = 0.5 * double(file.rows()), .constraint = rank()});
    fill_row(file, file.fields(), file.rows());
  }
}

void save(const TableMark& mark, const fs::path& folder, const std::string& final_name) {
  nlohmann::json json{
      {"file", mark.file}, {"final", final_name}, {"rows", mark.rows}, {"events", mark.events}};
  for (const TableMark::Field& field : mark.fields)
    json["fields"].push_back({{"name", field.name},
                              {"entry_bytes", field.entry_bytes},
                              {"extents", field.extents},
                              {"chunk", field.chunk},
                              {"addresses", field.addresses},
                              {"checksum", field.checksum}});
  std::ofstream(folder / "mark.new") << json;
  fs::rename(folder / "mark.new", folder / "mark.json");
}

TableMark load(const fs::path& folder, std::string& final_name) {
  const auto json = nlohmann::json::parse(std::ifstream(folder / "mark.json"));
  TableMark mark{.file = json["file"], .rows = json["rows"], .events = json["events"]};
  final_name = json["final"];
  for (const auto& field : json["fields"])
    mark.fields.push_back({field["name"], field["entry_bytes"], field["extents"], field["chunk"],
                           field["addresses"], field["checksum"]});
  return mark;
}

[[noreturn]] void write_for_ever(const fs::path& folder, unsigned seed) {
  for (int r = 0; r < ranks(); ++r) {
    if (r == rank()) std::cout << fmt::format("pid {}\n", getpid()) << std::flush;
    MPI_Barrier(world());
  }
  std::mt19937 random(seed);  // the same on every rank
  for (int k = 0;; ++k) {
    const std::string name = fmt::format("run{}.h5", k);
    TableFile file(
        world(), (folder / name).string(), some_fields(width),
        {.expected_rows = 300, .events = true, .buffer_bytes = std::size_t{1} << (10 + random() % 10)});
    for (unsigned marks = 1 + random() % 6; marks > 0; --marks) {
      fill(file, random() % 50);
      const TableMark mark = file.mark();
      if (rank() == 0) {
        save(mark, folder, name);
        std::cout << mark.rows << std::endl;
        fs::remove(folder / fmt::format("run{}.h5", k - 1));
      }
    }
    fill(file, random() % 50);
    file.finish();
  }
}

void read(const fs::path& folder) {
  TableMark mark;
  std::string final_name;
  if (rank() == 0) mark = load(folder, final_name);
  RowSource source(world(), folder, mark, {final_name});
  TableFile file(world(), (folder / "copy.h5").string(), some_fields(width),
                 {.overwrite = true, .events = true});
  source.copy_into(file);
  file.finish();
  if (rank() != 0) return;
  const Hdf5File copy = open_file((folder / "copy.h5").string());
  expect_rows(copy.get(), width, mark.rows, mark.rows);
  EXPECT_EQ(shape_of(copy.get(), "/events"), (std::vector<hsize_t>{mark.events}));
  if (!testing::Test::HasFailure()) std::cout << mark.rows << std::endl;
}

void drive(const std::string& path) {
  TableFile file(world(), path, some_fields(width),
                 {.overwrite = true, .events = true, .buffer_bytes = 100'000});
  for (bool finished = false; !finished;) {
    int rows = 0;
    std::string line;
    if (rank() == 0) std::cout << file.rows() << std::endl, std::getline(std::cin, line);
    if (rank() == 0) rows = line == "finish" ? -1 : line == "mark" ? 0 : std::stoi(line.substr(5));
    MPI_Bcast(&rows, 1, MPI_INT, 0, world());
    finished = rows < 0;
    if (finished)
      file.finish();
    else if (rows == 0)
      file.mark();
    else
      fill(file, hsize_t(rows));
  }
}

}  // namespace
}  // namespace sweepvi

int main(int argc, char** argv) {
  sweepvi::Session session(argc, argv);
  const std::string verb = argc > 2 ? argv[1] : "";
  try {
    if (verb == "write" && argc > 3) sweepvi::write_for_ever(argv[2], unsigned(std::stoul(argv[3])));
    if (verb == "read") sweepvi::read(argv[2]);
    if (verb == "drive") sweepvi::drive(argv[2]);
    if (argc < 3) throw sweepvi::InputError("see the head of the source for what to say");
  } catch (const sweepvi::Error& error) {
    if (sweepvi::rank() == 0) std::cerr << error.what() << std::endl;
    return int(error.code());
  }
  return testing::Test::HasFailure() ? 1 : 0;
}
