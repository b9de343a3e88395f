#pragma once

#include <mpi.h>

#include "io/toml_table.hpp"
#include "model/chain_spec.hpp"
#include "sweepvi/linear_dvi.hpp"

namespace sweepvi {

/// The table [model] of `kind = "chain"`. Values kept in files are empty on the other ranks until `share`.
/// @throws Error (bad_input) on this rank. @note Not collective.
ChainSpec read_chain(const TomlValue& table, Scheme scheme, bool root);

/// Completes what only rank 0 read, but for `weights`. @note Collective on `comm`.
void share(MPI_Comm comm, ChainSpec& chain);

}  // namespace sweepvi
