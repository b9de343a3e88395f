#include "io/kept_run.hpp"

#include <algorithm>
#include <utility>

#include "parallel/gather.hpp"

namespace sweepvi {

namespace {

Quantity& states_of(Recording& recording) {
  const auto at = std::find_if(recording.quantities.begin(), recording.quantities.end(),
                               [](const Quantity& quantity) { return quantity.name == "/x"; });
  if (at == recording.quantities.end()) throw Error(ExitCode::internal, "a run without states");
  return *at;
}

/// Places of those entries that stand in one of the columns.
std::vector<PetscInt> places(const std::string& scene, const Quantity& states,
                             const std::vector<std::int64_t>& columns) {
  check_columns(scene, columns, static_cast<std::size_t>(states.total));
  if (columns.empty()) return states.positions;
  std::vector<PetscInt> chosen;
  for (const PetscInt position : states.positions) {
    const auto at = std::lower_bound(columns.begin(), columns.end(), std::int64_t{position});
    const bool wanted = at != columns.end() && *at == position;
    chosen.push_back(wanted ? static_cast<PetscInt>(at - columns.begin()) : -1);
  }
  return chosen;
}

}  // namespace

KeptRun::KeptRun(MPI_Comm comm, const std::string& scene, Recording recording,
                 const std::vector<std::int64_t>& columns)
    : comm_(comm),
      recording_(std::move(recording)),
      states_(states_of(recording_)),
      columns_(states_.total),
      width_(columns.empty() ? columns_ : std::ssize(columns)),
      order_(comm, places(scene, states_, columns), static_cast<PetscInt>(width_)),
      mine_(states_.positions.size()),
      slice_(static_cast<std::size_t>(order_.count())) {}

void KeptRun::row(double t) {
  states_.read(mine_.data());
  order_.bring(mine_.data(), slice_.data());
  slices_.insert(slices_.end(), slice_.begin(), slice_.end());
  t_.push_back(t);
}

void KeptRun::events(double t) {
  if (!recording_.events) return;
  const std::vector<Event> now = recording_.events(t);
  events_.insert(events_.end(), now.begin(), now.end());
}

std::vector<double> KeptRun::assemble() {
  int ranks = 1;
  MPI_Comm_size(comm_, &ranks);
  if (ranks == 1) return std::exchange(slices_, {});
  const int count = mpi_count(std::ssize(slices_));
  std::vector<int> counts(static_cast<std::size_t>(ranks));
  MPI_Allgather(&count, 1, MPI_INT, counts.data(), 1, MPI_INT, comm_);
  const std::vector<int> starts = starts_of_pieces(counts);
  std::vector<double> pieces(static_cast<std::size_t>(starts.back() + counts.back()));
  MPI_Allgatherv(slices_.data(), count, MPI_DOUBLE, pieces.data(), counts.data(), starts.data(), MPI_DOUBLE,
                 comm_);
  slices_ = {};
  std::vector<double> x(pieces.size());
  auto from = pieces.begin();
  std::ptrdiff_t first = 0;
  for (const int all : counts) {
    const std::ptrdiff_t part = all / std::ssize(t_);
    for (std::ptrdiff_t k = 0; k < std::ssize(t_); ++k, from += part)
      std::copy_n(from, part, x.begin() + k * width_ + first);
    first += part;
  }
  return x;
}

Recorded KeptRun::take(const std::string& name) {
  Recorded run;
  run.path = name;
  run.run = true;
  run.columns = static_cast<std::size_t>(columns_);
  run.elements = recording_.elements;
  if (recording_.events) {
    std::vector<Event> all = gather(comm_, events_);
    broadcast(comm_, all);
    std::stable_sort(all.begin(), all.end(), [](const Event& a, const Event& b) { return a.t < b.t; });
    run.events = std::move(all);
  }
  std::vector<double> x = assemble();
  agreed(comm_,
         [&] { run.trajectory = std::make_unique<StoredTrajectory>(std::exchange(t_, {}), std::move(x)); });
  return run;
}

}  // namespace sweepvi
