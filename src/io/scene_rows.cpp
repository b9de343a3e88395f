#include "io/scene_rows.hpp"

#include <algorithm>

namespace sweepvi {

SceneRows::SceneRows(const LinearSystem& system, const RelativeDegree& relative_degree,
                     const ConstrainedDvi& dvi)
    : relative_degree_(relative_degree), dvi_(dvi) {
  for (std::size_t a = 0; a < system.constraint_order.size(); ++a)
    rows_.push_back({a, system.constraint_order[a]});
  merged_row_.assign(rows_.size(), none);
  for (const OppositeRow& opposite : system.opposite) {
    const auto a = static_cast<std::size_t>(opposite.constraint);
    rows_[a].upper = false;
    merged_row_[a] = rows_.size();
    rows_.push_back({a, opposite.number, false, true, opposite.output_scale, opposite.multiplier_scale});
  }
  if (!system.wmax) return;
  const ReadArray wmax(system.wmax.get());
  wmax_.assign(wmax.data(), wmax.data() + wmax.size());
}

std::vector<PetscInt> SceneRows::numbers() const {
  std::vector<PetscInt> result;
  for (const Row& row : rows_)
    result.push_back(row.number);
  return result;
}

std::vector<int> SceneRows::degrees() const {
  std::vector<int> result;
  for (const Row& row : rows_)
    result.push_back(relative_degree_.degree[row.constraint]);
  return result;
}

void SceneRows::w(double* to) const {
  const std::vector<double>& w = dvi_.w();
  for (const Row& row : rows_) {
    const double value = w[row.constraint];
    *to++ = row.mirrored() ? row.output_scale * (wmax_[row.constraint] - value) : value;
  }
}

void SceneRows::z(double* to) const {
  const std::vector<double>& z = dvi_.z();
  if (z.empty()) return;
  for (const Row& row : rows_) {
    const PetscInt first = relative_degree_.first_level[row.constraint];
    const int levels = relative_degree_.degree[row.constraint];
    for (int i = 1; i <= levels; ++i) {
      const double value = z[static_cast<std::size_t>(first + i - 1)];
      const double bound = i == 1 && row.mirrored() ? wmax_[row.constraint] : 0.0;
      *to++ = row.mirrored() ? row.output_scale * (bound - value) : value;
    }
  }
}

// r* of a row is 1 while the constraint stands at the other wall.
void SceneRows::level(double* to) const {
  for (const Row& row : rows_) {
    const int level = dvi_.level()[row.constraint];
    const Side side = dvi_.side()[row.constraint];
    const bool elsewhere = (side == Side::upper && !row.upper) || (side == Side::lower && !row.lower);
    *to++ = elsewhere ? std::min(level, 1) : level;
  }
}

double SceneRows::measure(const Row& row, int level, double mu) const {
  if (!row.mirrored()) return row.upper ? mu : std::max(0.0, mu);
  const bool last = level == std::max(1, relative_degree_.degree[row.constraint]);
  return std::max(0.0, -mu) * (last ? 1.0 / row.multiplier_scale : row.output_scale);
}

void SceneRows::mu(double* to) const {
  const auto levels = static_cast<std::size_t>(dvi_.mu_levels());
  const std::vector<double>& mu = dvi_.mu();
  for (const Row& row : rows_)
    for (std::size_t i = 0; i < levels; ++i)
      *to++ = measure(row, static_cast<int>(i) + 1, mu[row.constraint * levels + i]);
}

const SceneRows::Row& SceneRows::row_of(const StepEvent& event) const {
  const auto a = static_cast<std::size_t>(event.constraint);
  const bool at_merged = event.side == Side::upper && merged_row_[a] != none;
  return rows_[at_merged ? merged_row_[a] : a];
}

PetscInt SceneRows::number_of(const StepEvent& event) const {
  return row_of(event).number;
}

double SceneRows::impulse_of(const StepEvent& event) const {
  return measure(row_of(event), event.level, event.impulse);
}

}  // namespace sweepvi
