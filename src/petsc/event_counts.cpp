#include "petsc/event_counts.hpp"

#include <petscsys.h>

#include <vector>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

namespace {

std::vector<std::int64_t>& begun() {
  static std::vector<std::int64_t> counts;
  return counts;
}

PetscErrorCode count(PetscLogEvent event, int, PetscObject, PetscObject, PetscObject, PetscObject) {
  std::vector<std::int64_t>& counts = begun();
  const auto place = static_cast<std::size_t>(event);
  if (place >= counts.size()) counts.resize(place + 1);
  ++counts[place];
  return static_cast<PetscErrorCode>(0);  // an enumeration in newer PETSc
}

PetscErrorCode pass(PetscLogEvent, int, PetscObject, PetscObject, PetscObject, PetscObject) {
  return static_cast<PetscErrorCode>(0);
}

bool counts_ourselves = false;

}  // namespace

void count_events() {
  PetscBool logged = PETSC_FALSE;
  check(PetscLogIsActive(&logged));
  if (counts_ourselves) logged = PETSC_FALSE;  // it was us
  if (logged == PETSC_FALSE) {
    PetscBool asked = PETSC_FALSE;
    check(PetscOptionsHasName(nullptr, nullptr, "-log_view", &asked));
    if (asked == PETSC_TRUE) check(PetscLogDefaultBegin());
    logged = asked;
  }
  if (logged == PETSC_FALSE && !counts_ourselves)
#if PETSC_VERSION_LT(3, 20, 0)
    check(PetscLogSet(count, pass));
#else
    check(PetscLogLegacyCallbacksBegin(count, pass, nullptr, nullptr));
#endif
  counts_ourselves = logged == PETSC_FALSE;
}

std::int64_t event_count(const char* name) {
  PetscLogEvent event = -1;
  check(PetscLogEventGetId(name, &event));
  if (event < 0) return 0;
  if (counts_ourselves) {
    const auto place = static_cast<std::size_t>(event);
    return place < begun().size() ? begun()[place] : 0;
  }
  PetscEventPerfInfo info;
  check(PetscLogEventGetPerfInfo(PETSC_DETERMINE, event, &info));
  return info.count;
}

}  // namespace sweepvi
