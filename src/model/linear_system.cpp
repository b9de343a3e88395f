#include "sweepvi/linear_system.hpp"

#include <cmath>
#include <numeric>

#include "petsc/sparse.hpp"

namespace sweepvi {

Forcing Forcing::from(const std::vector<Signal>& all, PetscInt first, PetscInt last) {
  Forcing forcing;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Signal& signal = all[i];
    if (signal.is_zero()) continue;
    forcing.any = true;
    forcing.varies = forcing.varies || signal.varies();
    const auto row = static_cast<PetscInt>(i);
    if (row < first || row >= last) continue;
    (signal.varies() ? forcing.varying : forcing.constant).push_back({row - first, signal});
  }
  return forcing;
}

void Forcing::add_to(Vec y, double t, int order, double factor) const {
  if (constant.empty() && varying.empty()) return;
  const WriteArray values(y);
  if (order == 0)
    for (const Entry& entry : constant)
      values[entry.local] += factor * entry.signal.value(t);
  for (const Entry& entry : varying)
    values[entry.local] += factor * entry.signal.value(t, order);
}

MPI_Comm LinearSystem::comm() const {
  return PetscObjectComm(reinterpret_cast<PetscObject>(A.get()));
}

PetscInt LinearSystem::states() const {
  PetscInt n = 0;
  check(MatGetSize(A.get(), &n, nullptr));
  return n;
}

PetscInt LinearSystem::constraints() const {
  PetscInt m = 0;
  check(MatGetSize(C.get(), &m, nullptr));
  return m;
}

namespace {

LocalRange share(MPI_Comm comm, PetscInt total) {
  PetscInt local = PETSC_DECIDE;
  check(PetscSplitOwnership(comm, &local, &total));
  PetscInt last = 0;
  MPI_Scan(&local, &last, 1, MPIU_INT, MPI_SUM, comm);
  return {last - local, last};
}

}  // namespace

LinearSystem LinearSystem::dense(MPI_Comm comm, PetscInt n, PetscInt m, const std::vector<double>& a,
                                 const std::vector<double>& b, const std::vector<double>& c,
                                 const std::vector<double>& x0, const std::vector<double>& d,
                                 const std::vector<Signal>& f, const std::vector<double>& w0) {
  const auto need = [](const char* name, const std::vector<double>& values, PetscInt expected) {
    if (static_cast<PetscInt>(values.size()) != expected)
      throw InputError(std::string(name) + " has " + std::to_string(values.size()) + " entries, expected " +
                       std::to_string(expected));
    for (const double value : values)
      if (!std::isfinite(value)) throw InputError(std::string(name) + " holds a number that is not finite");
  };
  agreed(comm, [&] {
    if (n < 1 || m < 1) throw InputError("a system needs at least one state and one constraint");
    need("A", a, n * n);
    need("B", b, n * m);
    need("C", c, m * n);
    need("x0", x0, n);
    if (!d.empty()) need("D", d, m * m);
    if (!w0.empty()) need("w0", w0, m);
    if (!f.empty() && static_cast<PetscInt>(f.size()) != n)
      throw InputError("f has " + std::to_string(f.size()) + " entries, expected " + std::to_string(n));
  });

  const LocalRange states = share(comm, n);
  const LocalRange constraints = share(comm, m);
  const auto rows = [&](const std::vector<double>& values, LocalRange range, PetscInt columns,
                        PetscInt local_columns) {
    RowBuilder builder;
    for (PetscInt i = range.first; i < range.last; ++i) {
      for (PetscInt j = 0; j < columns; ++j) {
        const double value = values[static_cast<std::size_t>(i) * static_cast<std::size_t>(columns) +
                                    static_cast<std::size_t>(j)];
        if (value != 0.0) builder.add(j, value);
      }
      builder.end_row();
    }
    return builder.finish(comm, local_columns);
  };
  LinearSystem system;
  system.A = rows(a, states, n, states.size());
  system.B = rows(b, states, m, constraints.size());
  system.C = rows(c, constraints, n, states.size());
  bool any_d = false;
  for (const double value : d)
    any_d = any_d || value != 0.0;
  if (any_d) system.D = rows(d, constraints, m, constraints.size());
  system.x0 = make_vector(comm, states.size());
  system.w0 = make_vector(comm, constraints.size());
  {
    const WriteArray x(system.x0.get());
    const WriteArray w(system.w0.get());
    for (PetscInt i = 0; i < states.size(); ++i)
      x[i] = x0[static_cast<std::size_t>(states.first) + static_cast<std::size_t>(i)];
    if (!w0.empty())
      for (PetscInt i = 0; i < constraints.size(); ++i)
        w[i] = w0[static_cast<std::size_t>(constraints.first) + static_cast<std::size_t>(i)];
  }
  if (!f.empty()) system.f = Forcing::from(f, states.first, states.last);
  system.state_order.resize(static_cast<std::size_t>(states.size()));
  std::iota(system.state_order.begin(), system.state_order.end(), states.first);
  system.block = system.state_order;
  system.block_count = n;
  system.constraint_order.resize(static_cast<std::size_t>(constraints.size()));
  std::iota(system.constraint_order.begin(), system.constraint_order.end(), constraints.first);
  return system;
}

}  // namespace sweepvi
