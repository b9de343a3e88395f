#pragma once

#include "io/scene.hpp"
#include "io/toml_table.hpp"

namespace sweepvi {

// The table [model], kind by kind; chains have scene_chain.hpp. On ranks other than `root` matrices and
// vectors stay empty. All throw Error (bad_input) on this rank, and none is collective.

LinearSpec read_linear(const TomlValue& table, bool root);
LagrangianSpec read_lagrangian(const TomlValue& table, Scheme scheme, bool root);
SweepingSpec read_sweeping(const TomlValue& table, bool root);
ImpactSpec read_impact(const TomlValue& table);
/// {mu1, mu2}: the gains of a twisting controller.
Regulator read_regulator(const TomlValue& table);

}  // namespace sweepvi
