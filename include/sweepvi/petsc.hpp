#pragma once

#include <petscsnes.h>
#include <petscts.h>

#include <exception>
#include <string>
#include <utility>
#include <vector>

#include "sweepvi/error.hpp"

static_assert(sizeof(PetscScalar) == sizeof(double),
              "sweepvi needs a PETSc with real, double-precision scalars");

namespace sweepvi {

/// True while an exception made of a PETSc error unwinds. Such an error may be this rank's alone, and
/// destruction is collective: what it unwinds is left to the end of the process, or ranks would wait for each
/// other.
bool unwinding_after_petsc_error() noexcept;

/// Owns one reference to a PETSc object. Move-only; empty after a move.
/// Destruction is collective: same order on every rank, before PetscFinalize().
template <class T, auto Destroy>
class Handle {
public:
  Handle() = default;
  Handle(Handle&& other) noexcept : object_(std::exchange(other.object_, nullptr)) {}
  Handle& operator=(Handle&& other) noexcept {
    Handle taken(std::move(other));
    std::swap(object_, taken.object_);  // our old object dies here
    return *this;
  }
  Handle(const Handle&) = delete;
  Handle& operator=(const Handle&) = delete;
  ~Handle() { reset(); }

  T get() const noexcept { return object_; }  ///< lend to PETSc
  T* put() noexcept {                         ///< let PETSc fill
    reset();
    return &object_;
  }
  void reset() noexcept {
    if (object_ != nullptr && !unwinding_after_petsc_error()) static_cast<void>(Destroy(&object_));
    object_ = nullptr;
  }
  /// Shares an object that somebody else also owns.
  static Handle share(T object) {
    static_cast<void>(PetscObjectReference(reinterpret_cast<PetscObject>(object)));
    Handle handle;
    handle.object_ = object;
    return handle;
  }
  explicit operator bool() const noexcept { return object_ != nullptr; }

private:
  T object_ = nullptr;
};

using Vector = Handle<Vec, VecDestroy>;
using Matrix = Handle<Mat, MatDestroy>;
using Scatter = Handle<VecScatter, VecScatterDestroy>;
using IndexSet = Handle<IS, ISDestroy>;
using LinearSolver = Handle<KSP, KSPDestroy>;
using NonlinearSolver = Handle<SNES, SNESDestroy>;
using TimeStepper = Handle<TS, TSDestroy>;

/// Turns a PETSc error code into an Error with PETSc's own text.
void check(PetscErrorCode code);

/// The same for calls that read the options database: a value PETSc does not take is the user's mistake.
/// @throws Error (bad_input)
void check_options(PetscErrorCode code);

/// Runs C++ code inside a PETSc callback: an exception is parked, PETSc unwinds with PETSC_ERR_USER, and the
/// caller of the PETSc solver throws it again with `rethrow_parked`.
template <class F>
PetscErrorCode guarded(std::exception_ptr& parked, F&& work) noexcept {
  try {
    std::forward<F>(work)();
    return static_cast<PetscErrorCode>(0);
  } catch (...) {
    parked = std::current_exception();
    return PETSC_ERR_USER;
  }
}

/// Checks `code`, preferring the exception that a callback parked.
void check(PetscErrorCode code, std::exception_ptr& parked);

/// Read access to this rank's entries of a vector, for one scope.
class ReadArray {
public:
  explicit ReadArray(Vec vector) : vector_(vector) {
    check(VecGetArrayRead(vector_, &data_));
    PetscInt size = 0;
    check(VecGetLocalSize(vector_, &size));
    size_ = size;
  }
  ~ReadArray() { static_cast<void>(VecRestoreArrayRead(vector_, &data_)); }
  ReadArray(const ReadArray&) = delete;
  ReadArray& operator=(const ReadArray&) = delete;
  double operator[](PetscInt i) const { return data_[i]; }
  const double* data() const { return data_; }
  PetscInt size() const { return size_; }

private:
  Vec vector_;
  const PetscScalar* data_ = nullptr;
  PetscInt size_ = 0;
};

/// Read-write access to this rank's entries of a vector, for one scope.
class WriteArray {
public:
  explicit WriteArray(Vec vector) : vector_(vector) {
    check(VecGetArray(vector_, &data_));
    PetscInt size = 0;
    check(VecGetLocalSize(vector_, &size));
    size_ = size;
  }
  ~WriteArray() { static_cast<void>(VecRestoreArray(vector_, &data_)); }
  WriteArray(const WriteArray&) = delete;
  WriteArray& operator=(const WriteArray&) = delete;
  double& operator[](PetscInt i) const { return data_[i]; }
  double* data() const { return data_; }
  PetscInt size() const { return size_; }

private:
  Vec vector_;
  PetscScalar* data_ = nullptr;
  PetscInt size_ = 0;
};

/// Initialises MPI and PETSc, finalises both. The first object in `main`: every handle dies before it.
/// @note Collective on MPI_COMM_WORLD.
class Session {
public:
  /// @param words  PETSc's part of the command line, without the program's name
  Session(const std::string& program, const std::vector<std::string>& words);
  Session(int argc, char** argv);
  ~Session();
  Session(const Session&) = delete;
  Session& operator=(const Session&) = delete;
  MPI_Comm comm() const { return PETSC_COMM_WORLD; }
};

}  // namespace sweepvi
