#include "sweepvi/scheme.hpp"

#include <string>

#include "sweepvi/error.hpp"

namespace sweepvi {

const char* name_of(Scheme scheme) {
  switch (scheme) {
    case Scheme::homsp:
      return "homsp";
    case Scheme::zd_euler:
      return "zd-euler";
    case Scheme::naive_euler:
      return "naive-euler";
    case Scheme::catching_up:
      return "catching-up";
    case Scheme::moreau_jean:
      return "moreau-jean";
    case Scheme::hybrid:
      return "hybrid";
    case Scheme::zhuravlev_ivanov:
      return "zhuravlev-ivanov";
  }
  return "";
}

const char* name_of(Detection detection) {
  switch (detection) {
    case Detection::predicted:
      return "predicted";
    case Detection::midpoint:
      return "midpoint";
    case Detection::current:
      return "current";
  }
  return "";
}

void require_weight(const char* name, double weight) {
  if (!(weight > 0.0 && weight <= 1.0))
    throw InputError(std::string(name) + " is " + std::to_string(weight) +
                     "; expected more than 0, at most 1");
}

}  // namespace sweepvi
