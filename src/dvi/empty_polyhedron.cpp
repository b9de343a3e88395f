#include "dvi/empty_polyhedron.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "dvi/saddle.hpp"
#include "parallel/gather.hpp"
#include "vi/proximal_newton.hpp"

namespace sweepvi {

namespace {

constexpr double pull = 1e-8;       // weight of |u - u_before|^2: u need not be unique
constexpr int most_solves = 12;     // each one 1e8 times nearer, unless faces are nearly parallel
constexpr double feasible = 1e-11;  // a violation below this, relative to its terms, proves nothing
constexpr double far_away = 1e4;    // times the size of the data
constexpr double epsilon = std::numeric_limits<double>::epsilon();

double sum_over(MPI_Comm comm, double value) {
  MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_SUM, comm);
  return value;
}

double max_over(MPI_Comm comm, double value) {
  MPI_Allreduce(MPI_IN_PLACE, &value, 1, MPI_DOUBLE, MPI_MAX, comm);
  return value;
}

double norm(Vec vector, NormType type) {
  PetscReal result = 0.0;
  check(VecNorm(vector, type, &result));
  return result;
}

/// The search for y, and what it proves.
class Search {
public:
  Search(Mat G, Vec g, Vec g_terms, Vec near)
      : comm_(PetscObjectComm(reinterpret_cast<PetscObject>(G))),
        G_(G),
        g_(g),
        g_terms_(g_terms),
        abs_G_(absolute_copy(G)),
        S_(saddle_matrix(scaled_identity(near, pull).get(), G)),
        abs_S_(absolute_copy(S_.get())),
        u_(duplicate(near)),
        pulled_(duplicate(near)),
        y_(duplicate(g)),
        w_(duplicate(g)) {
    check(VecCopy(near, u_.get()));
    near_ = norm(near, NORM_INFINITY);
    for_each_row(G, [&](PetscInt, auto, auto values) {
      double square = 0.0;
      for (const double value : values)
        square += value * value;
      norms_.push_back(std::sqrt(square));
    });
    check(MatCreateVecs(S_.get(), x_.put(), nullptr));
    rhs_ = duplicate(x_.get());
    rhs_terms_ = duplicate(x_.get());
    check(VecSet(x_.get(), 0.0));
    const ReadArray values(u_.get());
    components_ = values.size();
    const WriteArray start(x_.get());
    std::copy_n(values.data(), components_, start.data());
  }

  /// Whether y proves that there is no point.
  bool proves() {
    ProximalNewton newton({S_.get(), abs_S_.get(), rhs_.get(), rhs_terms_.get(), components_});
    for (int solve = 0; solve < most_solves; ++solve) {
      set_right_side();
      const bool solved = newton.solve_regularised(x_.get(), 1.0);
      take();
      if (violation() <= feasible) return false;
      if (certified()) return true;
      if (!solved) return false;
    }
    return false;
  }

  /// y_i |G_i| of this rank's faces.
  std::vector<double> weights() const {
    const ReadArray y(y_.get());
    std::vector<double> result;
    result.reserve(norms_.size());
    for (PetscInt a = 0; a < y.size(); ++a)
      result.push_back(y[a] * norms_[static_cast<std::size_t>(a)]);
    return result;
  }
  double gain() const {
    PetscScalar product = 0.0;
    check(VecDot(g_, y_.get(), &product));
    return product;
  }

private:
  void set_right_side() {
    const ReadArray u(u_.get());
    const ReadArray g(g_);
    const WriteArray right(rhs_.get());
    const WriteArray terms(rhs_terms_.get());
    for (PetscInt i = 0; i < components_; ++i)
      right[i] = pull * u[i];
    for (PetscInt i = 0; i < components_; ++i)
      terms[i] = std::abs(right[i]);
    const ReadArray g_terms(g_terms_);
    for (PetscInt a = 0; a < g.size(); ++a) {
      right[components_ + a] = g[a];
      terms[components_ + a] = g_terms[a];
    }
  }

  void take() {
    const ReadArray x(x_.get());
    const WriteArray u(u_.get());
    const WriteArray y(y_.get());
    for (PetscInt i = 0; i < components_; ++i)
      u[i] = x[i];
    for (PetscInt a = 0; a < y.size(); ++a)
      y[a] = std::max(0.0, x[components_ + a]);
  }

  // The worst g_i - G_i u over its terms.
  double violation() {
    check(MatMult(G_, u_.get(), w_.get()));
    check(VecCopy(u_.get(), pulled_.get()));
    check(VecAbs(pulled_.get()));
    Vector terms = duplicate(w_.get());
    check(MatMult(abs_G_.get(), pulled_.get(), terms.get()));
    double worst = 0.0;
    {
      const ReadArray w(w_.get());
      const ReadArray g(g_);
      const ReadArray size(terms.get());
      const ReadArray g_terms(g_terms_);
      for (PetscInt a = 0; a < g.size(); ++a)
        if (g[a] > w[a]) worst = std::max(worst, (g[a] - w[a]) / (size[a] + g_terms[a]));
    }
    return max_over(comm_, worst);
  }

  // Every point u of the set has (G' y)' u >= g' y.
  bool certified() {
    double gain = 0.0;
    double size = 0.0;
    double farthest = 0.0;  // of the faces in question from the origin
    {
      const ReadArray y(y_.get());
      const ReadArray g(g_);
      const ReadArray g_terms(g_terms_);
      for (PetscInt a = 0; a < g.size(); ++a) {
        gain += g[a] * y[a];
        size += g_terms[a] * y[a];
        if (y[a] > 0.0) farthest = std::max(farthest, std::abs(g[a]) / norms_[static_cast<std::size_t>(a)]);
      }
    }
    gain = sum_over(comm_, gain) - rounding * sum_over(comm_, size);
    farthest = max_over(comm_, farthest);
    check(MatMultTranspose(G_, y_.get(), pulled_.get()));
    const double left = norm(pulled_.get(), NORM_1);
    check(MatMultTranspose(abs_G_.get(), y_.get(), pulled_.get()));
    const double unknown = left + epsilon * norm(pulled_.get(), NORM_1);
    return gain > far_away * unknown * (near_ + norm(u_.get(), NORM_INFINITY) + farthest);
  }

  MPI_Comm comm_;
  Mat G_;
  Vec g_, g_terms_;
  Matrix abs_G_, S_, abs_S_;
  Vector u_, pulled_, y_, w_, x_, rhs_, rhs_terms_;
  PetscInt components_ = 0;
  double near_ = 0.0;
  std::vector<double> norms_;  // |G_i| of this rank's faces
};

}  // namespace

std::string Contradiction::text() const {
  constexpr std::size_t most = 8;
  const std::size_t named = std::min(most, faces.size());
  const std::string more = faces.size() > named ? fmt::format(" and {} more", faces.size() - named) : "";
  const auto last = faces.begin() + static_cast<std::ptrdiff_t>(named);
  return fmt::format("face{} {}{} exclude{} every point, by {:.6g} at least", faces.size() == 1 ? "" : "s",
                     fmt::join(faces.begin(), last, ", "), more, faces.size() == 1 ? "s" : "", gap);
}

std::optional<Contradiction> find_contradiction(Mat G, Vec g, Vec g_terms, Vec near,
                                                const std::vector<PetscInt>& face_order) {
  Search search(G, g, g_terms, near);
  if (!search.proves()) return std::nullopt;
  const MPI_Comm comm = PetscObjectComm(reinterpret_cast<PetscObject>(G));
  const std::vector<double> weight = search.weights();
  double total = 0.0;
  double largest = 0.0;
  for (const double value : weight) {
    total += value;
    largest = std::max(largest, value);
  }
  largest = max_over(comm, largest);
  total = sum_over(comm, total);
  Contradiction found;
  found.gap = search.gain() / total;
  for (std::size_t a = 0; a < weight.size(); ++a)
    if (weight[a] > 1e-6 * largest) found.faces.push_back(face_order[a]);  // the rest is rounding
  found.faces = gather(comm, found.faces);
  broadcast(comm, found.faces);
  std::sort(found.faces.begin(), found.faces.end());
  return found;
}

}  // namespace sweepvi
