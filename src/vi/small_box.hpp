#pragma once

#include <cstdint>
#include <type_traits>
#include <vector>

namespace sweepvi {

/// A box VI of a few unknowns, many times with other data: find u in [lower, upper] with F = M u - right in
/// the sense of Dvi. By its active set: u stands at a bound where that is active and F = 0 elsewhere, with
/// the inverse of each set's matrix kept once it was needed.
///
/// What the inverse gives is known relative to the largest number of the block. Where rows read each other
/// along a chain, but for little, as in a step of integrators (I - h A), they can be mended: each summed once
/// more by itself, in the order of that chain, is right to its own terms.
class SmallBox {
public:
  using Mask = std::uint32_t;
  static constexpr int largest = 16;  ///< unknowns

  /// @param matrix  M, row by row
  SmallBox(int size, std::vector<double> matrix);

  int size() const { return size_; }
  const std::vector<double>& matrix() const { return matrix_; }
  /// From a guess, which may be u, and its active set to the solution u.
  /// @param slack  rows that far from a change of set, over their terms, are active (negative: are not)
  /// @return the inverse of the set found, as inverse_of gives it; null where no set was
  const double* solve(const double* right, const double* lower, const double* upper, double slack,
                      const double* guess, double* u, Mask& active);

  /// Whether rows read each other along a chain.
  bool mends() const { return !chain_.empty(); }
  /// Sums inactive rows once more, each by itself, with what the others are by then.
  void mend(const double* right, Mask active, double* u) const;

  /// Of M with identity rows where `active`: column by column, which are `stride` apart; null if it is
  /// singular. Columns of inactive rows hold what F does there, those of active ones what a bound does.
  const double* inverse_of(Mask active);
  int stride() const { return stride_; }

private:
  struct Set {
    Mask active;
    std::vector<double> inverse;
  };
  /// M without its diagonal, row by row in an order in which rows read those before them.
  struct Read {
    int column;
    double value;  // over the diagonal
  };
  struct Row {
    int row, end;  // of what it reads, which begins where that of the row before ends
    double by;     // 1 / diagonal
  };
  void find_chain();
  double mended_error(std::vector<double>& error) const;
  template <int Fixed>
  class Attempt;
  template <int Fixed>
  const double* solve_sized(const double* right, const double* lower, const double* upper, double slack,
                            const double* guess, double* u, Mask& active);

  int size_, stride_;
  std::vector<double> matrix_;   // row by row
  std::vector<double> columns_;  // column by column
  std::vector<double> row_sums_;
  std::vector<Row> chain_;  // empty: rows do not read each other so
  std::vector<Read> reads_;
  std::vector<Set> sets_;
};

/// The rows of a dense matrix in an order in which each finds what it reads there already, where that can be:
/// the next one is one that has all it reads, or else the one that reads most.
std::vector<int> reading_order(const std::vector<double>& matrix, int size);

/// y += factor * column, for sizes of elements in straight code.
inline void add_column(int size, const double* column, double factor, double* y) {
  const auto add = [&](auto count) {
    for (int i = 0; i < count; ++i)
      y[i] += factor * column[i];
  };
  switch (size) {
    case 2:
      return add(std::integral_constant<int, 2>());
    case 4:
      return add(std::integral_constant<int, 4>());
    case 5:
      return add(std::integral_constant<int, 5>());
    default:
      add(size);
  }
}

}  // namespace sweepvi
