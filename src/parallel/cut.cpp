#include "parallel/cut.hpp"

#include <numeric>
#include <string>

namespace sweepvi {

Cut cut_graph(Graph& graph, std::vector<idx_t> weights, int parts) {
  idx_t vertices = graph.vertices();
  std::vector<idx_t> part(static_cast<std::size_t>(vertices), 0);
  idx_t cut_edges = 0;
  if (vertices <= parts) {  // a vertex each
    std::iota(part.begin(), part.end(), 0);
    return {{part.begin(), part.end()}, static_cast<PetscInt>(graph.edges())};
  }
  if (parts == 1) return {{part.begin(), part.end()}, 0};
  idx_t balances = 1;
  idx_t part_count = parts;
  idx_t options[METIS_NOPTIONS];
  METIS_SetDefaultOptions(options);
  options[METIS_OPTION_SEED] = 1;
  // Recursive bisection cuts better for few parts; k-way is the one that scales in their number.
  const auto partition = parts <= 8 ? METIS_PartGraphRecursive : METIS_PartGraphKway;
  const int status =
      partition(&vertices, &balances, graph.starts.data(), graph.neighbours.data(), weights.data(), nullptr,
                nullptr, &part_count, nullptr, nullptr, options, &cut_edges, part.data());
  if (status != METIS_OK)
    throw Error(ExitCode::internal, "METIS failed with status " + std::to_string(status));
  return {{part.begin(), part.end()}, static_cast<PetscInt>(cut_edges)};
}

}  // namespace sweepvi
