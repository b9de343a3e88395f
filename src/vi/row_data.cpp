#include "vi/row_data.hpp"

#include <algorithm>
#include <cmath>
#include <numeric>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr int sweeps = 4;
constexpr double passed_on = 0.98;   // by a row: what comes round again and again stays bounded
constexpr double of_own_row = 1e-3;  // what an unknown that vanishes is known up to

/// Rows in the order of the sweeps: from large terms to small ones, the way of a front that decays into what
/// is at rest; forth; back; from large ones again.
class Order {
public:
  Order(const AffineRows& rows, Vec u, Vec own) {
    const double* others = rows.ghosts(u);
    const ReadArray x(u);
    const ReadArray d(own);
    std::vector<double> terms(static_cast<std::size_t>(x.size()));
    rows.each_row(x.data(), others, [&](PetscInt i, const AffineRows::Row& row) {
      terms[static_cast<std::size_t>(i)] = row.size + d[i];
    });
    by_terms_.resize(terms.size());
    std::iota(by_terms_.begin(), by_terms_.end(), PetscInt{0});
    std::stable_sort(by_terms_.begin(), by_terms_.end(), [&](PetscInt a, PetscInt b) {
      return terms[static_cast<std::size_t>(a)] > terms[static_cast<std::size_t>(b)];
    });
  }
  PetscInt row(int sweep, PetscInt k) const {
    if (sweep % 3 == 0) return by_terms_[static_cast<std::size_t>(k)];
    return sweep % 3 == 1 ? k : static_cast<PetscInt>(by_terms_.size()) - 1 - k;
  }

private:
  std::vector<PetscInt> by_terms_;
};

bool within_bounds(double u, double lower, double upper) {
  const double below = lower > PETSC_NINFINITY ? std::abs(lower) : 0.0;
  const double above = upper < PETSC_INFINITY ? std::abs(upper) : 0.0;
  return std::abs(u) <= std::max(below, above);
}

}  // namespace

void RowData::evaluate(const AffineRows& rows, Vec u, Vec lower, Vec upper, Vec own, Vec data, Vec terms) {
  const PetscInt count = rows.size();
  const Vector size = duplicate(u);       // |u|, or what is known of it
  const Vector explained = duplicate(u);  // the part that data explain
  std::vector<char> bounded(static_cast<std::size_t>(count), 0);
  {
    const ReadArray x(u);
    const ReadArray l(lower);
    const ReadArray b(upper);
    const WriteArray sizes(size.get());
    const WriteArray parts(explained.get());
    for (PetscInt i = 0; i < count; ++i) {
      const bool within = within_bounds(x[i], l[i], b[i]);
      bounded[static_cast<std::size_t>(i)] = within ? 1 : 0;
      sizes[i] = std::abs(x[i]);
      parts[i] = within ? sizes[i] : 0.0;
    }
  }
  const Order order(rows, u, own);
  for (int sweep = 0; sweep < sweeps; ++sweep) {
    // Ghosts are those of the sweep before.
    std::vector<double> far_size;
    std::vector<double> far_part;
    if (const double* ghosts = rows.ghosts(size.get()); ghosts != nullptr)
      far_size.assign(ghosts, ghosts + rows.ghost_count());
    if (const double* ghosts = rows.ghosts(explained.get()); ghosts != nullptr)
      far_part.assign(ghosts, ghosts + rows.ghost_count());
    const ReadArray x(u);
    const ReadArray d(own);
    const WriteArray sizes(size.get());
    const WriteArray parts(explained.get());
    const WriteArray result(data);
    const WriteArray all(terms);
    for (PetscInt k = 0; k < count; ++k) {
      const PetscInt i = order.row(sweep, k);
      double others = d[i];
      double known = d[i];
      double diagonal = 0.0;
      double entries = 0.0;
      for (const auto& [offset, value] : rows.entries(i)) {
        const double entry = std::abs(value);
        entries += entry;
        if (offset == 0) {
          diagonal = entry;
          continue;
        }
        const PetscInt column = i + offset;
        const bool near = column < count;
        const auto ghost = static_cast<std::size_t>(near ? 0 : column - count);
        others += entry * (near ? sizes[column] : far_size[ghost]);
        known += passed_on * entry * (near ? parts[column] : far_part[ghost]);
      }
      const double part = others > 0.0 ? std::min(1.0, known / others) : 0.0;
      double its_size = std::abs(x[i]);
      if (diagonal > 0.0)
        its_size = std::max(its_size, of_own_row * (others + diagonal * its_size) / entries);
      sizes[i] = its_size;
      parts[i] = part * its_size;
      if (bounded[static_cast<std::size_t>(i)] != 0) parts[i] = std::max(parts[i], std::abs(x[i]));
      all[i] = others + diagonal * its_size;
      result[i] = d[i] + indirect * (std::min(others, known) - d[i] + diagonal * parts[i]);
    }
  }
}

}  // namespace sweepvi
