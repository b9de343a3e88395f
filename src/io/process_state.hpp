#pragma once

#include <functional>
#include <string>

#include "io/checkpoint.hpp"
#include "io/dealt.hpp"
#include "sweepvi/dvi.hpp"

namespace sweepvi {

/// Where a process's entities stand in the scene, whatever the ranks.
struct StateOrder {
  Places states, constraints;
};

/// Shows a visitor the state of a process (Dvi::visit).
using ShowState = std::function<void(StateVisitor&)>;

/// Puts the state of a process into a checkpoint, in the scene's order; rank 0's `data` is filled.
/// @param form  what the unknowns are: it may differ where the ranks do
/// @note Collective.
void save_state(MPI_Comm comm, const ShowState& show, const StateOrder& order, const std::string& form,
                CheckpointData& data);

/// Replaces the state of a process: on as many ranks as wrote it, bit for bit.
/// @param data  rank 0's counts
/// @throws Error (bad_input) on every rank if the process has other numbers
/// @note Collective.
void restore_state(MPI_Comm comm, const ShowState& show, const StateOrder& order, const std::string& form,
                   const CheckpointData& data);

}  // namespace sweepvi
