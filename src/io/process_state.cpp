#include "io/process_state.hpp"

#include <fmt/format.h>

#include <numeric>
#include <optional>

namespace sweepvi {

namespace {

/// Where the numbers of `to` go; a rank's own sums have a place for each rank.
Places places_of(MPI_Comm comm, const StateOrder& order, Belongs to) {
  if (to == Belongs::state) return order.states;
  if (to == Belongs::constraint) return order.constraints;
  int rank = 0;
  int ranks = 1;
  MPI_Comm_rank(comm, &rank);
  MPI_Comm_size(comm, &ranks);
  return {{rank}, ranks};
}

std::string label(const char* name) {
  return std::string("state: ") + name;
}

class Save final : public StateVisitor {
public:
  Save(MPI_Comm comm, const StateOrder& order, CheckpointData& data)
      : comm_(comm), order_(order), data_(data) {}
  using StateVisitor::visit;
  bool replaces() const override { return false; }
  void visit(const char* name, Belongs to, std::span<double> values, std::size_t width) override {
    data_.numbers[label(name)] = bring_together(comm_, places_of(comm_, order_, to), values, width);
  }

private:
  MPI_Comm comm_;
  const StateOrder& order_;
  CheckpointData& data_;
};

class Restore final : public StateVisitor {
public:
  /// @param other_form  numbers that are not there stay as they are
  Restore(MPI_Comm comm, const StateOrder& order, const CheckpointData& data, bool other_form)
      : comm_(comm), order_(order), data_(data), other_form_(other_form) {
    MPI_Comm_rank(comm_, &rank_);
  }
  using StateVisitor::visit;
  bool replaces() const override { return true; }

  void visit(const char* name, Belongs to, std::span<double> values, std::size_t width) override {
    const Places places = places_of(comm_, order_, to);
    std::vector<double> all;
    bool found = true;
    agreed(comm_, [&] {
      if (rank_ != 0) return;
      const auto at = data_.numbers.find(label(name));
      found = at != data_.numbers.end();
      if (!found && other_form_) return;
      all = found ? at->second : std::vector<double>();
      if (to == Belongs::rank) adopt_ranks(all, static_cast<std::size_t>(places.total), width);
      if (all.size() != static_cast<std::size_t>(places.total) * width)
        throw InputError(fmt::format(
            "the checkpoint has {} numbers '{}' where the scene has {}; it was written by another version",
            all.size(), name, static_cast<std::size_t>(places.total) * width));
    });
    int there = found ? 1 : 0;
    MPI_Bcast(&there, 1, MPI_INT, 0, comm_);
    if (there != 0) deal_out(comm_, places, all, width, values);
  }

private:
  /// Sums of another number of ranks: rank 0 takes them all.
  static void adopt_ranks(std::vector<double>& sums, std::size_t ranks, std::size_t width) {
    if (sums.size() == ranks * width || width == 0 || sums.size() % width != 0) return;
    std::vector<double> adopted(ranks * width, 0.0);
    for (std::size_t i = 0; i < sums.size(); ++i)
      adopted[i % width] += sums[i];
    sums = std::move(adopted);
  }

  MPI_Comm comm_;
  const StateOrder& order_;
  const CheckpointData& data_;
  bool other_form_;
  int rank_ = 0;
};

}  // namespace

void save_state(MPI_Comm comm, const ShowState& show, const StateOrder& order, const std::string& form,
                CheckpointData& data) {
  data.facts["form"] = form;
  Save save(comm, order, data);
  show(save);
}

void restore_state(MPI_Comm comm, const ShowState& show, const StateOrder& order, const std::string& form,
                   const CheckpointData& data) {
  int other = data.facts.value("form", form) == form ? 0 : 1;
  MPI_Bcast(&other, 1, MPI_INT, 0, comm);
  Restore restore(comm, order, data, other != 0);
  show(restore);
}

}  // namespace sweepvi
