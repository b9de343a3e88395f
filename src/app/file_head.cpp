#include "app/file_head.hpp"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <ctime>
#include <filesystem>

#include "app/versions.hpp"
#include "sweepvi/petsc.hpp"
#include "sweepvi_config.hpp"

namespace sweepvi::app {

std::string timestamp(double later) {
  // What is further away than a year may as well be a year away; seconds of that size are safe to add.
  constexpr double year = 366.0 * 86400.0;
  const auto wait = std::chrono::seconds(static_cast<std::int64_t>(std::clamp(later, 0.0, year)));
  const std::time_t now = std::chrono::system_clock::to_time_t(std::chrono::system_clock::now() + wait);
  std::tm utc{};
  gmtime_r(&now, &utc);
  std::array<char, 32> text{};
  const std::size_t length = std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%SZ", &utc);
  return {text.data(), length};
}

void describe(TableFile& file, MPI_Comm comm, const std::string& title, const std::string& scene,
              const Overrides& overrides, const std::string& started) {
  int ranks = 1;
  MPI_Comm_size(comm, &ranks);
  std::array<char, 256> host{};
  gethostname(host.data(), host.size() - 1);
  char* options = nullptr;
  check(PetscOptionsGetAll(nullptr, &options));
  file.attribute("format_version", 1);
  file.attribute("title", title);
  file.attribute("scene", scene);
  std::string changes;  // a line each
  for (const auto& [key, value] : overrides)
    changes.append(key).append("=").append(value).append("\n");
  file.attribute("overrides", changes);
  file.attribute("options", options);
  check(PetscFree(options));
  file.attribute("sweepvi_version", std::string(config::version));
  file.attribute("git_hash", std::string(config::git_hash));
  file.attribute("petsc_version", petsc_version());
  file.attribute("mumps_version", mumps_version());
  file.attribute("hdf5_version", hdf5_version());
  file.attribute("mpi_version", mpi_version());
  file.attribute("ranks", ranks);
  file.attribute("host", host.data());
  file.attribute("started", started);
}

void check_distinct(MPI_Comm comm, const std::vector<NamedPath>& paths) {
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  agreed(comm, [&] {
    if (rank != 0) return;
    const auto same = [](const std::string& a, const std::string& b) {
      std::error_code failure;
      return !a.empty() && !b.empty() &&
             std::filesystem::weakly_canonical(a, failure) == std::filesystem::weakly_canonical(b, failure);
    };
    for (std::size_t i = 0; i < paths.size(); ++i)
      for (std::size_t j = i + 1; j < paths.size(); ++j)
        if (same(paths[i].path, paths[j].path))
          throw InputError(paths[j].role + " and " + paths[i].role + " name the same file, " + paths[j].path +
                           "; one would overwrite the other, give another name");
  });
}

}  // namespace sweepvi::app
