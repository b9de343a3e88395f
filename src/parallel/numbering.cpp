#include "parallel/numbering.hpp"

#include <algorithm>
#include <numeric>
#include <string>
#include <utility>

#include "petsc/sparse.hpp"

namespace sweepvi {

namespace {

constexpr idx_t none = -1;

std::size_t at(idx_t i) {
  return static_cast<std::size_t>(i);
}

std::vector<idx_t> as_given(idx_t vertices) {
  std::vector<idx_t> order(at(vertices));
  std::iota(order.begin(), order.end(), 0);
  return order;
}

std::vector<idx_t> inverse(const std::vector<idx_t>& order) {
  std::vector<idx_t> position(order.size());
  for (std::size_t k = 0; k < order.size(); ++k)
    position[at(order[k])] = static_cast<idx_t>(k);
  return position;
}

/// The elimination tree: parent of each column, the number of columns for a root. J. W. H. Liu's algorithm:
/// paths to the current root are compressed as they are walked.
std::vector<idx_t> elimination_tree(const Graph& graph, const std::vector<idx_t>& order,
                                    const std::vector<idx_t>& position) {
  const idx_t count = graph.vertices();
  std::vector<idx_t> parent(at(count), count);
  std::vector<idx_t> ancestor(at(count), none);
  for (idx_t row = 0; row < count; ++row)
    for (const idx_t neighbour : graph.of(order[at(row)])) {
      idx_t column = position[at(neighbour)];
      while (column < row) {
        const idx_t next = std::exchange(ancestor[at(column)], row);
        if (next == none) parent[at(column)] = row;
        column = next == none ? row : next;
      }
    }
  return parent;
}

/// Depth and postorder of a tree whose parents come after their children.
struct Postorder {
  std::vector<idx_t> depth;
  std::vector<idx_t> label;  // place in the postorder
  std::vector<idx_t> first;  // smallest label in the subtree
};

Postorder postorder(const std::vector<idx_t>& parent) {
  const auto count = static_cast<idx_t>(parent.size());
  std::vector<idx_t> size(parent.size() + 1, 1);
  for (idx_t j = 0; j < count; ++j)
    size[at(parent[at(j)])] += size[at(j)];
  // A subtree takes the labels below `end` of its parent that its later siblings have left.
  Postorder tree{std::vector<idx_t>(parent.size() + 1, 0), std::vector<idx_t>(parent.size()),
                 std::vector<idx_t>(parent.size())};
  std::vector<idx_t> end(parent.size() + 1, count);
  for (idx_t j = count - 1; j >= 0; --j) {
    const std::size_t above = at(parent[at(j)]);
    tree.depth[at(j)] = tree.depth[above] + 1;
    tree.label[at(j)] = end[above] - 1;
    tree.first[at(j)] = end[above] - size[at(j)];
    end[at(j)] = tree.label[at(j)];
    end[above] -= size[at(j)];
  }
  return tree;
}

idx_t find_root(std::vector<idx_t>& ancestor, idx_t j) {
  while (ancestor[at(j)] != j)
    j = ancestor[at(j)] = ancestor[at(ancestor[at(j)])];
  return j;
}

std::vector<idx_t> reverse_cuthill_mckee(const Graph& graph) {
  const PetscInt count = graph.vertices();
  std::vector<PetscInt> starts(graph.starts.begin(), graph.starts.end());
  std::vector<PetscInt> columns(graph.neighbours.begin(), graph.neighbours.end());
  std::vector<PetscScalar> values(columns.size(), 0.0);
  Matrix pattern;
  check(MatCreateSeqAIJWithArrays(PETSC_COMM_SELF, count, count, starts.data(), columns.data(), values.data(),
                                  pattern.put()));
  IndexSet rows;
  IndexSet same;
  check(MatGetOrdering(pattern.get(), MATORDERINGRCM, rows.put(), same.put()));
  const PetscInt* first = nullptr;
  check(ISGetIndices(rows.get(), &first));
  std::vector<idx_t> order(first, first + count);
  check(ISRestoreIndices(rows.get(), &first));
  return order;
}

std::vector<idx_t> nested_dissection(Graph& graph) {
  idx_t count = graph.vertices();
  std::vector<idx_t> order(at(count));
  std::vector<idx_t> position(at(count));
  idx_t options[METIS_NOPTIONS];
  METIS_SetDefaultOptions(options);
  options[METIS_OPTION_SEED] = 1;  // the same order every time
  const int status = METIS_NodeND(&count, graph.starts.data(), graph.neighbours.data(), nullptr, options,
                                  order.data(), position.data());
  if (status != METIS_OK)
    throw Error(ExitCode::internal, "METIS failed with status " + std::to_string(status));
  return order;
}

}  // namespace

// Row i of the factor is the part of the elimination tree between i and those leaves that are neighbours of i
// (its row subtree). Leaves come in postorder; each adds its path up to where it joins the one before.
std::int64_t factor_nonzeros(const Graph& graph, const std::vector<idx_t>& order) {
  const std::vector<idx_t> position = inverse(order);
  const std::vector<idx_t> parent = elimination_tree(graph, order, position);
  const Postorder tree = postorder(parent);
  std::vector<idx_t> ancestor = as_given(graph.vertices() + 1);
  std::vector<idx_t> last_leaf(order.size(), none);
  std::int64_t count = 0;
  for (const idx_t column : inverse(tree.label)) {
    for (const idx_t neighbour : graph.of(order[at(column)])) {
      const idx_t row = position[at(neighbour)];
      if (row < column) continue;
      idx_t& last = last_leaf[at(row)];
      const bool is_leaf = last == none || tree.label[at(last)] < tree.first[at(column)];
      if (!is_leaf) continue;
      const idx_t joined = last == none ? row : find_root(ancestor, last);
      count += tree.depth[at(column)] - tree.depth[at(joined)];
      last = column;
    }
    ancestor[at(column)] = parent[at(column)];
  }
  return count;
}

std::vector<idx_t> low_fill_order(Graph& graph) {
  std::vector<idx_t> best = as_given(graph.vertices());
  std::int64_t least = factor_nonzeros(graph, best);
  const auto consider = [&](std::vector<idx_t> order) {
    const std::int64_t nonzeros = factor_nonzeros(graph, order);
    if (nonzeros >= least) return;
    least = nonzeros;
    best = std::move(order);
  };
  if (least > graph.edges()) consider(reverse_cuthill_mckee(graph));
  // The dearest of the three: not where it could save less than half, as in a ring.
  if (least > 2 * graph.edges()) consider(nested_dissection(graph));
  return best;
}

}  // namespace sweepvi
