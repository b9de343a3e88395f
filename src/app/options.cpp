#include "app/options.hpp"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdio>
#include <sstream>

#include "app/verbs.hpp"
#include "io/printable.hpp"
#include "io/toml_table.hpp"
#include "petsc/event_counts.hpp"
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
  check_options_allowed("petsc.options", options);
  char* saved = nullptr;  // rc file, PETSC_OPTIONS, command line
  check(PetscOptionsGetAll(nullptr, &saved));
  if (!from_set) check_options(PetscOptionsInsertString(nullptr, options.c_str()));
  check(PetscOptionsInsertString(nullptr, saved));
  check(PetscFree(saved));
  if (from_set) {
    check_options(PetscOptionsInsertString(nullptr, options.c_str()));
    insert_words(line.petsc_words);
  }
  count_events();
}

namespace {

std::vector<std::string> names_of(const std::string& options) {
  std::vector<std::string> names;
  std::istringstream words(options);
  for (std::string word; words >> word;)
    if (is_name(word)) names.push_back(word);
  return names;
}

std::string all_options() {
  char* text = nullptr;
  check(PetscOptionsGetAll(nullptr, &text));
  std::string all = text;
  check(PetscFree(text));
  return all;
}

std::vector<std::string> unread_options() {
  PetscInt count = 0;
  char** names = nullptr;
  char** values = nullptr;
  check(PetscOptionsLeftGet(nullptr, &count, &names, &values));
  std::vector<std::string> unread;
  unread.reserve(static_cast<std::size_t>(count));
  for (PetscInt i = 0; i < count; ++i)
    unread.push_back(std::string("-") + names[i]);
  check(PetscOptionsLeftRestore(nullptr, &count, &names, &values));
  return unread;
}

}  // namespace

OptionsScope::OptionsScope(OptionsRead& read) : read_(read) {
  const std::string all = all_options();
  check(PetscOptionsCreate(&options_));
  check(PetscOptionsPush(options_));
  check(PetscOptionsInsertString(nullptr, all.c_str()));
}

OptionsScope::~OptionsScope() {
  try {
    const std::vector<std::string> unread = unread_options();
    for (const std::string& name : names_of(all_options()))
      read_[name] |= std::find(unread.begin(), unread.end(), name) == unread.end();
  } catch (const Error&) {  // they are only reported
  }
  static_cast<void>(PetscOptionsPop());
  static_cast<void>(PetscOptionsDestroy(&options_));
}

void OptionsScope::insert(const CommandLine& line, const std::string& options) {
  check_options_allowed("a setting's options", options);
  check_options(PetscOptionsInsertString(nullptr, options.c_str()));
  insert_words(line.petsc_words);
}

void give_back(const OptionsRead& read) {
  const std::vector<std::string> here = names_of(all_options());
  for (const auto& [name, was_read] : read) {
    PetscBool found = PETSC_FALSE;
    const bool known = std::find(here.begin(), here.end(), name) != here.end();
    if (was_read)
      check(PetscOptionsHasName(nullptr, nullptr, name.c_str(), &found));  // which reads it
    else if (!known)
      check(PetscOptionsSetValue(nullptr, name.c_str(), nullptr));
  }
}

std::vector<std::string> report_unused_options(MPI_Comm comm) {
  std::vector<std::string> unused = unread_options();
  std::erase_if(unused, [](const std::string& name) { return name == "-options_left" || name == "-help"; });
  int rank = 0;
  MPI_Comm_rank(comm, &rank);
  if (rank == 0) {
    const std::vector<std::string> candidates(known.begin(), known.end());
    for (const std::string& name : unused)
      std::fprintf(stderr, "sweepvi: option %s was not used by anything%s\n", printable(name).c_str(),
                   suggestion(name, candidates).c_str());
  }
  return unused;
}

}  // namespace sweepvi::app
