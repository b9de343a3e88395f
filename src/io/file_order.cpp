#include "io/file_order.hpp"

namespace sweepvi {

FileOrder::FileOrder(MPI_Comm comm, const std::vector<PetscInt>& file_index, PetscInt total) {
  for (std::size_t i = 0; i < file_index.size(); ++i)
    if (file_index[i] >= 0) kept_.push_back(i);
  mine_ = make_vector(comm, static_cast<PetscInt>(kept_.size()));
  count_ = PETSC_DECIDE;
  check(PetscSplitOwnership(comm, &count_, &total));
  slice_ = make_vector(comm, count_);
  check(VecGetOwnershipRange(slice_.get(), &first_, nullptr));
  PetscInt own_first = 0;
  check(VecGetOwnershipRange(mine_.get(), &own_first, nullptr));
  std::vector<PetscInt> from;
  std::vector<PetscInt> to;
  for (const std::size_t i : kept_) {
    from.push_back(own_first + static_cast<PetscInt>(from.size()));
    to.push_back(file_index[i]);
  }
  IndexSet from_set;
  IndexSet to_set;
  const auto size = static_cast<PetscInt>(from.size());
  check(ISCreateGeneral(comm, size, from.data(), PETSC_COPY_VALUES, from_set.put()));
  check(ISCreateGeneral(comm, size, to.data(), PETSC_COPY_VALUES, to_set.put()));
  check(VecScatterCreate(mine_.get(), from_set.get(), slice_.get(), to_set.get(), scatter_.put()));
}

void FileOrder::bring(const double* mine, double* slice, std::size_t width) {
  for (std::size_t k = 0; k < width; ++k) {
    {
      const WriteArray values(mine_.get());
      for (std::size_t j = 0; j < kept_.size(); ++j)
        values[static_cast<PetscInt>(j)] = mine[kept_[j] * width + k];
    }
    check(VecScatterBegin(scatter_.get(), mine_.get(), slice_.get(), INSERT_VALUES, SCATTER_FORWARD));
    check(VecScatterEnd(scatter_.get(), mine_.get(), slice_.get(), INSERT_VALUES, SCATTER_FORWARD));
    const ReadArray values(slice_.get());
    for (PetscInt i = 0; i < count_; ++i)
      slice[static_cast<std::size_t>(i) * width + k] = values[i];
  }
}

}  // namespace sweepvi
