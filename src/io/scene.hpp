#pragma once

#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "io/sparse_entries.hpp"
#include "model/chain_spec.hpp"
#include "sweepvi/error.hpp"
#include "sweepvi/regulator.hpp"
#include "sweepvi/scheme.hpp"
#include "sweepvi/signal.hpp"
#include "sweepvi/time_grid.hpp"

namespace sweepvi {

/// `[time]`: K = max(1, round((end - start) / step)) steps of h = (end - start) / K.
struct TimeSpec {
  Scheme scheme = Scheme::homsp;
  double tolerance = 1e-8;              ///< hybrid
  double start = 0.0;                   ///< [s]
  double end = 0.0;                     ///< [s]
  double step = 0.0;                    ///< h [s], already adjusted to hit `end`
  double asked_step = 0.0;              ///< as the scene has it [s]
  std::int64_t unresolved_signals = 0;  ///< whose frequency times h is above 0.1; on every rank
  double fastest_signal = 0.0;          ///< their highest frequency [Hz]
  std::int64_t steps = 0;               ///< K
  double theta = 1.0;  ///< weight of t_{k+1} in state terms, (0, 1]; homsp, moreau-jean, zhuravlev-ivanov
  double gamma = 1.0;  ///< the same of multipliers, (0, 1]; zhuravlev-ivanov
  Detection detection = Detection::predicted;  ///< moreau-jean
  TimeGrid grid() const { return {start, end, static_cast<PetscInt>(steps)}; }
};

/// `kind = "linear"`: x' = A x + B lambda + f, w = C x + D lambda + w0, 0 <= w <= wmax.
/// Matrices and vectors are filled on rank 0 only; elsewhere they are empty.
struct LinearSpec {
  SparseEntries A, B, C;             ///< n x n, n x m, m x n
  std::optional<SparseEntries> D;    ///< m x m
  std::vector<Signal> f;             ///< n, or empty: no forcing
  std::vector<double> w0;            ///< m
  std::vector<double> wmax;          ///< m, or empty: no upper limits
  std::vector<double> x0;            ///< n
  std::vector<int> relative_degree;  ///< m, or one for all, or empty: to be found
};

/// `kind = "lagrangian"`: M q'' + C q' + K q = f + H' lambda, 0 <= g = H q + g0, Newton restitution e.
/// Matrices and vectors are filled on rank 0 only.
struct LagrangianSpec {
  SparseEntries M, K;          ///< n x n
  SparseEntries C;             ///< n x n, the key `Cv`; without rows: none
  SparseEntries H;             ///< m x n
  std::vector<Signal> f;       ///< n, or empty: no forcing
  std::vector<double> g0, e;   ///< m
  std::vector<double> q0, v0;  ///< n
};

/// `kind = "sweeping"`: -u' in N_{K(t)}(u) - f(t) - A u, K(t) = {lower <= u <= upper} or {G u >= g}.
/// Matrices and vectors are filled on rank 0 only; whether there is A or G, every rank knows.
struct SweepingSpec {
  std::vector<double> u0;            ///< n
  std::vector<Signal> f;             ///< n, or empty: none
  std::optional<SparseEntries> A;    ///< n x n
  std::vector<Signal> lower, upper;  ///< n, or empty: no such side
  std::optional<SparseEntries> G;    ///< m x n
  std::vector<Signal> g;             ///< m
};

/// `kind = "zhuravlev-ivanov"`: x'' = force, restitution (1 - kappa) / (1 + kappa) at the wall x = 0.
/// Complete on every rank.
struct ImpactSpec {
  struct Reference {
    double kappa = 0.0, x0 = 0.0, v0 = 0.0;
    Signal force;
  };
  double kappa = 0.0;  ///< in (0, 1)
  double x0 = 0.0;     ///< >= 0
  double v0 = 0.0;     ///< x'
  Signal force;
  std::optional<Regulator> regulator;
  std::optional<Reference> reference;  ///< to be tracked: HO (4)-(8)
  bool resample = false;               ///< (x, x') -> (s, v) anew before each step, HO IV
};

struct OutputSpec {
  std::string file;                                 ///< relative to the working directory
  std::int64_t every = 1;                           ///< record each `every`-th step
  std::optional<std::vector<std::int64_t>> blocks;  ///< record only these elements, ascending
  double checkpoint = 600.0;                        ///< [s] between checkpoints; 0: only when stopped
};

struct Scene {
  std::string path;  ///< as given
  std::string text;  ///< the file's bytes
  std::string title;
  TimeSpec time;
  std::variant<LinearSpec, ChainSpec, LagrangianSpec, SweepingSpec, ImpactSpec> model;
  OutputSpec output;
  std::string petsc_options;       ///< `[petsc] options`
  bool petsc_options_set = false;  ///< they came from --set, which outranks PETSC_OPTIONS
};

/// `--set key=value`: a dotted key and TOML value (a string may go unquoted).
using Overrides = std::vector<std::pair<std::string, std::string>>;

/// Reads and checks a scene.
/// @throws Error (bad_input) on every rank: unknown key (with the nearest known), wrong type, shape or range,
/// missing
///         file, non-finite number, a key or value that is not built yet.
/// @note Collective on `comm`; rank 0 alone touches files.
Scene read_scene(MPI_Comm comm, const std::string& path, const Overrides& overrides);

/// What a scene computes and records, key by key: two scenes that agree in it give the same trajectory, up to
/// what solver options change. Titles, comments and names of outputs do not enter; files do, with all their
/// bytes. On rank 0, empty elsewhere.
/// @throws Error (bad_input) on every rank.  @note Collective on `comm`.
std::map<std::string, std::string> fingerprint(MPI_Comm comm, const Scene& scene, const Overrides& overrides);

/// `sweepvi solve`: find l <= u <= b with F(u) = M u + q complementary to the bounds. Filled on rank 0 only.
struct Problem {
  std::string path, text;
  SparseEntries M;
  std::vector<double> q, lower, upper, u0;  ///< each of length n
  std::vector<double> terms;  ///< that each q was summed from, in absolute values; |q| where they are less
};

/// @throws Error (bad_input) on every rank.  @note Collective on `comm`.
Problem read_problem(MPI_Comm comm, const std::string& path);

}  // namespace sweepvi
