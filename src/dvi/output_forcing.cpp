#include "dvi/output_forcing.hpp"

#include <algorithm>
#include <cmath>

#include "petsc/sparse.hpp"

namespace sweepvi {

OutputForcing::OutputForcing(const LinearSystem& system, const RelativeDegree& relative_degree)
    : system_(system), relative_degree_(relative_degree) {
  check(MatCreateVecs(relative_degree.Z.get(), f_.put(), image_.put()));
  find_seen();
}

// Which entries of f the outputs below level r see. That is few, mostly, and of our own rank.
void OutputForcing::find_seen() {
  check(VecSet(f_.get(), 0.0));
  {
    const WriteArray forced(f_.get());
    for (const auto* entries : {&system_.f.constant, &system_.f.varying})
      for (const Forcing::Entry& entry : *entries)
        forced[entry.local] = 1.0;
  }
  check(MatMult(absolute_copy(relative_degree_.Z.get()).get(), f_.get(), image_.get()));
  int found[2] = {0, 0};  // is anything seen, and from another rank?
  {
    const LocalRange own = row_range(system_.A.get());
    const ReadArray w0(system_.w0.get());
    const ReadArray image(image_.get());
    const ReadArray forced(f_.get());
    std::size_t a = 0;
    PetscInt q = 0;
    const std::vector<PetscInt>& first = relative_degree_.first_level;
    for_each_row(relative_degree_.Z.get(), [&](PetscInt, auto columns, auto values) {
      while (q >= first[a + 1])
        ++a;
      const PetscInt above = first[a + 1] - q - 1;
      if (above > 0 && image[q] != 0.0) {
        double seen = 0.0;
        for (std::size_t k = 0; k < columns.size(); ++k) {
          const PetscInt column = columns[k] - own.first;
          if (!own.contains(columns[k]) || forced[column] == 0.0 || values[k] == 0.0) continue;
          columns_.push_back(column);
          values_.push_back(values[k]);
          seen += std::abs(values[k]);
        }
        seeing_.push_back({q, above, static_cast<PetscInt>(columns_.size())});
        found[0] = 1;
        if (std::abs(image[q] - seen) > rounding * image[q]) found[1] = 1;
      }
      ++q;
    });
    for (std::size_t b = 0; b < relative_degree_.degree.size(); ++b)
      if (w0[static_cast<PetscInt>(b)] != 0.0) found[0] = 1;
  }
  MPI_Allreduce(MPI_IN_PLACE, found, 2, MPI_INT, MPI_LOR, system_.comm());
  for (const Seeing& output : seeing_)
    most_above_ = std::max(most_above_, output.above);
  MPI_Allreduce(MPI_IN_PLACE, &most_above_, 1, MPIU_INT, MPI_MAX, system_.comm());
  vanishes_ = found[0] == 0;
  local_ = found[1] == 0;
  check(VecSet(f_.get(), 0.0));
  check(VecSet(image_.get(), 0.0));
}

// image_ = Z f_; where that is local_, only of outputs that see something. f_ is 0 but where the forcing is.
void OutputForcing::map_to_outputs() {
  if (!local_) {
    check(MatMult(relative_degree_.Z.get(), f_.get(), image_.get()));
    return;
  }
  const ReadArray f(f_.get());
  const WriteArray image(image_.get());
  std::size_t k = 0;
  for (const Seeing& output : seeing_) {
    double sum = 0.0;
    for (; k < static_cast<std::size_t>(output.end); ++k)
      sum += values_[k] * f[columns_[k]];
    image[output.number] = sum;
  }
}

// image_ = Z f^(order)(t)
void OutputForcing::find_image(double t, int order) {
  system_.f.clear(f_.get());
  system_.f.add_to(f_.get(), t, order, 1.0);
  map_to_outputs();
  image_time_ = order == 0 ? t : std::numeric_limits<double>::quiet_NaN();
}

void OutputForcing::evaluate(double t, Vec g) {
  const std::vector<PetscInt>& first = relative_degree_.first_level;
  const std::vector<int>& degree = relative_degree_.degree;
  check(VecSet(g, 0.0));
  {
    const ReadArray w0(system_.w0.get());
    const WriteArray values(g);
    for (std::size_t a = 0; a < degree.size(); ++a)
      if (degree[a] > 0) values[first[a]] = w0[static_cast<PetscInt>(a)];
  }
  if (!system_.f.any) return;
  const PetscInt derivatives = system_.f.varies ? most_above_ : std::min<PetscInt>(most_above_, 1);
  for (PetscInt p = derivatives; p-- > 0;) {  // f itself last: its image may be asked for again
    find_image(t, static_cast<int>(p));
    const ReadArray image(image_.get());
    const WriteArray values(g);
    for (const Seeing& output : seeing_)
      if (output.above > p) values[output.number + 1 + p] += image[output.number];
  }
}

void OutputForcing::remaining_rate(double t, int order, Vec rate) {
  check(VecSet(rate, 0.0));
  for (int p = 1; p < relative_degree_.highest; ++p) {
    find_image(t, p + order);
    const ReadArray image(image_.get());
    const WriteArray values(rate);
    for (const Seeing& output : seeing_)
      if (output.above >= p) values[output.number + p] += image[output.number];
  }
}

void OutputForcing::increment_defect(const Step& step, double theta, Vec g_old, Vec g_new, Vec defect) {
  if (theta != 1.0 || image_time_ != step.t_new) {
    system_.f.clear(f_.get());
    system_.f.add_to(f_.get(), step.t_new, 0, theta);
    if (theta != 1.0) system_.f.add_to(f_.get(), step.t_old, 0, 1.0 - theta);
    map_to_outputs();
    image_time_ = std::numeric_limits<double>::quiet_NaN();
  }
  const ReadArray image(image_.get());
  const ReadArray before(g_old);
  const ReadArray after(g_new);
  const WriteArray values(defect);
  const std::vector<PetscInt>& first = relative_degree_.first_level;
  for (std::size_t a = 0; a < relative_degree_.degree.size(); ++a) {
    for (PetscInt q = first[a]; q < first[a + 1]; ++q) {
      const bool last_level = q + 1 == first[a + 1];
      if (last_level) {
        values[q] = 0.0;
        continue;
      }
      const double next = theta * after[q + 1] + (1.0 - theta) * before[q + 1];
      values[q] = step.h * (next - image[q]) - (after[q] - before[q]);
    }
  }
}

}  // namespace sweepvi
