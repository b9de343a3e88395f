#pragma once

#include <petscsys.h>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// A part of a step that -log_view shows by its name, under the class "sweepvi".
class LogEvent {
public:
  /// @note Collective.
  explicit LogEvent(const char* name) {
    PetscClassId& id = class_id();
    if (id == 0) check(PetscClassIdRegister("sweepvi", &id));
    check(PetscLogEventRegister(name, id, &event_));
  }

  /// What happens while this lives is counted.
  class Scope {
  public:
    explicit Scope(const LogEvent& event) : event_(event.event_) {
      static_cast<void>(PetscLogEventBegin(event_, nullptr, nullptr, nullptr, nullptr));
    }
    ~Scope() { static_cast<void>(PetscLogEventEnd(event_, nullptr, nullptr, nullptr, nullptr)); }
    Scope(const Scope&) = delete;
    Scope& operator=(const Scope&) = delete;

  private:
    PetscLogEvent event_;
  };

private:
  static PetscClassId& class_id() {
    static PetscClassId id = 0;
    return id;
  }
  PetscLogEvent event_ = 0;
};

}  // namespace sweepvi
