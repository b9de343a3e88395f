// How PrimalDual puts held outputs exactly on their bounds. Separate from primal_dual.cpp, which makes and
// solves the problem.

#include "dvi/primal_dual.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "petsc/sparse.hpp"

namespace sweepvi {

// How well each output is known: the terms of the rows of x it is made of, |Z| T + |g|, and the next level's
// own uncertainty through z_i = z_{i,k} + h z_{i+1}. Zx + g alone would not do: in contact all of Z x may be
// residue. The outputs are left in work_.
void PrimalDual::find_output_scale(Vec u) {
  known_terms(u, work_.get(), SaddleRows::Part::states, terms_.get());
  rows_.read_states(terms_.get(), HUGE_VAL, SaddleRows::Part::multipliers, spread_.get());
  const ReadArray spread(spread_.get());
  const ReadArray g(g_.get());
  for (std::size_t a = 0; a < levels_.constraints(); ++a) {
    double above = 0.0;
    for (int i = levels_.levels(a); i >= 1; --i) {
      const std::size_t q = levels_.at(a, i);
      const auto local = static_cast<PetscInt>(q);
      above = spread[local_x_ + local] + std::abs(g[local]) + h_ * above;
      output_scale_[q] = above;
    }
  }
}

namespace {
constexpr double known_net = 1e-14;  // of an output's scale: a measure is known up to that
constexpr double sum_rounding = 2.0 * std::numeric_limits<double>::epsilon();  // of an output's own terms
}  // namespace

// What measures of other constraints do to each output, and what that is known up to, over held_rtol.
void PrimalDual::find_cross_jumps(Vec u) {
  if (!cross_) return;
  find_net_multipliers(u, net_);
  const auto product = [&](auto&& of, Vec result) {
    {
      const WriteArray measures(output_g_old_.get());
      for (std::size_t q = 0; q < net_.size(); ++q)
        measures[static_cast<PetscInt>(q)] = of(q);
    }
    check(VecSet(result, 0.0));
    check(VecSet(output_g_new_.get(), 0.0));
    cross_rows_.add_product(output_g_old_.get(), result, output_g_new_.get());
  };
  const auto counts = [&](std::size_t q) { return std::abs(net_[q]) > known_net * output_scale_[q]; };
  product(
      [&](std::size_t q) {
        return counts(q) ? std::abs(net_[q]) + known_net / held_rtol * output_scale_[q] : 0.0;
      },
      defect_.get());
  check(VecCopy(output_g_new_.get(), cross_terms_.get()));
  product([&](std::size_t q) { return counts(q) ? net_[q] : 0.0; }, defect_.get());
}

// Which outputs stand at a bound of the step, up to rounding; their values, exact where held.
//
// Below level r, an output that Z x + g cannot tell from its bound is known better from AB (32): where no
// measure of its own acts on it, z_i = z_{i,k} + h z_{i+1,theta} + (what measures of others do to it). So a
// mass that leaves its wall slowly, far from the origin, does leave.
void PrimalDual::find_held(Vec u) {
  if (scales_known_)
    rows_.outputs(u, rhs_.get(), work_.get());
  else
    find_output_scale(u);
  find_cross_jumps(u);
  const ReadArray output(work_.get());
  const ReadArray cross(defect_.get());
  const ReadArray cross_terms(cross_terms_.get());
  crowded_ = {};
  std::size_t wall = 0;
  for (std::size_t a = 0; a < levels_.constraints(); ++a) {
    double fine = 0.0;  // what the next level is known up to
    for (int i = levels_.levels(a); i >= 1; --i) {
      const std::size_t q = levels_.at(a, i);
      const double z = output[local_x_ + static_cast<PetscInt>(q)];
      const bool follows = i < levels_.levels(a);
      double expected = follows ? levels_.z[q] + h_ * rate_of(q, settled_z_) : 0.0;
      fine = follows ? std::abs(levels_.z[q]) + h_ * (fine + (1.0 - theta_) * std::abs(levels_.z[q + 1]))
                     : output_scale_[q];
      if (follows && cross_) {
        expected += cross[static_cast<PetscInt>(q)];
        fine += cross_terms[static_cast<PetscInt>(q)];
      }
      open_[q] = 0;
      const bool near = !pinned(q) && std::abs(z) <= held_rtol * output_scale_[q];
      if (near && follows && orientation(a, i) * expected > held_rtol * fine) open_[q] = 1;
      held_[q] = near && open_[q] == 0 ? 1 : 0;
      settled_z_[q] = held_[q] != 0 ? 0.0 : open_[q] != 0 ? expected : z;
      if (i > 1 || wall == upper_walls_.size() || upper_walls_[wall] != a) continue;
      const double reach = held_rtol * (output_scale_[q] + levels_.upper[a]);
      at_upper_[wall] = std::abs(output[local_x_ + upper_at(wall)]) <= reach ? 1 : 0;
      if (at_upper_[wall] != 0) {
        stands_at_wall(a, reach);
        if (follows && levels_.upper[a] - expected > held_rtol * (levels_.upper[a] + fine)) {
          at_upper_[wall] = 0;
          open_[q] = 1;
          settled_z_[q] = expected;
        } else {
          held_[q] = 1;
          settled_z_[q] = levels_.upper[a];
        }
      }
      ++wall;
    }
  }
}

// In persistent contact outputs and the measures below level r are zero in exact arithmetic; what the solver
// leaves of them is residue. It must not be handed on: a later step, whose terms may be far smaller, would
// take it for an output that is honestly open, and rows made of residue alone could never be certified. So
// held outputs are put on their bound in x too, and their measures below level r follow from AB (32); one on
// level r that is below the rounding of the output's own terms is none: where a trajectory is tangent to its
// wall, nobody pushes.
void PrimalDual::settle(Vec u) {
  scales_known_ = false;
  find_held(u);
  scales_known_ = true;
  {
    const WriteArray values(u);
    for (std::size_t a = 0; a < levels_.constraints(); ++a) {
      for (int i = 1; i <= levels_.levels(a); ++i) {
        const std::size_t q = levels_.at(a, i);
        double& nu = values[local_x_ + static_cast<PetscInt>(q)];
        const double away = orientation(a, i) * settled_z_[q];
        const double push = orientation(a, i) * nu;
        const double least = i == levels_.levels(a) ? sum_rounding * output_scale_[q] : 0.0;
        if (pinned(q) || (away > 0.0 && (away > push || open_[q] != 0)) || push < least) nu = 0.0;
      }
    }
    for (std::size_t k = 0; k < upper_walls_.size(); ++k) {
      double& nu = values[local_x_ + upper_at(k)];
      const double gap = levels_.upper[upper_walls_[k]] - settled_z_[levels_.at(upper_walls_[k], 1)];
      if ((gap > 0.0 && gap > nu) || nu < 0.0) nu = 0.0;
    }
  }
  if (!with_levels_) return;
  if (h_ == 0.0) {
    recover_lower_measures(u);
    follow_measures(u);
    put_unit_outputs(u);
    return;
  }
  if (any_mixed_) project_held(u);
  put_unit_outputs(u);
  recover_lower_measures(u);
}

// x -= sum d_{a,i} (z_{a,i} - what it is) over the outputs that are known better than by Z x + g; twice, for
// what one of them leaves in another. What is no more than the rounding of that sum itself stays: it cannot
// be taken off, and a small state next to a large one - a ball near the origin under one further up - would
// be moved for nothing.
void PrimalDual::project_held(Vec u) {
  for (int pass = 0; pass < 2; ++pass) {
    if (pass > 0) rows_.outputs(u, rhs_.get(), work_.get());  // find_held has left them there
    {
      const ReadArray terms(terms_.get());
      const WriteArray output(work_.get());
      for (std::size_t q = 0; q < held_.size(); ++q) {
        const PetscInt row = local_x_ + static_cast<PetscInt>(q);
        double& residue = output[row];
        residue = held_[q] != 0 || open_[q] != 0 ? residue - settled_z_[q] : 0.0;
        if (std::abs(residue) <= sum_rounding * terms[row]) residue = 0.0;
      }
      for (std::size_t k = 0; k < upper_walls_.size(); ++k) {
        double& residue = output[local_x_ + upper_at(k)];
        if (at_upper_[k] != 0)
          output[local_x_ + static_cast<PetscInt>(levels_.at(upper_walls_[k], 1))] = -residue;
        residue = 0.0;
      }
    }
    rows_.add_pushes(work_.get(), u);  // K has -d in its columns
  }
}

// A jump is its measures: x = x_k + sum d_{a,i} mu_{a,i}. What the solver left of measures that are none is
// taken off x again, which may have no terms of its own to hide it in.
void PrimalDual::follow_measures(Vec u) {
  {
    const ReadArray values(u);
    const WriteArray taken(work_.get());
    for (PetscInt i = local_x_; i < taken.size(); ++i)
      taken[i] = -values[i];
  }
  {
    const ReadArray from(rhs_.get());
    const WriteArray x(u);
    std::copy_n(from.data(), local_x_, x.data());
  }
  rows_.add_pushes(work_.get(), u);  // K has -d in its columns
}

// Those that are single states: exactly.
void PrimalDual::put_unit_outputs(Vec u) {
  SparseRow remote;
  {
    const ReadArray g(g_.get());
    const WriteArray values(u);
    for (std::size_t q = 0; q < held_.size(); ++q) {
      if ((held_[q] == 0 && open_[q] == 0) || unit_scale_[q] == 0.0) continue;
      const double known = (settled_z_[q] - g[static_cast<PetscInt>(q)]) / unit_scale_[q];
      if (unit_state_[q] >= 0) values[unit_state_[q]] = known;
      if (unit_remote_[q] >= 0) remote.emplace_back(unit_remote_[q], known);
    }
  }
  if (!any_remote_) return;
  for (const auto& [unknown, value] : remote)
    check(VecSetValue(u, unknown, value, INSERT_VALUES));
  check(VecAssemblyBegin(u));
  check(VecAssemblyEnd(u));
}

// The multipliers of all outputs, those of upper walls subtracted.
void PrimalDual::find_net_multipliers(Vec u, std::vector<double>& net) const {
  const ReadArray values(u);
  net.assign(values.data() + local_x_, values.data() + local_x_ + levels_.z.size());
  for (std::size_t k = 0; k < upper_walls_.size(); ++k)
    net[levels_.at(upper_walls_[k], 1)] -= values[local_x_ + upper_at(k)];
}

// mu_i = z_{i,k+1} - z_{i,k} - h z_{i+1,k+1} - (what other constraints' measures do to z_i), i < r, where z_i
// is held. Measures that move each other stay as they are where they are more than residue: found one by one,
// each from what its neighbours were, they would not be those of one and the same point.
void PrimalDual::recover_lower_measures(Vec u) {
  check(VecSet(defect_.get(), 0.0));
  if (cross_) {
    find_net_multipliers(u, net_);
    {
      const WriteArray measures(output_g_old_.get());
      for (std::size_t q = 0; q < net_.size(); ++q)
        measures[static_cast<PetscInt>(q)] = std::abs(net_[q]) > known_net * output_scale_[q] ? net_[q] : 0.0;
    }
    check(MatMult(cross_.get(), output_g_old_.get(), defect_.get()));
  }
  const ReadArray cross(defect_.get());
  const WriteArray values(u);
  const std::vector<double>& z = settled_z_;
  const auto jump = [&](std::size_t q) {
    return z[q] - levels_.z[q] - h_ * rate_of(q, z) - cross[static_cast<PetscInt>(q)];
  };
  for (std::size_t a = 0; a < levels_.constraints(); ++a) {
    for (int i = 1; i < levels_.levels(a) && i <= levels_.level[a]; ++i) {
      const std::size_t q = levels_.at(a, i);
      if (held_[q] == 0 || (i == 1 && z[q] > 0.0)) continue;
      const double direction = orientation(a, i);
      double& nu = values[local_x_ + static_cast<PetscInt>(q)];
      const bool crossed = cross_ && !cross_rows_.entries(static_cast<PetscInt>(q)).empty();
      if (crossed && direction * nu > held_rtol * output_scale_[q]) continue;
      nu = direction * std::max(0.0, direction * jump(q));
    }
  }
  for (std::size_t k = 0; k < upper_walls_.size(); ++k)
    if (at_upper_[k] != 0 && levels_.levels(upper_walls_[k]) > 1)
      values[local_x_ + upper_at(k)] = std::max(0.0, -jump(levels_.at(upper_walls_[k], 1)));
}

void PrimalDual::accept(Vec u, Vec) {
  find_held(u);
  find_net_multipliers(u, net_);
  {
    const ReadArray values(u);
    const WriteArray x(x_.get());
    std::copy_n(values.data(), local_x_, x.data());
  }
  std::fill(levels_.mu.begin(), levels_.mu.end(), 0.0);
  for (std::size_t a = 0; a < levels_.constraints(); ++a) {
    for (int i = 1; i <= levels_.levels(a); ++i) {
      const std::size_t q = levels_.at(a, i);
      levels_.measure(a, i) = measure_per_nu_[q] * net_[q];
    }
    levels_.w[a] = settled_z_[levels_.at(a, 1)];
  }
  levels_.advance(settled_z_);
  check(VecCopy(u, u_.get()));
}

}  // namespace sweepvi
