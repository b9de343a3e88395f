#include <vector>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

void check(PetscErrorCode code) {
  if (code == 0) return;
  const char* text = nullptr;
  char* specific = nullptr;
  static_cast<void>(PetscErrorMessage(code, &text, &specific));
  std::string message = "PETSc failed: ";
  message += text != nullptr ? text : "unknown error";
  if (specific != nullptr && *specific != '\0') message += std::string(": ") + specific;
  throw Error(ExitCode::internal, message);
}

void check(PetscErrorCode code, std::exception_ptr& parked) {
  if (parked) std::rethrow_exception(std::exchange(parked, nullptr));
  check(code);
}

namespace {

void initialise(int argc, char** argv) {
  // PETSc must neither abort on errors (they become exceptions) nor catch signals (the program has its own
  // exit codes).
  int count = argc;
  char** words = argv;
  if (PetscInitialize(&count, &words, nullptr, nullptr) != 0)
    throw Error(ExitCode::internal, "PetscInitialize failed");
  check(PetscPushErrorHandler(PetscReturnErrorHandler, nullptr));
  check(PetscLogDefaultBegin());  // event counts: factorizations and linear solves of the summary
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
  static_cast<void>(PetscFinalize());
}

}  // namespace sweepvi
