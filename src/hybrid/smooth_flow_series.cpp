// The Taylor series of SmoothFlow: their terms, and how long they hold. Where it stands at the begin, who
// stays in contact and which event is first is found in smooth_flow.cpp.

#include <algorithm>
#include <array>
#include <cmath>

#include "hybrid/series_terms.hpp"
#include "hybrid/smooth_flow.hpp"
#include "petsc/agreement.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr double coarsest = 1e-8;  // what is left out of a series, relative to its largest term, at most

using Numbers = std::vector<double>;

/// Whether the last two of these terms are negligible over a length, for what they are added to.
bool negligible(std::span<const double> terms, double length, double floor, double part) {
  double largest = floor, power = 1.0;
  std::array<double, 2> last{};
  for (const double coefficient : terms) {
    const double term = std::abs(coefficient) * power;
    largest = std::max(largest, term);
    last = {last[1], term};
    power *= length;
  }
  return std::isfinite(largest) && last[0] <= part * largest && last[1] <= part * largest;
}

}  // namespace

void SmoothFlow::find_rate(int k) {
  check(MatMult(system_.A.get(), X_[static_cast<std::size_t>(k)].get(), rate_.get()));
  if (system_.f.any) system_.f.add_to(rate_.get(), t_, k, 1.0 / factorial(k));
}

// a_k = w^(r+k) / k! with the multipliers that rate_ has in it.
void SmoothFlow::find_acceleration(int k) {
  check(MatMult(last_rows_.get(), rate_.get(), w_now_.get()));
  if (offset_ != nullptr) offset_->add_to(w_now_.get(), t_, degree_.highest + k, 1.0 / factorial(k));
  if (any_direct_)
    check(MatMultAdd(direct_rows_.get(), X_[static_cast<std::size_t>(k)].get(), w_now_.get(), w_now_.get()));
  copy_to(w_now_.get(), a_);
  if (any_direct_ && k == 0) {
    const ReadArray w0(system_.w0.get());
    for (std::size_t a = 0; a < constraints(); ++a)
      if (levels(a) == 0) a_[a] += w0[static_cast<PetscInt>(a)];
  }
  if (!system_.f.varies || degree_.highest == 0) return;
  forcing_.remaining_rate(t_, k, outputs_.get());
  const ReadArray extra(outputs_.get());
  for (std::size_t a = 0; a < constraints(); ++a)
    if (levels(a) > 0) a_[a] += extra[static_cast<PetscInt>(at(a, levels(a)))] / factorial(k);
}

// M Lambda_k = -a_k on those in contact.
bool SmoothFlow::find_multipliers(int k) {
  std::vector<char> set(constraints());
  for (std::size_t a = 0; a < constraints(); ++a) {
    set[a] = contact_[a] != Side::none ? 1 : 0;
    lambda_now_[a] = -a_[a];
    if (k == 0 && levels(a) == 0 && contact_[a] == Side::upper) lambda_now_[a] += upper_[a];
  }
  if (!forces_.solve(set, lambda_now_)) return false;
  if (any_direct_) forces_.find_rest(a_, lambda_now_, rest_);
  return true;
}

// Large multipliers that nearly cancel leave accelerations of what they hold: taken out once more.
bool SmoothFlow::refine_rate(int k) {
  double scale = 0.0;
  for (std::size_t a = 0; a < constraints(); ++a)
    if (levels(a) > 0) scale = std::max(scale, std::abs(a_[a]));
  std::vector<char> set(constraints());
  Numbers more(constraints());
  for (int sweep = 0; sweep < 4; ++sweep) {
    find_acceleration(k);
    std::array<double, 2> sizes{scale, 0.0};
    for (std::size_t a = 0; a < constraints(); ++a) {
      set[a] = contact_[a] != Side::none ? 1 : 0;
      more[a] = set[a] != 0 && levels(a) > 0 ? -a_[a] : 0.0;
      sizes[1] = std::max(sizes[1], std::abs(more[a]));
    }
    MPI_Allreduce(MPI_IN_PLACE, sizes.data(), 2, MPI_DOUBLE, MPI_MAX, system_.comm());
    if (!(sizes[1] > 16.0 * lost * sizes[0])) return true;
    if (!forces_.solve(set, more)) return false;
    {
      const WriteArray push(w_now_.get());
      for (std::size_t a = 0; a < constraints(); ++a) {
        push[static_cast<PetscInt>(a)] = more[a];
        lambda_now_[a] += more[a];
      }
    }
    check(MatMultAdd(system_.B.get(), w_now_.get(), rate_.get(), rate_.get()));
  }
  return true;
}

// The next term of x, w and lambda.
bool SmoothFlow::next() {
  const int k = known_ - 1;
  find_rate(k);
  if (any_contact_ || any_direct_) {
    find_acceleration(k);
    if (deciding_ ? !decide(k) : !find_multipliers(k)) return false;
    {
      const WriteArray push(w_now_.get());
      std::copy(lambda_now_.begin(), lambda_now_.end(), push.data());
    }
    if (any_direct_)
      for (std::size_t a = 0; a < constraints(); ++a)
        if (levels(a) == 0)
          w_.back()[a] = contact_[a] == Side::none              ? rest_[a]
                         : contact_[a] == Side::upper && k == 0 ? upper_[a]
                                                                : 0.0;
    check(MatMultAdd(system_.B.get(), w_now_.get(), rate_.get(), rate_.get()));
    if (forces_.coupled() && any_contact_ && !deciding_ && !refine_rate(k)) return false;
    lambda_.push_back(lambda_now_);
  }
  if (X_.size() <= static_cast<std::size_t>(known_)) X_.push_back(duplicate(rate_.get()));
  const Vec term = X_[static_cast<std::size_t>(known_)].get();
  check(VecCopy(rate_.get(), term));
  check(VecScale(term, 1.0 / static_cast<double>(known_)));
  check(MatMult(system_.C.get(), term, w_now_.get()));
  if (offset_ != nullptr) offset_->add_to(w_now_.get(), t_, known_, 1.0 / factorial(known_));
  w_.emplace_back();
  copy_to(w_now_.get(), w_.back());
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (known_ < levels(a)) w_.back()[a] = at_begin_.z[at(a, known_ + 1)] / factorial(known_);
    if (levels(a) == 0) w_.back()[a] = 0.0;  // the next term's multipliers say
  }
  ++known_;
  return true;
}

// Of the largest term.
double SmoothFlow::left_out(double length) const {
  return std::clamp(rate_of_error_ * length, lost, coarsest);
}

// Whether term k is negligible over length_, for each component, w and multiplier by itself.
void SmoothFlow::count_term(int k) {
  const double power = std::pow(length_, k), before = std::pow(length_, std::max(0, k - 1));
  bool loud = !std::isfinite(power);
  const double part = left_out(length_);
  const auto count = [&](double value, double& scale) {
    value = std::abs(value);
    scale = std::max(scale, value);
    loud = loud || !(value <= part * scale);
  };
  {
    const ReadArray term(X_[static_cast<std::size_t>(k)].get());
    for (PetscInt i = 0; i < term.size(); ++i)
      count(term[i] * power, scale_[static_cast<std::size_t>(i)]);
  }
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (levels(a) > 0)
      count(w_[static_cast<std::size_t>(k)][a] * power, w_scale_[a]);
    else if (k > 0)
      count(w_[static_cast<std::size_t>(k - 1)][a] * before, w_scale_[a]);
    if (k > 0 && static_cast<std::size_t>(k) <= lambda_.size() && contact_[a] != Side::none)
      count(lambda_[static_cast<std::size_t>(k - 1)][a] * before, lambda_scale_[a]);
  }
  loud = loud || !forcing_negligible(length_, k);
  quiet_ = anywhere(system_.comm(), loud) ? 0 : quiet_ + 1;
}

// Whether the k-th term of a sine of the highest frequency is.
bool SmoothFlow::forcing_negligible(double length, int k) const {
  double term = 1.0, largest = 1.0;
  for (int j = 1; j <= k && std::isfinite(term); ++j) {
    term *= fastest_ * length / static_cast<double>(j);
    largest = std::max(largest, term);
  }
  return fastest_ == 0.0 || term <= left_out(length) * largest;
}

std::optional<double> SmoothFlow::expand(double length, double rate) {
  // Two terms in a row: signals may have only odd ones; and what is at rest begins with zeros.
  const int least = std::max(6, degree_.highest + 4);
  length_ = length;
  rate_of_error_ = rate;
  quiet_ = 0;
  scale_.assign(traversed_.size(), 0.0);
  w_scale_.assign(constraints(), 0.0);
  lambda_scale_.assign(constraints(), 0.0);
  for (std::size_t a = 0; a < constraints(); ++a) {
    if (levels(a) > 0) w_scale_[a] = at_begin_.terms[at(a, 1)];
    lambda_scale_[a] = least_[a] / tie;
  }
  count_term(0);
  while (known_ < most_terms_ && !(known_ >= least && quiet_ >= 2)) {
    if (!next()) return std::nullopt;
    count_term(known_ - 1);
  }
  if (quiet_ < 2) length_ = longest(length);
  if (!(length_ > 0.0)) return std::nullopt;
  find_coupling();
  return length_;
}

// bound_ = |A| |x| + |f| + |B| |lambda| at the begin.
void SmoothFlow::find_coupling() {
  check(VecCopy(X_[0].get(), work_.get()));
  check(VecAbs(work_.get()));
  check(MatMult(abs_A_.get(), work_.get(), bound_.get()));
  if (system_.f.any) system_.f.add_bound_to(bound_.get(), 0, 1.0);
  if (!any_contact_ || lambda_.empty()) return;
  {
    const WriteArray sizes(w_now_.get());
    for (std::size_t a = 0; a < constraints(); ++a)
      sizes[static_cast<PetscInt>(a)] = std::abs(lambda_[0][a]);
  }
  check(MatMultAdd(abs_B_.get(), w_now_.get(), bound_.get(), bound_.get()));
}

// Over which the last two terms are negligible.
double SmoothFlow::longest(double length) const {
  constexpr double least = 1e-200;  // nothing is so fast
  const auto terms = static_cast<std::size_t>(known_);
  bool finite = true;
  const auto shorten = [&](std::span<const double> coefficients, double floor) {
    if (!std::all_of(coefficients.begin(), coefficients.end(), [](double c) { return std::isfinite(c); }))
      finite = false;
    while (finite && length > least && !negligible(coefficients, length, floor, left_out(length)))
      length *= 0.9;
  };
  std::array<double, enough_terms> column{};
  {
    std::vector<const PetscScalar*> X(terms);
    for (std::size_t k = 0; k < terms; ++k)
      check(VecGetArrayRead(X_[k].get(), &X[k]));
    for (std::size_t i = 0; i < traversed_.size(); ++i) {
      for (std::size_t k = 0; k < terms; ++k)
        column[k] = X[k][i];
      shorten({column.data(), terms}, 0.0);
    }
    for (std::size_t k = 0; k < terms; ++k)
      check(VecRestoreArrayRead(X_[k].get(), &X[k]));
  }
  for (std::size_t a = 0; a < constraints(); ++a) {
    const std::size_t count = levels(a) > 0 ? terms : terms - 1;
    for (std::size_t k = 0; k < count; ++k)
      column[k] = w_[k][a];
    shorten({column.data(), count}, levels(a) > 0 ? at_begin_.terms[at(a, 1)] : 0.0);
    if (contact_[a] == Side::none) continue;
    for (std::size_t k = 0; k < lambda_.size(); ++k)
      column[k] = lambda_[k][a];
    shorten({column.data(), lambda_.size()}, least_[a] / tie);
  }
  while (length > least &&
         !(forcing_negligible(length, known_ - 2) && forcing_negligible(length, known_ - 1)))
    length *= 0.9;
  if (!finite || length <= least) length = 0.0;
  MPI_Allreduce(MPI_IN_PLACE, &length, 1, MPI_DOUBLE, MPI_MIN, system_.comm());
  return length;
}

void SmoothFlow::state(double tau, Vec x) const {
  check(VecCopy(X_[static_cast<std::size_t>(known_ - 1)].get(), x));
  for (int k = known_ - 2; k >= 0; --k)
    check(VecAYPX(x, tau, X_[static_cast<std::size_t>(k)].get()));
}

void SmoothFlow::traverse(double tau, Vec x) {
  state(tau, x);
  double power = 1.0;
  for (int k = 0; k < known_; ++k) {
    const ReadArray term(X_[static_cast<std::size_t>(k)].get());
    for (PetscInt i = 0; i < term.size(); ++i) {
      double& largest = traversed_[static_cast<std::size_t>(i)];
      const double value = std::abs(term[i]) * power;
      largest = k == 0 ? value : std::max(largest, value);
    }
    power *= tau;
  }
  const ReadArray coupling(bound_.get());
  for (std::size_t i = 0; i < traversed_.size(); ++i)
    traversed_[i] = std::max(traversed_[i], tau * coupling[static_cast<PetscInt>(i)]);
}

}  // namespace sweepvi
