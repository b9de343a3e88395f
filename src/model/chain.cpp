#include "model/chain.hpp"

#include "model/coupling_graph.hpp"
#include "model/dense_parts.hpp"
#include "model/golden_fraction.hpp"
#include "petsc/agreement.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi {

ChainSpec ChainSpec::of(const Element& element, std::int64_t count) {
  ChainSpec spec;
  spec.element = &element;
  spec.count = count;
  if (element.coupling) spec.coupling = element.coupling->standard;
  for (const Element::Key& key : element.keys)
    spec.keys.push_back({{key.standard}});
  for (const Element::Force& force : element.forces)
    spec.forces.push_back({{Signal{force.standard}}});
  spec.phase_spread.assign(element.forces.size(), 0.0);
  return spec;
}

Signal ChainSpec::force(std::size_t k, std::int64_t i) const {
  Signal signal = forces[k][i];
  signal.phase += phase_spread[k] * golden_fraction(i);
  return signal;
}

namespace {

/// Makes this rank's rows of a chain, one element after the other.
class ChainBuilder {
public:
  ChainBuilder(MPI_Comm comm, const ChainSpec& spec)
      : comm_(comm),
        spec_(spec),
        element_(*spec.element),
        states_(static_cast<PetscInt>(element_.states.size())),
        elements_(share(comm, static_cast<PetscInt>(spec.count))),
        graph_(comm, spec, elements_),
        values_(element_.keys.size()) {}

  LinearSystem build() {
    system_.x0 = make_vector(comm_, states_ * elements_.size());
    system_.w0 = make_vector(comm_, elements_.size());
    {
      const WriteArray x0(system_.x0.get());
      const WriteArray w0(system_.w0.get());
      for (PetscInt i = elements_.first; i < elements_.last; ++i) {
        for (std::size_t k = 0; k < values_.size(); ++k)
          values_[k] = spec_.keys[k][i];
        add_states(i);
        add_constraint(i);
        add_forces(i);
        const PetscInt local = i - elements_.first;
        if (element_.offset) w0[local] = element_.offset(place(i), values_);
        start(i, {&x0[states_ * local], static_cast<std::size_t>(states_)});
      }
    }
    system_.A = a_.finish(comm_, states_ * elements_.size());
    system_.B = b_.finish(comm_, elements_.size());
    system_.C = c_.finish(comm_, states_ * elements_.size());
    system_.f.any = anywhere(comm_, !system_.f.constant.empty() || !system_.f.varying.empty());
    system_.f.varies = anywhere(comm_, !system_.f.varying.empty());
    system_.block_count = static_cast<PetscInt>(spec_.count);
    system_.state_names = element_.states;
    system_.layout = element_.layout;
    return std::move(system_);
  }

private:
  Element::Place place(PetscInt i) const { return {i, spec_.count}; }
  bool exists(PetscInt i) const { return i >= 0 && i < spec_.count; }

  PetscInt scene_number(PetscInt i, PetscInt state) const {
    return element_.layout == StateLayout::element_by_element
               ? states_ * i + state
               : static_cast<PetscInt>(spec_.count) * state + i;
  }

  /// Rows of A and B.
  void add_states(PetscInt i) {
    for (PetscInt state = 0; state < states_; ++state) {
      for (const Element::Term& term : element_.terms)
        if (term.row == state) a_.add(states_ * i + term.column, term.value(values_));
      if (element_.coupling && element_.coupling->row == state) add_coupling(i);
      a_.end_row();
      for (const Element::Push& push : element_.pushes)
        if (push.state == state && exists(i - push.shift)) b_.add(i - push.shift, push.value(values_));
      b_.end_row();
      system_.block.push_back(i);
      system_.state_order.push_back(scene_number(i, state));
    }
  }

  /// factor S(w)_i, in the states that each w reads.
  void add_coupling(PetscInt i) {
    const double factor = element_.coupling->factor(values_);
    const auto add = [&](PetscInt j, double weight) {
      for (const Element::Reading& reading : element_.readings)
        a_.add(states_ * j + reading.state, factor * weight * reading.value);
    };
    const CouplingGraph::Row row = graph_.row(i);
    double own = row.ends;
    for (const auto& [neighbour, weight] : row.neighbours) {
      add(neighbour, weight);
      own += weight;
    }
    if (own != 0.0) add(i, -own);
  }

  /// Row of C.
  void add_constraint(PetscInt i) {
    for (const Element::Reading& reading : element_.readings)
      if (exists(i + reading.shift)) c_.add(states_ * (i + reading.shift) + reading.state, reading.value);
    c_.end_row();
    system_.constraint_order.push_back(i);
  }

  void add_forces(PetscInt i) {
    const auto add = [&](int row, const Signal& signal) {
      if (signal.is_zero()) return;
      (signal.varies() ? system_.f.varying : system_.f.constant)
          .push_back({states_ * (i - elements_.first) + row, signal});
    };
    for (const Element::Load& load : element_.loads)
      add(load.row, Signal{load.value(values_)});
    for (std::size_t k = 0; k < element_.forces.size(); ++k)
      add(element_.forces[k].row, spec_.force(k, i).scaled(element_.forces[k].factor(values_)));
  }

  void start(PetscInt i, std::span<double> x) const {
    if (spec_.x0.empty()) {
      if (element_.start) element_.start(place(i), values_, x);
      return;
    }
    for (PetscInt state = 0; state < states_; ++state)
      x[static_cast<std::size_t>(state)] = spec_.x0[static_cast<std::size_t>(scene_number(i, state))];
  }

  MPI_Comm comm_;
  const ChainSpec& spec_;
  const Element& element_;
  PetscInt states_;      // of one element
  LocalRange elements_;  // this rank's
  CouplingGraph graph_;
  std::vector<double> values_;  // of the current element's keys
  LinearSystem system_;
  RowBuilder a_, b_, c_;
};

}  // namespace

LinearSystem make_chain(MPI_Comm comm, const ChainSpec& spec) {
  return ChainBuilder(comm, spec).build();
}

}  // namespace sweepvi
