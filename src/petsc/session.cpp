#include <sys/resource.h>
#if defined(__SANITIZE_ADDRESS__)
#include <sanitizer/lsan_interface.h>
#endif

#include <algorithm>
#include <array>
#include <exception>
#include <string>
#include <string_view>
#include <vector>

#include "petsc/ambient_options.hpp"
#include "petsc/event_counts.hpp"
#include "petsc/petsc_text.hpp"
#include "sweepvi/petsc.hpp"

namespace sweepvi {

namespace {
bool petsc_has_failed = false;
}  // namespace

std::string petsc_text(PetscErrorCode code) {
  const char* text = nullptr;
  char* specific = nullptr;
  static_cast<void>(PetscErrorMessage(code, &text, &specific));
  std::string message = text != nullptr ? text : "unknown error";
  if (specific != nullptr && *specific != '\0') message += std::string(": ") + specific;
  return message;
}

bool unwinding_after_petsc_error() noexcept {
  return petsc_has_failed && std::uncaught_exceptions() > 0;
}

void check(PetscErrorCode code) {
  if (code == 0) return;
  petsc_has_failed = true;
  throw Error(ExitCode::internal, "PETSc failed: " + petsc_text(code));
}

void check_options(PetscErrorCode code) {
  if (code != 0)
    throw InputError("PETSc does not take one of the options: " + petsc_text(code) +
                     "; check the words with one dash, PETSC_OPTIONS and [petsc] options");
}

void check(PetscErrorCode code, std::exception_ptr& parked) {
  if (parked) std::rethrow_exception(std::exchange(parked, nullptr));
  check(code);
}

namespace {

// MUMPS's parallel analysis recurses once per node of the elimination tree, and a chain's tree is a path: 3e4
// elements overflow the usual 8 MiB. The main thread's stack grows on demand, so a higher limit costs
// nothing.
void allow_deep_recursion() {
  constexpr rlim_t wanted = rlim_t{2} << 30;
  rlimit limit{};
  if (getrlimit(RLIMIT_STACK, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY || limit.rlim_cur >= wanted)
    return;
  limit.rlim_cur = limit.rlim_max == RLIM_INFINITY ? wanted : std::min(wanted, limit.rlim_max);
  static_cast<void>(setrlimit(RLIMIT_STACK, &limit));
}

/// While in scope, what is allocated counts as no leak: MPI tries parts that it unloads again, and leaves a
/// few bytes of each behind.
struct ForeignAllocations {
#if defined(__SANITIZE_ADDRESS__)
  ForeignAllocations() {
    __lsan_disable();
  }
  ~ForeignAllocations() {
    __lsan_enable();
  }
#else
  ForeignAllocations() {}  // NOLINT(modernize-use-equals-default): or an object of it would be unused
#endif
  ForeignAllocations(const ForeignAllocations&) = delete;
  ForeignAllocations& operator=(const ForeignAllocations&) = delete;
};

/// The value of -sweepvi_petscrc; null if there is none.
const char* options_file(int argc, char** argv) {
  const char* file = nullptr;
  for (int i = 1; i + 1 < argc; ++i)
    if (std::string_view(argv[i]) == "-sweepvi_petscrc") file = argv[i + 1];
  return file;
}

// No file is read because it happens to be there: ~/.petscrc, or .petscrc and petscrc of a working directory
// that came with somebody's archive, could load any library.
void initialise(int argc, char** argv) {
  allow_deep_recursion();
  clean_petsc_environment(false);
  const char* file = options_file(argc, argv);
  // With values, or PETSc would take a word of the program after them for one.
  static std::array<std::string, 4> own = {"-skip_petscrc", "true", "-no_signal_handler", "true"};
  static std::string program = "sweepvi";
  static std::vector<char*> words;  // PETSc keeps them (PetscGetArgs)
  words.assign(1, argc > 0 ? argv[0] : program.data());
  for (std::string& word : own)
    words.push_back(word.data());
  if (argc > 1) words.insert(words.end(), argv + 1, argv + argc);
  int count = static_cast<int>(words.size());
  words.push_back(nullptr);
  char** pointer = words.data();
  // PETSc must neither abort on errors (they become exceptions) nor catch signals (the program has its own
  // exit codes).
  check(PetscPushErrorHandler(PetscReturnErrorHandler, nullptr));
  {
    const ForeignAllocations starting;
    check_options(PetscInitialize(&count, &pointer, file, nullptr));
  }
  for (const char* name : {"-skip_petscrc", "-no_signal_handler", "-sweepvi_petscrc"})
    check(PetscOptionsClearValue(nullptr, name));
  check(PetscPushErrorHandler(PetscReturnErrorHandler, nullptr));
  count_events();  // factorizations and linear solves of the summary
}

}  // namespace

Session::Session(int argc, char** argv) {
  initialise(argc, argv);
}

Session::Session(const std::string& program, const std::vector<std::string>& words) {
  // PETSc keeps argv (PetscGetArgs): give it words that live as long as the process.
  static std::vector<std::string> storage;
  static std::vector<char*> pointers;
  storage.assign(1, program);
  storage.insert(storage.end(), words.begin(), words.end());
  pointers.clear();
  for (std::string& word : storage)
    pointers.push_back(word.data());
  pointers.push_back(nullptr);
  initialise(static_cast<int>(storage.size()), pointers.data());
}

Session::~Session() {
  static_cast<void>(PetscPopErrorHandler());  // or PETSc would count it as left behind
#if defined(__SANITIZE_ADDRESS__)
  // All that was ours is gone by now. Later MPI unloads its parts, and nobody could tell whose the leaks are.
  if (std::uncaught_exceptions() == 0 && !petsc_has_failed) __lsan_do_leak_check();
#endif
  static_cast<void>(PetscFinalize());
}

}  // namespace sweepvi
