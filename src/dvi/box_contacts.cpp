#include "dvi/box_contacts.hpp"

#include <algorithm>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

bool all_the_same(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [&](double value) { return value == values.front(); });
}

}  // namespace

void BoxContacts::start(Mat H, Vec g0) {
  {
    const ReadArray offset(g0);
    offset_.assign(offset.data(), offset.data() + offset.size());
  }
  const LocalRange coordinates = column_range(H);
  for_each_row(H, [&](PetscInt, auto columns, auto values) {
    for (std::size_t k = 0; k < columns.size(); ++k) {
      if (values[k] == 0.0) continue;
      place_.push_back(columns[k] - coordinates.first);
      weight_.push_back(values[k]);
    }
  });
  for (std::size_t a = 0; a < place_.size(); ++a) {
    if (a == 0 || place_[a] != place_[a - 1] + 1) runs_.push_back({static_cast<std::int32_t>(a), 0});
    ++runs_.back().count;
  }
  bound_.assign(place_.size(), 0.0);
  held_terms_.assign(place_.size(), 0.0);
  changed_.assign(place_.size(), 0);
  same_e_ = all_the_same(contacts_->e);
  same_weight_ = all_the_same(weight_);
  same_offset_ = all_the_same(offset_);
}

// Calls visit(constraints side by side, the first one's coordinate).
template <class Visit>
void BoxContacts::each_run(Visit&& visit) {
  ContactState& contacts = *contacts_;
  for (const auto& [first, count] : runs_) {
    const auto a = static_cast<std::size_t>(first);
    visit(ContactRun{.count = count,
                     .first = first,
                     .gap = contacts.gap.data() + a,
                     .velocity = contacts.velocity.data() + a,
                     .e = contacts.e.data() + (same_e_ ? 0 : a),
                     .same_e = same_e_,
                     .level = contacts.level.data() + a,
                     .side = reinterpret_cast<signed char*>(contacts.side.data() + a),
                     .contact = contacts.contact.data() + a,
                     .mu = contacts.mu.data() + 2 * a,
                     .weight = weight_.data() + (same_weight_ ? 0 : a),
                     .same_weight = same_weight_,
                     .offset = offset_.data() + (same_offset_ ? 0 : a),
                     .same_offset = same_offset_,
                     .bound = bound_.data() + a,
                     .held_terms = held_terms_.data() + a},
          place_[a]);
  }
}

void BoxContacts::begin(Vec lower, Vec upper, double h, Detection detection) {
  if (!(VectorValue(lower) == lower_ && VectorValue(upper) == upper_)) {
    check(VecSet(lower, PETSC_NINFINITY));
    check(VecSet(upper, PETSC_INFINITY));
  }
  contacts_->events.clear();
  {
    const WriteArray l(lower);
    const WriteArray b(upper);
    ContactDetection with{.ahead = reach_of(detection) * h,
                          .strict = detection == Detection::current,
                          .afresh = !has_levels_,
                          .no_bound = PETSC_INFINITY};
    each_run([&](const ContactRun& run, PetscInt place) {
      with.lower = l.data() + place;
      with.upper = b.data() + place;
      contact_kernels().detect(run, with);
    });
  }
  has_levels_ = true;
  lower_ = VectorValue(lower);
  upper_ = VectorValue(upper);
}

bool BoxContacts::settle(Vec u, Vec terms) {
  const ReadArray sizes(terms);
  const WriteArray values(u);
  ContactSettling settling{.near = held_rtol};
  each_run([&](const ContactRun& run, PetscInt place) {
    settling.u = values.data() + place;
    settling.terms = sizes.data() + place;
    contact_kernels().settle(run, settling);
  });
  return settling.moved;
}

void BoxContacts::take(Vec u, Vec f, Vec q, Vec scale, double h, double theta, Energy& lost) {
  const ReadArray values(u);
  const ReadArray residual(f);
  const ReadArray positions(q);
  const ReadArray scales(scale);
  ContactMotion motion{.h = h, .theta = theta, .noise = held_rtol};
  motion.changed = changed_.data();
  each_run([&](const ContactRun& run, PetscInt place) {
    motion.u = values.data() + place;
    motion.f = residual.data() + place;
    motion.q = positions.data() + place;
    motion.scale = scales.data() + place;
    contact_kernels().move(run, motion);
  });
  lost.dissipated -= motion.dissipated;
  lost.scheme -= motion.scheme;
  contacts_->deepest = motion.deepest;
  contacts_->fastest = motion.fastest;
  contacts_->change_contacts({changed_.data(), motion.changed});
}

}  // namespace sweepvi
