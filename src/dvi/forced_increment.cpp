#include "dvi/forced_increment.hpp"

#include <algorithm>
#include <utility>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

/// The same rows, without the columns of states on which no force acts.
Matrix seen_by(Mat matrix, Vec forced) {
  Matrix scaled;
  check(MatDuplicate(matrix, MAT_COPY_VALUES, scaled.put()));
  check(MatDiagonalScale(scaled.get(), nullptr, forced));
  RowBuilder rows;
  for_each_row(scaled.get(), [&](PetscInt, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k)
      if (values[k] != 0.0) rows.add(columns[k], values[k]);
    rows.end_row();
  });
  return rows.finish(PetscObjectComm(reinterpret_cast<PetscObject>(matrix)), column_range(matrix).size());
}

/// Rows of Z in the places of outputs: visit(q, its level from 0, levels of its constraint, builder) adds up
/// the row of output q; other rows are empty.
template <class Visit>
Matrix placed_outputs(const LinearSystem& system, const RelativeDegree& relative_degree,
                      const OutputCoordinates& coordinates, Visit&& visit) {
  const std::vector<PetscInt>& first = relative_degree.first_level;
  std::vector<int> level, levels;
  for (std::size_t a = 0; a + 1 < first.size(); ++a)
    for (PetscInt q = first[a]; q < first[a + 1]; ++q) {
      level.push_back(static_cast<int>(q - first[a]));
      levels.push_back(static_cast<int>(first[a + 1] - first[a]));
    }
  const PetscInt states = row_range(system.A.get()).size();
  RowBuilder rows;
  for (PetscInt i = 0; i < states; ++i) {
    const PetscInt q = coordinates.output_at(i);
    if (q >= 0) visit(q, level[static_cast<std::size_t>(q)], levels[static_cast<std::size_t>(q)], rows);
    rows.end_row();
  }
  return rows.finish(system.comm(), states);
}

}  // namespace

ForcedIncrement::ForcedIncrement(const LinearSystem& system, const RelativeDegree& relative_degree,
                                 const OutputCoordinates& coordinates, bool unseen, Mat R, Mat jumps,
                                 Mat inverse_jumps, double h, double theta)
    : f_(&system.f),
      direct_(unseen && coordinates.plain()),
      h_new_(h * theta),
      h_old_(h * (1.0 - theta)),
      constant_(!system.f.varies) {
  if (direct_) return;
  find_kept(relative_degree, coordinates, row_range(system.A.get()).size());
  const Vector forced = duplicate(system.x0.get());
  {
    const WriteArray values(forced.get());
    for (const auto* entries : {&system.f.constant, &system.f.varying})
      for (const Forcing::Entry& entry : *entries)
        values[entry.local] = 1.0;
  }
  const Matrix seen = seen_by(relative_degree.Z.get(), forced.get());
  const PetscInt first_output = row_range(seen.get()).first;
  const auto Z = [&](PetscInt q) { return get_row(seen.get(), first_output + q); };
  const int derivatives = system.f.varies ? std::max(relative_degree.highest - 1, 1) : 1;
  const Matrix W = seen_by(coordinates.to_u_matrix().get(), forced.get());
  for (int p = 0; p < derivatives; ++p) {
    // g = sum_p T_p f^(p): (Z f^(p))_i goes to level i + 1 + p
    const Matrix T = placed_outputs(system, relative_degree, coordinates,
                                    [&](PetscInt q, int level, int, RowBuilder& rows) {
                                      if (level >= p + 1) rows.add(Z(q - 1 - p));
                                    });
    const Matrix RT = multiply_clean(R, T.get());
    Matrix at_end = add(T.get(), -h_new_, RT.get());
    Matrix at_start = add(T.get(), h_old_, RT.get());
    check(MatScale(at_start.get(), -1.0));
    if (p == 0) {
      at_end = add(at_end.get(), h_new_, W.get());
      at_start = add(at_start.get(), h_old_, W.get());
    }
    if (jumps != nullptr && system.f.varies && relative_degree.highest > 2) {
      const auto completion = [&](double share, double sign) {
        const Matrix lacks = placed_outputs(system, relative_degree, coordinates,
                                            [&](PetscInt q, int level, int levels, RowBuilder& rows) {
                                              if (level + 1 == levels) return;
                                              if (p > 0 && level >= p) rows.add(Z(q - p), share);
                                              if (level >= p + 1) rows.add(Z(q - 1 - p), -sign);
                                            });
        const Matrix reached = multiply_clean(inverse_jumps, lacks.get());
        RowBuilder below;  // levels below r alone
        PetscInt place = 0;
        for_each_row(reached.get(), [&](PetscInt, auto columns, auto values) {
          if (!std::binary_search(kept_.begin(), kept_.end(), place))
            for (std::size_t k = 0; k < columns.size(); ++k)
              below.add(columns[k], values[k]);
          below.end_row();
          ++place;
        });
        return multiply_clean(jumps, below.finish(system.comm(), place).get());
      };
      at_end = add(at_end.get(), 1.0, completion(h_new_, 1.0).get());
      at_start = add(at_start.get(), 1.0, completion(h_old_, -1.0).get());
    }
    add_part(at_end.get(), p, new_);
    add_part(at_start.get(), p, old_);
  }
  // Of w0, which is the same at both ends: -h R g.
  const Vector offset = duplicate(system.x0.get());
  const Vector rate = duplicate(system.x0.get());
  {
    const ReadArray w0(system.w0.get());
    const WriteArray g(offset.get());
    const std::vector<PetscInt>& first = relative_degree.first_level;
    for (std::size_t a = 0; a + 1 < first.size(); ++a)
      if (first[a] < first[a + 1])
        g[coordinates.positions()[static_cast<std::size_t>(first[a])]] = w0[static_cast<PetscInt>(a)];
  }
  check(MatMult(R, offset.get(), rate.get()));
  const ReadArray rates(rate.get());
  for (const PetscInt i : kept_)
    c_0_.push_back(-h * rates[i]);
  for (Signals* signals : {&now_, &before_})
    for (int p = 0; p < derivatives; ++p)
      signals->of_order.push_back(duplicate(system.x0.get()));
}

void ForcedIncrement::find_kept(const RelativeDegree& relative_degree, const OutputCoordinates& coordinates,
                                PetscInt states) {
  const std::vector<PetscInt>& first = relative_degree.first_level;
  std::vector<char> is_last(coordinates.positions().size(), 0);
  for (std::size_t a = 0; a + 1 < first.size(); ++a)
    if (first[a] < first[a + 1]) is_last[static_cast<std::size_t>(first[a + 1] - 1)] = 1;
  for (PetscInt i = 0; i < states; ++i) {
    const PetscInt q = coordinates.output_at(i);
    if (q < 0 || is_last[static_cast<std::size_t>(q)] != 0) kept_.push_back(i);
  }
}

// Rows that are kept; nothing if that is nothing on all ranks.
void ForcedIncrement::add_part(Mat matrix, int order, std::vector<Part>& parts) const {
  RowBuilder rows;
  auto kept = kept_.begin();
  PetscInt place = 0;
  int any = 0;
  for_each_row(matrix, [&](PetscInt, auto columns, auto values) {
    if (kept != kept_.end() && *kept == place) {
      ++kept;
      for (std::size_t k = 0; k < columns.size(); ++k) {
        if (values[k] == 0.0) continue;
        rows.add(columns[k], values[k]);
        any = 1;
      }
    }
    rows.end_row();
    ++place;
  });
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(matrix));
  MPI_Allreduce(MPI_IN_PLACE, &any, 1, MPI_INT, MPI_LOR, comm);
  const Matrix few = rows.finish(comm, place);
  if (any != 0) parts.push_back({AffineRows(few.get()), order});
}

void ForcedIncrement::find_signals(double t, Signals& signals) const {
  if (signals.time == t) return;
  signals.time = t;
  for (std::size_t p = 0; p < signals.of_order.size(); ++p) {
    Vec f = signals.of_order[p].get();
    f_->clear(f);  // all other rows are 0 for good
    f_->add_to(f, t, static_cast<int>(p), 1.0);
  }
}

void ForcedIncrement::add_parts(const std::vector<Part>& parts, const Signals& signals, Vec c) const {
  const WriteArray sum(c);
  for (const Part& part : parts) {
    Vec f = signals.of_order[static_cast<std::size_t>(part.order)].get();
    const double* others = part.rows.ghosts(f);
    const ReadArray own(f);
    for (const PetscInt i : kept_)
      sum[i] += part.rows.row(i, own.data(), others).sum;
  }
}

void ForcedIncrement::find(const Step& step, Vec c) {
  if (constant_ && std::exchange(found_, true)) return;
  if (direct_) {
    f_->clear(c);  // all other rows are 0 for good
    f_->add_to(c, step.t_new, 0, h_new_);
    if (h_old_ != 0.0) f_->add_to(c, step.t_old, 0, h_old_);
    return;
  }
  std::swap(now_, before_);
  find_signals(step.t_old, before_);
  find_signals(step.t_new, now_);
  {
    const WriteArray sum(c);
    for (std::size_t k = 0; k < kept_.size(); ++k)
      sum[kept_[k]] = c_0_[k];
  }
  add_parts(new_, now_, c);
  add_parts(old_, before_, c);
}

}  // namespace sweepvi
