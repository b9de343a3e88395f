// An element of a user's own, of relative degree 5, from its table to a certified run of a scene; and tables
// that make no sense.
#include "sweepvi/element.hpp"
#include "chain/chain_scene.hpp"
#include "sweepvi/partition.hpp"

namespace sweepvi::test {
namespace {

/// A mass on a spring, held off a wall by a hydraulic actuator: lambda moves the valve c, the pressure s
/// follows the valve and the force u the pressure, each with a lag,
///
///     q' = v,  mass v' = u - stiffness q + S(q)_i + force,  lag1 u' = s - u,  lag2 s' = c - s,  c' = lambda,
///     w = q.
Element actuator(const std::string& name) {
  enum { q, v, u, s, c };
  enum { mass, stiffness, lag1, lag2, base };
  const auto per = [](int key, double value) {
    return Coefficient::Formula([=](KeyValues k) { return value / k[static_cast<std::size_t>(key)]; });
  };
  return {.name = name,
          .states = {"q", "v", "u", "s", "c"},
          .keys = {{"mass", 1.0, Element::Range::positive},
                   {"stiffness", 1.0, Element::Range::not_negative},
                   {"lag1", 0.5, Element::Range::positive},
                   {"lag2", 0.25, Element::Range::positive},
                   {"base", 0.1}},
          .terms = {{q, v, 1.0},
                    {v, u, per(mass, 1.0)},
                    {v, q, Coefficient::Formula([](KeyValues k) { return -k[stiffness] / k[mass]; })},
                    {u, s, per(lag1, 1.0)},
                    {u, u, per(lag1, -1.0)},
                    {s, c, per(lag2, 1.0)},
                    {s, s, per(lag2, -1.0)}},
          .coupling = {{v, per(mass, 1.0), 0.5}},
          .readings = {{q}},
          .pushes = {{c, 1.0}},
          .forces = {{"force", -0.5, v, per(mass, 1.0)}},
          .start = [](Element::Place place, KeyValues k, std::span<double> x) {
            x[q] = k[base] * static_cast<double>(place.i + 1);
          }};
}

TEST(Element, OfDegreeFiveRunsFromAScene) {
  register_element(actuator("actuator"));
  Scene scene = chain_scene("element = \"actuator\"\ncount = 4\nlag2 = [0.2, 0.3, 0.4, 0.5]\n");
  LinearSystem system = make_linear_system(PETSC_COMM_WORLD, scene);
  EXPECT_EQ(system.state_names, (std::vector<std::string>{"q", "v", "u", "s", "c"}));
  RelativeDegree degree = analyse_relative_degree(system);
  EXPECT_EQ(degree.lowest, 5);
  EXPECT_EQ(degree.highest, 5);
  for (std::size_t a = 0; a < degree.degree.size(); ++a) {
    const double lag2 = 0.2 + 0.1 * static_cast<double>(system.constraint_order[a]);
    // q^(5) = lambda / (mass lag1 lag2) + ...
    EXPECT_NEAR(degree.markov_diagonal[a], 1.0 / (0.5 * lag2), 1e-13);
  }
  check_markov_matrix(system, degree);
  distribute(system, degree);

  const TimeGrid grid{0.0, 3.0, 300};
  const auto dvi =
      make_linear_dvi(system, degree, Scheme::homsp, choose_form(system, degree, Scheme::homsp), grid);
  TimeMarch march(*dvi, grid);
  PetscInt contacts = 0;
  double penetration = 0.0;
  march.observe([&](const Step&, const StepReport&) {
    contacts += static_cast<PetscInt>(dvi->events().size());
    penetration = std::max(penetration, dvi->penetration());
  });
  EXPECT_TRUE(march.run().certified);
  EXPECT_EQ(march.steps_taken(), 300);
  MPI_Allreduce(MPI_IN_PLACE, &contacts, 1, MPIU_INT, MPI_SUM, PETSC_COMM_WORLD);
  EXPECT_GT(contacts, 0);
  EXPECT_EQ(penetration, 0.0);
}

TEST(Element, KeysAreHeldToTheirRanges) {
  register_element(actuator("strict actuator"));
  const std::string keys = "element = \"strict actuator\"\ncount = 2\n";
  EXPECT_NO_THROW(chain_scene(keys + "stiffness = 0\n"));
  EXPECT_THROW(chain_scene(keys + "stiffness = -1\n"), Error);
  EXPECT_THROW(chain_scene(keys + "lag1 = 0\n"), Error);
  EXPECT_THROW(chain_scene(keys + "lag3 = 1\n"), Error);
}

TEST(Element, TablesThatMakeNoSenseAreRefused) {
  const auto complaint = [](const std::function<void(Element&)>& spoil) -> std::string {
    Element element = actuator("spoilt");
    spoil(element);
    try {
      register_element(std::move(element));
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ExitCode::bad_input);
      return error.what();
    }
    return "";
  };
  const auto expect = [&](const char* fragment, const std::function<void(Element&)>& spoil) {
    const std::string text = complaint(spoil);
    EXPECT_NE(text.find(fragment), std::string::npos) << fragment << ": " << text;
  };
  expect("has no name", [](Element& e) { e.name.clear(); });
  expect("\"jerk\" is registered already", [](Element& e) { e.name = "jerk"; });
  expect("has the key 'mass'", [](Element& e) { e.forces[0].name = "mass"; });
  expect("has the key 'coupling'", [](Element& e) { e.keys[0].name = "coupling"; });
  expect("has a key without a name", [](Element& e) { e.keys[0].name.clear(); });
  expect("names state 5 in the column of a term", [](Element& e) { e.terms[0].column = 5; });
  expect("names state -1 in a push", [](Element& e) { e.pushes[0].state = -1; });
  expect("has no readings", [](Element& e) { e.readings.clear(); });
  expect("has no pushes", [](Element& e) { e.pushes.clear(); });
  expect("takes key 9 as its restitution", [](Element& e) { e.restitution = 9; });
  expect("has a coupling and a w", [](Element& e) { e.readings.push_back({0, -1.0, -1}); });
  EXPECT_EQ(find_element("spoilt"), nullptr);
}

}  // namespace
}  // namespace sweepvi::test
