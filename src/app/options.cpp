#include "app/options.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>

#include "io/toml_table.hpp"
#include "sweepvi/petsc.hpp"

namespace sweepvi::app {

namespace {

// What people mostly type: a hint needs a list, and PETSc has none.
constexpr std::array known = {"-snes_type",
                              "-snes_monitor",
                              "-snes_vi_monitor",
                              "-snes_view",
                              "-snes_max_it",
                              "-snes_converged_reason",
                              "-snes_linesearch_type",
                              "-snes_vi_zero_tolerance",
                              "-ksp_type",
                              "-ksp_rtol",
                              "-ksp_monitor",
                              "-ksp_view",
                              "-ksp_max_it",
                              "-pc_type",
                              "-pc_factor_mat_solver_type",
                              "-pc_factor_mat_ordering_type",
                              "-mat_mumps_icntl_7",
                              "-mat_mumps_icntl_14",
                              "-ts_monitor",
                              "-ts_view",
                              "-ts_max_steps",
                              "-log_view",
                              "-malloc_dump",
                              "-options_left",
                              "-sweepvi_certificate_rtol",
                              "-sweepvi_target_rtol",
                              "-sweepvi_predictor",
                              "-sweepvi_form"};

bool is_name(const std::string& word) {
  return word.size() > 1 && word[0] == '-' && std::isdigit(static_cast<unsigned char>(word[1])) == 0 &&
         word[1] != '.';
}

void insert_words(const std::vector<std::string>& words) {
  for (std::size_t i = 0; i < words.size(); ++i) {
    if (!is_name(words[i])) continue;
    const bool has_value = i + 1 < words.size() && !is_name(words[i + 1]);
    check_options(
        PetscOptionsSetValue(nullptr, words[i].c_str(), has_value ? words[i + 1].c_str() : nullptr));
  }
}

}  // namespace

void insert_scene_options(const CommandLine& line, const std::string& options, bool from_set) {
  const std::size_t start = options.find_first_not_of(" \t\n");
  if (start != std::string::npos && options[start] != '-')
    throw InputError("petsc.options = \"" + options +
                     "\" does not start with an option; names begin with a dash, as in " +
                     "\"-snes_monitor\"");
  char* saved = nullptr;  // rc file, PETSC_OPTIONS, command line
  check(PetscOptionsGetAll(nullptr, &saved));
  if (!from_set) check_options(PetscOptionsInsertString(nullptr, options.c_str()));
  check(PetscOptionsInsertString(nullptr, saved));
  check(PetscFree(saved));
  if (from_set) {
    check_options(PetscOptionsInsertString(nullptr, options.c_str()));
    insert_words(line.petsc_words);
  }
}

std::vector<std::string> report_unused_options(MPI_Comm comm) {
  PetscInt count = 0;
  char** names = nullptr;
  char** values = nullptr;
  check(PetscOptionsLeftGet(nullptr, &count, &names, &values));
  std::vector<std::string> unused;
  for (PetscInt i = 0; i < count; ++i) {
    const std::string name = std::string("-") + names[i];
    const bool about_options = name == "-options_left" || name == "-help";
    if (!about_options) unused.push_back(name);
  }
  check(PetscOptionsLeftRestore(nullptr, &count, &names, &values));
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  if (rank == 0) {
    const std::vector<std::string> candidates(known.begin(), known.end());
    for (const std::string& name : unused)
      std::fprintf(stderr, "sweepvi: option %s was not used by anything%s\n", name.c_str(),
                   suggestion(name, candidates).c_str());
  }
  return unused;
}

}  // namespace sweepvi::app
