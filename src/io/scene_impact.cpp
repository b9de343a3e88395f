#include "io/scene_checks.hpp"
#include "io/scene_model.hpp"

namespace sweepvi {

namespace {

double read_kappa(const TomlValue& kappa) {
  const double value = kappa.number();
  if (!(value > 0.0 && value < 1.0))
    kappa.fail(fmt::format("= {}; expected 0 < kappa < 1, as e = (1 - kappa)/(1 + kappa)", value));
  return value;
}

double read_position(const TomlValue& x0) {
  const double value = x0.number();
  if (value < 0.0) x0.fail(fmt::format("= {}; expected 0 or more, as the wall is x = 0", value));
  return value;
}

}  // namespace

ImpactSpec read_impact(const TomlValue& table) {
  const TomlValue kappa = table["kappa"], x0 = table["x0"], v0 = table["v0"], force = table["force"],
                  regulator = table["regulator"], reference = table["reference"],
                  resample = table["resample"];
  table.refuse_unknown();
  ImpactSpec model;
  model.kappa = read_kappa(kappa);
  model.x0 = read_position(x0);
  model.v0 = v0.number();
  model.force = force.signal();
  if (regulator) model.regulator = read_regulator(regulator);
  if (reference) {
    if (!regulator) regulator.fail("is missing; the gains mu1 and mu2 make the plant follow model.reference");
    const TomlValue ref_kappa = reference["kappa"], ref_x0 = reference["x0"], ref_v0 = reference["v0"],
                    ref_force = reference["force"];
    reference.refuse_unknown();
    model.reference = {read_kappa(ref_kappa), read_position(ref_x0), ref_v0.number(), ref_force.signal()};
  }
  model.resample = resample ? resample.boolean() : false;
  return model;
}

Regulator read_regulator(const TomlValue& table) {
  const TomlValue mu1 = table["mu1"], mu2 = table["mu2"];
  table.refuse_unknown();
  for (const TomlValue& gain : {mu1, mu2})
    if (!(gain.number() > 0.0)) gain.fail(fmt::format("= {}; expected more than 0", gain.number()));
  return {mu1.number(), mu2.number()};
}

}  // namespace sweepvi
