#pragma once

#include <algorithm>
#include <span>
#include <vector>

#include "sweepvi/petsc.hpp"

namespace sweepvi {

/// What numbers of a process's state belong to: where they go when a run goes on with its parts dealt out to
/// other ranks.
enum class Belongs {
  state,       ///< one entity for each state (coordinate, component) that the rank owns
  constraint,  ///< one entity for each constraint (face, oscillator) that the rank owns
  rank         ///< sums over what the rank owns; dealt out anew, rank 0 takes the sum of all
};

/// Goes through the numbers that the later steps of a process depend on, and either takes or replaces them
/// (Dvi::visit). The same visits, in the same order, whatever the ranks.
class StateVisitor {
public:
  StateVisitor() = default;
  StateVisitor(const StateVisitor&) = delete;
  StateVisitor& operator=(const StateVisitor&) = delete;
  virtual ~StateVisitor() = default;

  /// Whether the numbers are being replaced: the process then forgets what it derived from the old ones.
  virtual bool replaces() const = 0;
  /// `values`: this rank's entities, `width` numbers each. @note Collective.
  virtual void visit(const char* name, Belongs to, std::span<double> values, std::size_t width) = 0;

  void visit(const char* name, Belongs to, Vec values, std::size_t width = 1) {
    const WriteArray array(values);
    visit(name, to, std::span<double>(array.data(), static_cast<std::size_t>(array.size())), width);
  }
  void visit(const char* name, Belongs to, std::vector<double>& values, std::size_t width = 1) {
    visit(name, to, std::span<double>(values), width);
  }
  /// Small integers, flags, sides.
  template <class Small>
  void visit(const char* name, Belongs to, std::vector<Small>& values, std::size_t width = 1) {
    std::vector<double> numbers(values.size());
    std::transform(values.begin(), values.end(), numbers.begin(),
                   [](Small value) { return static_cast<double>(value); });
    visit(name, to, std::span<double>(numbers), width);
    std::transform(numbers.begin(), numbers.end(), values.begin(),
                   [](double number) { return static_cast<Small>(static_cast<int>(number)); });
  }
};

/// The state of a process at one moment, in memory: to come back to it.
class StateSnapshot {
public:
  /// Takes what `process` knows. @note Collective, like `put_back`.
  template <class Process>
  void take(Process& process) {
    numbers_.clear();
    Copy copy(numbers_, false);
    process.visit(copy);
  }
  template <class Process>
  void put_back(Process& process) {
    Copy copy(numbers_, true);
    process.visit(copy);
  }

private:
  class Copy final : public StateVisitor {
  public:
    Copy(std::vector<double>& numbers, bool back) : numbers_(numbers), back_(back) {}
    using StateVisitor::visit;
    bool replaces() const override { return back_; }
    void visit(const char*, Belongs, std::span<double> values, std::size_t) override {
      if (!back_) {
        numbers_.insert(numbers_.end(), values.begin(), values.end());
        return;
      }
      std::copy_n(numbers_.begin() + static_cast<std::ptrdiff_t>(next_), values.size(), values.begin());
      next_ += values.size();
    }

  private:
    std::vector<double>& numbers_;
    bool back_;
    std::size_t next_ = 0;
  };

  std::vector<double> numbers_;
};

}  // namespace sweepvi
