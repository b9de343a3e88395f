#pragma once

#include <mpi.h>

#include "io/toml_table.hpp"
#include "model/chain_spec.hpp"
#include "sweepvi/scheme.hpp"

namespace sweepvi {

/// The schemes that its element can be run with, the first where the scene says nothing.
/// @throws Error (bad_input) on this rank. @note Not collective.
std::vector<Scheme> chain_schemes(const TomlValue& table);

/// The table [model] of `kind = "chain"`. Values kept in files are empty on the other ranks until `share`.
/// @throws Error (bad_input) on this rank. @note Not collective.
ChainSpec read_chain(const TomlValue& table, Scheme scheme, bool root);

/// Completes what only rank 0 read, but for `weights`. @note Collective on `comm`.
void share(MPI_Comm comm, ChainSpec& chain);

}  // namespace sweepvi
