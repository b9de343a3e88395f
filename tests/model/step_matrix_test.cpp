// Masses and step matrices that are no good are refused, with the largest step that works; others are taken.
#include "model/step_matrix.hpp"

#include <gtest/gtest.h>

#include "dvi/systems.hpp"
#include "petsc/sparse.hpp"

namespace sweepvi::test {
namespace {

/// The message of the bad input that `work` must be, on every rank.
template <class Work>
std::string refusal(Work&& work) {
  try {
    work();
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::bad_input) << error.what();
    return error.what();
  }
  ADD_FAILURE() << "accepted";
  return {};
}

/// The number before " s" at the end of a refusal.
double largest_step(const std::string& message) {
  const std::string before = "time.step that works is ";
  const std::size_t at = message.find(before);
  EXPECT_NE(at, std::string::npos) << message;
  return at == std::string::npos ? 0.0 : std::stod(message.substr(at + before.size()));
}

LagrangianSystem system_of(const std::vector<double>& M, const std::vector<double>& K,
                           const std::vector<double>& C = {}) {
  const std::size_t n = M.size() == 1 ? 1 : M.size() == 4 ? 2 : 3;
  std::vector<double> H(n, 0.0);
  H[0] = 1.0;
  return LagrangianSystem::dense(
      PETSC_COMM_WORLD,
      {.M = M, .K = K, .H = H, .q0 = std::vector<double>(n, 1.0), .v0 = std::vector<double>(n, 0.0), .C = C});
}

/// Blocks [0 1; -k_i 0], k_i = stiffness(i).
template <class Stiffness>
Matrix oscillators(PetscInt count, Stiffness&& stiffness) {
  int rank = 0;
  int ranks = 1;
  MPI_Comm_rank(PETSC_COMM_WORLD, &rank);
  MPI_Comm_size(PETSC_COMM_WORLD, &ranks);
  const PetscInt first = count * rank / ranks;
  const PetscInt end = count * (rank + 1) / ranks;
  RowBuilder rows;
  for (PetscInt i = first; i < end; ++i) {
    rows.add(2 * i + 1, 1.0);
    rows.end_row();
    rows.add(2 * i, -stiffness(i));
    rows.end_row();
  }
  return rows.finish(PETSC_COMM_WORLD, 2 * (end - first));
}

TEST(FirstOrderStep, OfALargeSystemIsJudgedByItsEdgeOfTheSpectrum) {
  constexpr PetscInt count = 400;
  // Frequencies up to 20, and one that grows by 30 1/s.
  const Matrix unstable = oscillators(count, [](PetscInt i) { return i == 123 ? -900.0 : double(i + 1); });
  EXPECT_NEAR(largest_step(refusal([&] { check_first_order_step(unstable.get(), 0.05, 1.0, "A"); })),
              1.0 / 30.0, 1e-5);
  EXPECT_NEAR(largest_step(refusal([&] { check_first_order_step(unstable.get(), 0.1, 0.5, "A"); })),
              2.0 / 30.0, 1e-5);
  EXPECT_NE(check_first_order_step(unstable.get(), 0.03, 1.0, "A").find("not known"), std::string::npos);
  // Not dominant, and v' A v <= 2 v' v: definite for all h < 1/2.
  const Matrix stable = oscillators(count, [](PetscInt i) { return 1.0 + 4.0 * double(i) / count; });
  EXPECT_NE(check_first_order_step(stable.get(), 0.4, 1.0, "A").find("symmetric part is definite"),
            std::string::npos);
}

TEST(MassMatrix, HasToBePositiveDefinite) {
  const std::vector<double> K = {1, 0, 0, 1};
  for (const auto& M : {std::vector<double>{1, 1, 1, 1}, {1, 2, 2, 1}, {1e-8, 1e-3, 1e-3, 1}}) {
    const std::string said = refusal([&] { system_of(M, K); });
    EXPECT_NE(said.find("M is not positive definite"), std::string::npos) << said;
    EXPECT_NE(said.find("coordinate"), std::string::npos) << said;
  }
  EXPECT_NO_THROW(system_of({2, 1.9, 1.9, 2}, K));
  EXPECT_NO_THROW(system_of({1e-8, 9e-5, 9e-5, 1}, K));  // units differ; 1 - .81 with a diagonal of ones
  // A full M whose diagonal is positive and whose eigenvalues are 3, 3 and -1.2, say.
  EXPECT_NE(refusal([&] {
              system_of({1, -1.2, 1, -1.2, 1, 1, 1, 1, 1}, {1, 0, 0, 0, 1, 0, 0, 0, 1});
            }).find("M is not positive definite"),
            std::string::npos);
}

TEST(StepMatrix, OfNegativeStiffnessWorksUpToItsStep) {
  // 1 - theta^2 h^2 k > 0.
  constexpr double k = 1e5;
  const LagrangianSystem system = system_of({1.0}, {-k});
  for (const double theta : {0.5, 1.0}) {
    const double edge = 1.0 / (theta * std::sqrt(k));
    const double said = largest_step(refusal([&] { check_step_matrix(system, 1.7 * edge, theta); }));
    EXPECT_LE(said, edge);
    EXPECT_GT(said, (1.0 - 2e-3) * edge);  // four digits, and bisected to 1e-5
    EXPECT_NO_THROW(check_step_matrix(system, said, theta));
    EXPECT_NO_THROW(check_step_matrix(system, 0.999 * edge, theta));
    refusal([&] { check_step_matrix(system, 1.001 * edge, theta); });
  }
}

TEST(StepMatrix, OfNegativeDampingWorksUpToItsStep) {
  // M + theta h C with C = -3 along (1, 1) / sqrt 2: 2 - 3 theta h > 0, with M = 2.
  const LagrangianSystem system = system_of({2, 0, 0, 2}, {0, 0, 0, 0}, {-1.5, -1.5, -1.5, -1.5});
  const double said = largest_step(refusal([&] { check_step_matrix(system, 1.5, 0.5); }));
  EXPECT_NEAR(said, 4.0 / 3.0, 2e-3);
  EXPECT_NO_THROW(check_step_matrix(system, said, 0.5));
}

TEST(StepMatrix, ThatIsNotSymmetricNeedsNoMoreThanItsSymmetricPart) {
  // Follower forces, and a gyroscope: skew parts of any size.
  EXPECT_NO_THROW(check_step_matrix(system_of({1, 0, 0, 1}, {1, 1e6, -1e6, 1}), 0.1, 1.0));
  EXPECT_NO_THROW(check_step_matrix(system_of({1, 0, 0, 1}, {1, 0, 0, 1}, {0, 1e6, -1e6, 0}), 0.1, 1.0));
  // K = [0 a; b 0] with a b > 0 and a + b = 0 cannot be; a = 4, b = 1: det(M + h^2 K) = 1 - 4 h^4.
  const LagrangianSystem system = system_of({1, 0, 0, 1}, {0, 4, 1, 0});
  const double edge = std::sqrt(0.5);
  EXPECT_NO_THROW(
      check_step_matrix(system, 0.98 * edge, 1.0));  // its symmetric part is not definite: 1 - 2.5 h^2
  const double said = largest_step(refusal([&] { check_step_matrix(system, 1.1 * edge, 1.0); }));
  EXPECT_NEAR(said, edge, 2e-3 * edge);
  EXPECT_LE(said, edge);
}

TEST(StepMatrix, OfFirstOrderIsSingularAtARealEigenvalue) {
  const auto check_linear = [](const std::vector<double>& A, double h, double theta) {
    const LinearSystem system =
        LinearSystem::dense(PETSC_COMM_WORLD, {.A = A, .B = {0, 1}, .C = {1, 0}, .x0 = {1, 1}});
    return check_first_order_step(system.A.get(), h, theta, "A");
  };
  // x'' = k x: the eigenvalues are +- sqrt k.
  const std::vector<double> saddle = {0, 1, 1e4, 0};
  EXPECT_NO_THROW(check_linear(saddle, 0.0099, 1.0));
  EXPECT_NO_THROW(check_linear(saddle, 0.0199, 0.5));
  EXPECT_NEAR(largest_step(refusal([&] { check_linear(saddle, 0.0101, 1.0); })), 0.01, 1e-5);
  EXPECT_NEAR(largest_step(refusal([&] { check_linear(saddle, 0.03, 0.5); })), 0.02, 2e-5);
  // Stiff and fast, but stable or rotating: any step will do.
  EXPECT_NO_THROW(check_linear({0, 1, -1e8, 0}, 1.0, 1.0));
  EXPECT_NO_THROW(check_linear({-1e6, 1, 1, -2}, 1.0, 1.0));
  EXPECT_NO_THROW(check_linear({3, 1e4, -1e4, 3}, 1.0, 1.0));  // 3 +- 1e4 i: I - s A has no real zero
}

}  // namespace
}  // namespace sweepvi::test
