#include "dvi/output_forcing.hpp"

#include "petsc/sparse.hpp"

namespace sweepvi {

OutputForcing::OutputForcing(const LinearSystem& system, const RelativeDegree& relative_degree)
    : system_(system), relative_degree_(relative_degree) {
  check(MatCreateVecs(relative_degree.Z.get(), f_.put(), image_.put()));
  vanishes_ = find_whether_it_vanishes();
}

bool OutputForcing::find_whether_it_vanishes() {
  check(VecSet(f_.get(), 0.0));
  {
    const WriteArray forced(f_.get());
    for (const auto* entries : {&system_.f.constant, &system_.f.varying})
      for (const Forcing::Entry& entry : *entries)
        forced[entry.local] = 1.0;
  }
  check(MatMult(absolute_copy(relative_degree_.Z.get()).get(), f_.get(), image_.get()));
  int seen = 0;
  {
    const ReadArray w0(system_.w0.get());
    const ReadArray image(image_.get());
    for (std::size_t a = 0; a < relative_degree_.degree.size(); ++a) {
      if (w0[static_cast<PetscInt>(a)] != 0.0) seen = 1;
      for (int i = 1; i < relative_degree_.degree[a]; ++i)
        if (image[relative_degree_.first_level[a] + i - 1] != 0.0) seen = 1;
    }
  }
  MPI_Allreduce(MPI_IN_PLACE, &seen, 1, MPI_INT, MPI_LOR, system_.comm());
  return seen == 0;
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
  const int highest_derivative = system_.f.varies ? relative_degree_.highest - 2 : 0;
  for (int p = 0; p <= highest_derivative; ++p) {
    check(VecSet(f_.get(), 0.0));
    system_.f.add_to(f_.get(), t, p, 1.0);
    check(MatMult(relative_degree_.Z.get(), f_.get(), image_.get()));
    const ReadArray image(image_.get());
    const WriteArray values(g);
    for (std::size_t a = 0; a < degree.size(); ++a)
      for (int i = p + 2; i <= degree[a]; ++i)
        values[first[a] + i - 1] += image[first[a] + i - 2 - p];
  }
}

void OutputForcing::remaining_rate(double t, int order, Vec rate) {
  const std::vector<PetscInt>& first = relative_degree_.first_level;
  const std::vector<int>& degree = relative_degree_.degree;
  check(VecSet(rate, 0.0));
  for (int p = 1; p < relative_degree_.highest; ++p) {
    check(VecSet(f_.get(), 0.0));
    system_.f.add_to(f_.get(), t, p + order, 1.0);
    check(MatMult(relative_degree_.Z.get(), f_.get(), image_.get()));
    const ReadArray image(image_.get());
    const WriteArray values(rate);
    for (std::size_t a = 0; a < degree.size(); ++a)
      for (int i = p + 1; i <= degree[a]; ++i)
        values[first[a] + i - 1] += image[first[a] + i - 1 - p];
  }
}

void OutputForcing::increment_defect(const Step& step, double theta, Vec g_old, Vec g_new, Vec defect) {
  check(VecSet(f_.get(), 0.0));
  system_.f.add_to(f_.get(), step.t_new, 0, theta);
  if (theta != 1.0) system_.f.add_to(f_.get(), step.t_old, 0, 1.0 - theta);
  check(MatMult(relative_degree_.Z.get(), f_.get(), image_.get()));
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
