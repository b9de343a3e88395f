#include "vi/proximal_newton.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "petsc/direct_solver.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {
constexpr double epsilon = std::numeric_limits<double>::epsilon();
// Random polyhedra with 300 faces need 40 from a cold start; a chain that is pushed together one for each
// face that closes in the step.
constexpr int most_newton_steps = 1000;
constexpr int most_problems = 30;
constexpr double smallest_delta = 1e-14;  // below, rounding of w would pass for multipliers of its size
// A face that is violated by no more than this, relative to the terms of its row, need not be active.
constexpr double violation = 32 * epsilon;
constexpr double target = 5e-16;      // worst residual over row terms, below the rounding of a long row
constexpr double stagnation = 1e-12;  // enough where rounding allows no more
}  // namespace

ProximalNewton::ProximalNewton(const Problem& problem)
    : problem_(problem), comm_(PetscObjectComm(reinterpret_cast<PetscObject>(problem.S))), parts_(problem.S) {
  check(MatDuplicate(problem.S, MAT_COPY_VALUES, jacobian_.put()));
  check(MatSetOption(jacobian_.get(), MAT_KEEP_NONZERO_PATTERN, PETSC_TRUE));
  for (Vector* vector : {&f_, &step_, &terms_, &work_, &from_, &at_from_, &way_, &along_way_})
    *vector = duplicate(problem.rhs);
  const auto faces = static_cast<std::size_t>(row_range(problem.S).size() - problem.components);
  square_.assign(faces, 1.0);
  centre_.assign(faces, 0.0);
  active_.assign(faces, 0);
  check(KSPCreate(comm_, solver_.put()));
  check(KSPSetOperators(solver_.get(), jacobian_.get(), jacobian_.get()));
  configure(solver_.get());  // failing is a result
  renew();
}

void ProximalNewton::renew() {
  has_factor_ = false;
  std::size_t face = 0;
  const PetscInt first_face = row_range(problem_.S).first + problem_.components;
  for_each_row(problem_.S, [&](PetscInt row, auto, auto values) {
    if (row < first_face) return;
    double sum = 0.0;
    for (const double value : values)
      sum += value * value;
    square_[face++] = sum > 0.0 ? sum : 1.0;
  });
}

void ProximalNewton::regularise(Mat matrix) const {
  Vector diagonal = duplicate(problem_.rhs);
  {
    const WriteArray values(diagonal.get());
    for (std::size_t i = 0; i < square_.size(); ++i)
      values[problem_.components + static_cast<PetscInt>(i)] = first_delta * square_[i];
  }
  check(MatDiagonalSet(matrix, diagonal.get(), ADD_VALUES));
}

namespace {

// The components of x without its multipliers.
void keep_components(Vec x, PetscInt components) {
  const WriteArray values(x);
  std::fill(values.data() + components, values.data() + values.size(), 0.0);
}

}  // namespace

void ProximalNewton::row_terms(Vec x, Vec terms) {
  check(VecCopy(x, work_.get()));
  check(VecAbs(work_.get()));
  check(MatMultAdd(problem_.abs_S, work_.get(), problem_.rhs_terms, terms));
  keep_components(work_.get(), problem_.components);
  check(MatMultAdd(problem_.abs_S, work_.get(), problem_.rhs_terms, step_.get()));  // without y
  keep_components(step_.get(), problem_.components);
  check(MatMultAdd(problem_.abs_S, step_.get(), problem_.rhs_terms, work_.get()));
  const ReadArray of_faces(work_.get());
  const WriteArray values(terms);
  std::copy(of_faces.data() + problem_.components, of_faces.data() + of_faces.size(),
            values.data() + problem_.components);
}

bool ProximalNewton::solve(Vec x) {
  std::fill(centre_.begin(), centre_.end(), 0.0);
  double delta = first_delta;
  double previous = std::numeric_limits<double>::infinity();
  for (int problem = 0; problem < most_problems; ++problem) {
    if (!newton(x, delta)) return false;
    const double reached = ratio();
    if (reached <= target) return true;
    const bool slow = reached > 0.1 * previous;
    if (slow && reached <= stagnation) return true;
    if (slow && delta <= smallest_delta && reached > 0.9 * previous) return false;
    if (slow) delta = std::max(0.01 * delta, smallest_delta);
    previous = reached;
    const ReadArray values(x);
    std::copy_n(values.data() + problem_.components, centre_.size(), centre_.begin());
  }
  return false;
}

bool ProximalNewton::solve_regularised(Vec x, double delta) {
  std::fill(centre_.begin(), centre_.end(), 0.0);
  return newton(x, delta);
}

bool ProximalNewton::newton(Vec x, double delta) {
  for (int iteration = 0; iteration < most_newton_steps; ++iteration) {
    check(VecCopy(x, from_.get()));
    if (!solve_active(x, delta)) return false;
    if (!update_active(x, delta)) return true;
    // The first active faces are a guess; only from then on are they those of the point left behind.
    if (iteration > 0) search(x, delta);
  }
  return false;
}

// x becomes the solution if the active faces are right.
bool ProximalNewton::solve_active(Vec x, double delta) {
  const PetscInt components = problem_.components;
  {
    const WriteArray values(x);
    for (std::size_t i = 0; i < active_.size(); ++i)
      if (active_[i] == 0) values[components + static_cast<PetscInt>(i)] = 0.0;
  }
  check(MatMult(problem_.S, x, f_.get()));
  check(VecAXPY(f_.get(), -1.0, problem_.rhs));
  {
    const ReadArray values(x);
    const WriteArray residual(f_.get());
    for (std::size_t i = 0; i < active_.size(); ++i) {
      const PetscInt row = components + static_cast<PetscInt>(i);
      if (active_[i] == 0)
        residual[row] = 0.0;
      else
        residual[row] += delta * square_[i] * (values[row] - centre_[i]);
    }
  }
  int stale = has_factor_ && delta == factored_delta_ && active_ == factored_active_ ? 0 : 1;
  MPI_Allreduce(MPI_IN_PLACE, &stale, 1, MPI_INT, MPI_LOR, comm_);
  if (stale != 0) factor(delta);
  if (!sweepvi::solve(solver_.get(), jacobian_.get(), f_.get(), step_.get())) {
    has_factor_ = false;
    return false;
  }
  check(VecAXPY(x, -1.0, step_.get()));
  const WriteArray values(x);
  for (std::size_t i = 0; i < active_.size(); ++i)
    if (active_[i] == 0) values[components + static_cast<PetscInt>(i)] = 0.0;
  return true;
}

void ProximalNewton::factor(double delta) {
  check(MatCopy(problem_.S, jacobian_.get(), SAME_NONZERO_PATTERN));
  std::vector<PetscInt> inactive;
  check(VecSet(work_.get(), 0.0));
  {
    const PetscInt first_face = row_range(problem_.S).first + problem_.components;
    const WriteArray diagonal(work_.get());
    for (std::size_t i = 0; i < active_.size(); ++i) {
      const auto face = static_cast<PetscInt>(i);
      if (active_[i] != 0)
        diagonal[problem_.components + face] = delta * square_[i];
      else
        inactive.push_back(first_face + face);
    }
  }
  check(MatDiagonalSet(jacobian_.get(), work_.get(), ADD_VALUES));
  check(MatZeroRows(jacobian_.get(), static_cast<PetscInt>(inactive.size()), inactive.data(), 1.0, nullptr,
                    nullptr));
  factored_active_ = active_;
  factored_delta_ = delta;
  has_factor_ = true;
}

// The faces that x itself says are active; false if they were so already. Leaves S x - rhs in f_ and its
// terms in terms_.
bool ProximalNewton::update_active(Vec x, double delta) {
  check(MatMult(problem_.S, x, f_.get()));
  check(VecAXPY(f_.get(), -1.0, problem_.rhs));
  row_terms(x, terms_.get());
  int changed = 0;
  {
    const ReadArray values(x);
    const ReadArray residual(f_.get());
    const ReadArray terms(terms_.get());
    for (std::size_t i = 0; i < active_.size(); ++i) {
      const PetscInt row = problem_.components + static_cast<PetscInt>(i);
      const bool active = active_[i] != 0
                              ? values[row] > 0.0
                              : delta * square_[i] * centre_[i] - residual[row] > violation * terms[row];
      if (active == (active_[i] != 0)) continue;
      active_[i] = active ? 1 : 0;
      changed = 1;
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &changed, 1, MPI_INT, MPI_LOR, comm_);
  return changed != 0;
}

// Shortens the step from from_ to x where going all the way leads uphill again: in each component on its own,
// or the slowest of many copies would hold up all others.
void ProximalNewton::search(Vec x, double delta) {
  keep_components(from_.get(), problem_.components);
  check(VecWAXPY(way_.get(), -1.0, from_.get(), x));
  keep_components(way_.get(), problem_.components);
  check(MatMult(problem_.S, from_.get(), at_from_.get()));
  check(VecAXPY(at_from_.get(), -1.0, problem_.rhs));
  check(MatMult(problem_.S, way_.get(), along_way_.get()));

  const std::size_t count = parts_.count();
  std::vector<double> t(count, 0.0);
  const std::vector<double> start = slopes(t, delta);
  std::fill(t.begin(), t.end(), 1.0);
  const std::vector<double> end = slopes(t, delta);
  const std::vector<double> unknown = rounding_of_slopes(delta);
  std::vector<char> searches(count, 0);
  for (std::size_t part = 0; part < count; ++part)
    searches[part] = end[part] > std::max(0.5 * std::abs(start[part]), unknown[part]) ? 1 : 0;
  const std::vector<char> shortened = searches;
  std::vector<double> low(count, 0.0);
  std::vector<double> high(count, 1.0);
  for (int halving = 0; halving < 40; ++halving) {
    for (std::size_t part = 0; part < count; ++part)
      if (searches[part] != 0) t[part] = 0.5 * (low[part] + high[part]);
    const double open = static_cast<double>(std::count(searches.begin(), searches.end(), 1));
    const std::vector<double> here = slopes(t, delta, open);
    if (here[count] == 0.0) break;
    for (std::size_t part = 0; part < count; ++part) {
      if (searches[part] == 0) continue;
      (here[part] > 0.0 ? high : low)[part] = t[part];
      if (std::abs(here[part]) <= 0.1 * std::abs(start[part])) searches[part] = 0;
    }
  }
  const ReadArray from(from_.get());
  const ReadArray way(way_.get());
  const ReadArray at_from(at_from_.get());
  const ReadArray along(along_way_.get());
  const WriteArray values(x);
  for (PetscInt i = 0; i < problem_.components; ++i)
    if (shortened[parts_.of(i)] != 0) values[i] = from[i] + t[parts_.of(i)] * way[i];
  for (std::size_t i = 0; i < active_.size(); ++i) {
    const PetscInt row = problem_.components + static_cast<PetscInt>(i);
    const std::size_t part = parts_.of(row);
    if (shortened[part] == 0) continue;
    active_[i] = delta * square_[i] * centre_[i] - (at_from[row] + t[part] * along[row]) > 0.0 ? 1 : 0;
  }
}

// d' R(u + t d) of each component; the last entry is the sum of all ranks' `more`.
std::vector<double> ProximalNewton::slopes(const std::vector<double>& t, double delta, double more) const {
  std::vector<double> sums(parts_.count() + 1, 0.0);
  sums.back() = more;
  {
    const ReadArray way(way_.get());
    const ReadArray at_from(at_from_.get());
    const ReadArray along(along_way_.get());
    for (PetscInt i = 0; i < problem_.components; ++i)
      sums[parts_.of(i)] += way[i] * (at_from[i] + t[parts_.of(i)] * along[i]);
    for (std::size_t i = 0; i < square_.size(); ++i) {
      const PetscInt row = problem_.components + static_cast<PetscInt>(i);
      const double gap = at_from[row] + t[parts_.of(row)] * along[row];
      sums[parts_.of(row)] -= along[row] * std::max(0.0, centre_[i] - gap / (delta * square_[i]));
    }
  }
  parts_.sum(sums);
  return sums;
}

// What the rounding of G u - g, divided by delta, makes of the slopes.
std::vector<double> ProximalNewton::rounding_of_slopes(double delta) const {
  std::vector<double> sums(parts_.count() + 1, 0.0);
  {
    const ReadArray along(along_way_.get());
    const ReadArray terms(terms_.get());
    for (std::size_t i = 0; i < square_.size(); ++i) {
      const PetscInt row = problem_.components + static_cast<PetscInt>(i);
      sums[parts_.of(row)] += std::abs(along[row]) * epsilon * terms[row] / (delta * square_[i]);
    }
  }
  parts_.sum(sums);
  return sums;
}

// The worst residual over row terms at the point that update_active has seen last.
double ProximalNewton::ratio() const {
  double worst = 0.0;
  {
    const ReadArray residual(f_.get());
    const ReadArray terms(terms_.get());
    for (PetscInt row = 0; row < residual.size(); ++row) {
      const PetscInt face = row - problem_.components;
      const bool open = face >= 0 && active_[static_cast<std::size_t>(face)] == 0;
      const double wrong = open ? std::max(0.0, -residual[row]) : std::abs(residual[row]);
      if (wrong == 0.0) continue;
      if (!(wrong / terms[row] <= worst)) worst = wrong / terms[row];  // keeps NaN
    }
  }
  if (std::isnan(worst)) worst = std::numeric_limits<double>::infinity();
  MPI_Allreduce(MPI_IN_PLACE, &worst, 1, MPI_DOUBLE, MPI_MAX, comm_);
  return worst;
}

}  // namespace sweepvi
