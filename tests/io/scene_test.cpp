#include "io/scene.hpp"

#include <gtest/gtest.h>
#include <mpi.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <limits>

// Scenes are text in, values or a complaint out, at every number of ranks; files exist for rank 0 only, as on
// a cluster without a shared disk.

namespace sweepvi {
namespace {

namespace fs = std::filesystem;
constexpr double infinity = std::numeric_limits<double>::infinity();

bool is_root() {
  int rank = 0;
  MPI_Comm_rank(MPI_COMM_WORLD, &rank);
  return rank == 0;
}

/// A folder that rank 0 alone has, gone afterwards.
class SceneTest : public testing::Test {
protected:
  void SetUp() override {
    std::string name = (fs::temp_directory_path() / "sweepvi_scene_XXXXXX").string();
    if (is_root() && mkdtemp(name.data()) == nullptr) name[0] = '\0';
    MPI_Bcast(name.data(), static_cast<int>(name.size()), MPI_CHAR, 0, MPI_COMM_WORLD);
    ASSERT_NE(name[0], '\0');
    folder_ = name;
  }
  void TearDown() override {
    if (is_root()) fs::remove_all(folder_);
  }

  std::string write(const std::string& name, const std::string& text) const {
    if (is_root()) std::ofstream(folder_ / name) << text;
    return (folder_ / name).string();
  }
  Scene read(const std::string& text, const Overrides& overrides = {}) const {
    return read_scene(MPI_COMM_WORLD, write("scene.toml", text), overrides);
  }
  Problem read_one(const std::string& text) const {
    return read_problem(MPI_COMM_WORLD, write("problem.toml", text));
  }
  /// The complaint, without the folder.
  template <class Work>
  std::string complaint(Work&& work) const {
    try {
      work();
    } catch (const Error& error) {
      EXPECT_EQ(error.code(), ExitCode::bad_input) << error.what();
      std::string text = error.what();
      const std::string prefix = folder_.string() + "/";
      for (auto at = text.find(prefix); at != std::string::npos; at = text.find(prefix))
        text.erase(at, prefix.size());
      return text;
    }
    return "none";
  }
  void expect_complaint(const std::string& text, const Overrides& overrides,
                        const std::string& fragment) const {
    const std::string said = complaint([&] { read(text, overrides); });
    EXPECT_NE(said.find(fragment), std::string::npos) << text << "\nsays: " << said << "\nnot:  " << fragment;
  }

  fs::path folder_;
};

const std::string times = "[time]\nend = 1\nstep = 0.1\n";  // lines 1-3
const std::string ball =                                    // lines 4-8
    "[model]\nkind = \"linear\"\nA = [[0, 1], [0, 0]]\nB = [[0], [1]]\nC = [[1, 0]]\n";
const std::string start = "x0 = [1, -2.5]\n";  // line 9
const std::string linear = times + ball + start;
const std::string chain = times + "[model]\nkind = \"chain\"\nelement = \"jerk\"\n";  // lines 4-6

TEST_F(SceneTest, LinearSceneIsKeptOnRankZero) {
  const std::string text = "title = \"ball\"\n" + linear +
                           "f = [0, {offset = -9.81, amplitude = 2, frequency = 3}]\n" +
                           "w0 = [0.5]\nwmax = inf\nD = [[2]]\n[petsc]\noptions = \"-pc_type lu\"\n";
  const Scene scene = read(text);
  EXPECT_EQ(scene.text, text);
  EXPECT_EQ(scene.title, "ball");
  EXPECT_EQ(scene.petsc_options, "-pc_type lu");
  EXPECT_FALSE(scene.petsc_options_set);
  EXPECT_EQ(scene.time.scheme, Scheme::homsp);
  EXPECT_EQ(scene.output.file, "scene.h5");
  EXPECT_EQ(scene.output.every, 1);
  EXPECT_FALSE(scene.output.blocks);
  const auto& model = std::get<LinearSpec>(scene.model);
  ASSERT_TRUE(model.D);
  if (!is_root()) {
    EXPECT_TRUE(model.A.values.empty() && model.x0.empty() && model.f.empty() && model.w0.empty());
    return;
  }
  EXPECT_EQ(model.A.rows, 2);
  EXPECT_EQ(model.A.cols, 2);
  ASSERT_EQ(model.A.values.size(), 1U);  // zeros are no entries
  EXPECT_EQ(model.A.columns[0], 1);
  EXPECT_EQ(model.A.values[0], 1.0);
  EXPECT_EQ(model.A.row_starts.size(), 3U);
  EXPECT_EQ(model.B.rows, 2);
  EXPECT_EQ(model.B.cols, 1);
  EXPECT_EQ(model.D->values, std::vector<double>{2.0});
  EXPECT_EQ(model.x0, (std::vector<double>{1.0, -2.5}));
  EXPECT_EQ(model.w0, std::vector<double>{0.5});
  ASSERT_EQ(model.f.size(), 2U);
  EXPECT_TRUE(model.f[0].is_zero());
  EXPECT_EQ(model.f[1].offset, -9.81);
  EXPECT_EQ(model.f[1].frequency, 3.0);
}

TEST_F(SceneTest, UpperLimitsAreKeptUnlessAllAreInfinite) {
  struct Case {
    const char* value;
    std::vector<double> expected;
  };
  const Case cases[] = {{"inf", {}},      {"[inf]", {}}, {"3", {3.0}},
                        {"[2.5]", {2.5}}, {"+inf", {}},  {"1e-300", {1e-300}}};
  for (const Case& c : cases) {
    const Scene scene = read(linear + "wmax = " + c.value + "\n");
    const auto& model = std::get<LinearSpec>(scene.model);
    EXPECT_EQ(model.wmax, is_root() ? c.expected : std::vector<double>{}) << c.value;
  }
  EXPECT_TRUE(std::get<LinearSpec>(read(linear).model).wmax.empty());
  // A number is for all constraints, a list for each.
  const std::string two = times + "[model]\nkind = \"linear\"\nA = [[0, 1], [0, 0]]\nB = [[0, 1], [1, 0]]\n" +
                          "C = [[1, 0], [0, 1]]\n" + start;
  const double inf = std::numeric_limits<double>::infinity();
  const Case pairs[] = {{"4", {4.0, 4.0}}, {"[inf, 4]", {inf, 4.0}}, {"[inf, inf]", {}}};
  for (const Case& c : pairs) {
    const Scene scene = read(two + "wmax = " + c.value + "\n");
    EXPECT_EQ(std::get<LinearSpec>(scene.model).wmax, is_root() ? c.expected : std::vector<double>{})
        << c.value;
  }
}

TEST_F(SceneTest, StepsHitTheEnd) {
  struct Case {
    const char *start, *end, *step;
    std::int64_t steps;
  };
  // 1 / 0.3 = 3.33 rounds to 3, 1 / 0.28 = 3.57 to 4; a step longer than the run is one step.
  const Case cases[] = {
      {"0", "1", "0.3", 3}, {"0", "1", "0.28", 4}, {"0", "1", "5", 1}, {"-1", "2.5", "1e-1", 35}};
  for (const Case& c : cases) {
    const TimeSpec time =
        read(linear, {{"time.start", c.start}, {"time.end", c.end}, {"time.step", c.step}}).time;
    EXPECT_EQ(time.steps, c.steps);
    EXPECT_EQ(time.start, std::atof(c.start));
    EXPECT_EQ(time.grid().time(time.grid().steps), std::atof(c.end));
    EXPECT_DOUBLE_EQ(time.step * static_cast<double>(time.steps), std::atof(c.end) - std::atof(c.start));
  }
}

TEST_F(SceneTest, OverridesWin) {
  const Scene scene = read(linear, {{"time.scheme", "zd-euler"},
                                    {"time.theta", "1"},
                                    {"title", "two words # and more"},
                                    {"output.file", "o.h5"},
                                    {"output.every", "1e1"},
                                    {"petsc.options", "-log_view"},
                                    {"model.x0", "[3, 4]"}});
  EXPECT_EQ(scene.time.scheme, Scheme::zd_euler);
  EXPECT_EQ(scene.title, "two words # and more");
  EXPECT_EQ(scene.output.file, "o.h5");  // from the command line: relative to the working directory
  EXPECT_EQ(scene.output.every, 10);
  EXPECT_EQ(scene.petsc_options, "-log_view");
  EXPECT_TRUE(scene.petsc_options_set);
  if (is_root()) {
    EXPECT_EQ(std::get<LinearSpec>(scene.model).x0, (std::vector<double>{3.0, 4.0}));
  }
  EXPECT_EQ(read(linear + "[output]\nfile = \"o.h5\"\n").output.file, (folder_ / "o.h5").string());
  // Two values in one word are not TOML for one key, so it is a string.
  EXPECT_EQ(read(linear, {{"title", "1\nx = 2"}}).title, "1\nx = 2");
}

TEST_F(SceneTest, MatricesComeFromFilesBesideTheScene) {
  write("A.mtx", "%%MatrixMarket matrix array real general\n2 2\n0\n0\n1\n0\n");
  write("x0.mtx", "%%MatrixMarket matrix array real general\n2 1\n1\n-2\n");
  const Scene scene = read(linear, {});
  const Scene filed =
      read(times + "[model]\nkind=\"linear\"\nA=\"A.mtx\"\nB=[[0],[1]]\nC=[[1,0]]\nx0=\"x0.mtx\"\n");
  const auto& inline_model = std::get<LinearSpec>(scene.model);
  const auto& model = std::get<LinearSpec>(filed.model);
  EXPECT_EQ(model.A.values, inline_model.A.values);
  EXPECT_EQ(model.A.columns, inline_model.A.columns);
  if (is_root()) {
    EXPECT_EQ(model.x0, (std::vector<double>{1.0, -2.0}));
  }
}

TEST_F(SceneTest, ChainIsCompleteOnEveryRank) {
  write("a2.mtx", "%%MatrixMarket matrix array real general\n4 1\n1\n2\n3\n4\n");
  const Scene scene = read(chain +
                           "count = 4\ntopology = \"ring\"\ncoupling = 2\na1 = -3\na2 = \"a2.mtx\"\n"
                           "force = [1, 2, {amplitude = 1, frequency = 2, phase = 0.5}, 4]\n"
                           "x0 = [1,2,3,4,5,6,7,8,9,10,11,12,13,14,15,16,17,18,19,20]\n"
                           "[output]\nblocks = [3, 1]\nevery = 5\ncheckpoint = 0\n");
  const auto& model = std::get<ChainSpec>(scene.model);
  EXPECT_EQ(model.count, 4);
  EXPECT_EQ(model.element, find_element("jerk"));
  EXPECT_EQ(model.topology, Topology::ring);
  EXPECT_EQ(model.coupling, 2.0);
  ASSERT_EQ(model.keys.size(), 5U);  // a1 a2 a3 base spread
  EXPECT_EQ(model.keys[0][3], -3.0);
  EXPECT_EQ(model.keys[1].values, (std::vector<double>{1, 2, 3, 4}));
  EXPECT_EQ(model.keys[2][2], -1.0);
  EXPECT_EQ(model.keys[3][0], 0.2);
  EXPECT_EQ(model.keys[4][0], 0.8);
  ASSERT_EQ(model.forces.size(), 1U);
  EXPECT_EQ(model.forces[0][1].offset, 2.0);
  EXPECT_EQ(model.forces[0][2].phase, 0.5);
  ASSERT_EQ(model.x0.size(), 20U);
  EXPECT_EQ(model.x0[19], 20.0);
  EXPECT_EQ(scene.output.blocks, (std::vector<std::int64_t>{1, 3}));
  const Scene spread =
      read(chain + "count = 3\nforce = {amplitude = 1, frequency = 2, phase = 1, phase_spread = 2}\n");
  EXPECT_EQ(std::get<ChainSpec>(spread.model).force(0, 0).phase, 1.0);
  EXPECT_EQ(std::get<ChainSpec>(spread.model).force(0, 1).phase, 1.0 + 2.0 * 0.6180339887498949);
  const Scene plain = read(chain + "count = 1\nforce = {amplitude = 1, frequency = 2}\n");
  EXPECT_EQ(std::get<ChainSpec>(plain.model).topology, Topology::chain);
  EXPECT_TRUE(std::get<ChainSpec>(plain.model).x0.empty());
  EXPECT_TRUE(std::get<ChainSpec>(plain.model).forces[0][0].varies());
}

TEST_F(SceneTest, ComplaintsSayWhereAndWhat) {
  struct Case {
    std::string text;
    std::string fragment;
  };
  const std::string wrong_shape = times + "[model]\nkind=\"linear\"\n";
  const Case cases[] = {
      // TOML itself
      {"[time\n", "scene.toml:1:6: not valid TOML: "},
      {"[time]\nend = 1e999x\n", "scene.toml:2:"},
      {"title = \"\xff\"\n", "scene.toml:1:"},
      {linear + "x0 = [1, 2]\n", "scene.toml:10:6: not valid TOML: "},
      // keys
      {"tittle = \"a\"\n" + linear, "scene.toml:1:1: the file has no key 'tittle'; did you mean 'title'?"},
      {"[tiem]\n" + linear, "the file has no key 'tiem'; did you mean 'time'?"},
      {times + "stpe = 2\n" + ball + start, "scene.toml:4:1: time has no key 'stpe'; did you mean 'step'?"},
      {linear + "zeta = 2\n", "scene.toml:10:1: model has no key 'zeta'; known: kind, A, B, C"},
      {linear + "a = 2\n", "model has no key 'a'; did you mean 'A'?"},
      {linear + "yy = 2\nxx = 1\n", "scene.toml:10:1: model has no key 'yy'"},
      {linear + "[output]\nfiel = \"a\"\n", "output has no key 'fiel'; did you mean 'file'?"},
      {linear + "[petsc]\noption = \"a\"\n", "petsc has no key 'option'; did you mean 'options'?"},
      {linear + "f = [0, {amplitude = 1, frequncy = 2}]\n",
       "model.f[1] has no key 'frequncy'; did you mean 'frequency'?"},
      {linear + "D = {fiel = \"a.h5\", dataset = \"/D\"}\n",
       "model.D has no key 'fiel'; did you mean 'file'?"},
      {"", "scene.toml: model.kind is missing; expected one of \"linear\", \"lagrangian\""},
      {times + "[model]\n", "scene.toml:4:1: model.kind is missing"},
      {"model = 3\n", "scene.toml:1:9: model = 3; expected a table"},
      {"[time]\nend = 1\n" + ball + start, "scene.toml:1:1: time.step is missing; expected a number"},
      {times + ball, "scene.toml:4:1: model.x0 is missing; expected an array of numbers or a file"},
      {linear + "f = [0, {amplitude = 1}]\n", "model.f[1].frequency is missing"},
      {linear + "f = [0, {amplitude = 1, frequency = 2, phase_spread = 3}]\n",
       "model.f[1].phase_spread spreads the phase of a chain's force over its elements"},
      // kinds
      {"[time]\nend = \"1\"\nstep = 1\n" + ball + start,
       "scene.toml:2:7: time.end = \"1\"; expected a number"},
      {"title = 3\n" + linear, "title = 3; expected a string"},
      {times + ball + "x0 = [1, true]\n", "scene.toml:9:10: model.x0[1] = true; expected a number"},
      {times + ball + "x0 = [1, nan]\n", "scene.toml:9:10: model.x0[1] = nan; expected a finite number"},
      {times + ball + "x0 = [1, -inf]\n", "model.x0[1] = -inf; expected a finite number"},
      {times + ball + "x0 = 1979-05-27\n", "model.x0 is a date or a time"},
      {wrong_shape + "A = 3\n", "model.A = 3; expected rows of numbers"},
      {wrong_shape + "A = [1, 2]\n", "model.A[0] = 1; expected a row of numbers"},
      {wrong_shape + "A = [[0, \"x\"]]\n", "model.A[0][1] = \"x\"; expected a number"},
      // shapes
      {wrong_shape + "A = []\n", "model.A is 0 x 0; expected n x n, n >= 1"},
      {wrong_shape + "A = [[]]\n", "model.A is 1 x 0; expected n x n"},
      {wrong_shape + "A = [[0,1],[2]]\n", "model.A[1] has 1 entries, but row 0 has 2"},
      {wrong_shape + "A = [[0,1]]\n", "scene.toml:6:5: model.A is 1 x 2; expected n x n"},
      {wrong_shape + "A = [[0,1],[2,3]]\nB = [[1]]\n", "model.B is 1 x 1; expected 2 x 1"},
      {wrong_shape + "A = [[0,1],[2,3]]\nB = [[],[]]\n",
       "model.B is 2 x 0; expected n x m with at least one constraint"},
      {wrong_shape + "A = [[0,1],[2,3]]\nB = [[1],[0]]\nC = [[1]]\n", "model.C is 1 x 1; expected 1 x 2"},
      {linear + "D = [[1, 2]]\n", "model.D is 1 x 2; expected 1 x 1"},
      {linear + "f = [1]\n", "model.f has 1 entries; expected n = 2"},
      {linear + "w0 = [1, 2]\n", "model.w0 has 2 entries; expected m = 1"},
      {times + ball + "x0 = [1, 2, 3]\n", "scene.toml:9:6: model.x0 has 3 entries; expected n = 2"},
      {linear + "wmax = [inf, inf]\n", "model.wmax has 2 entries; expected m = 1"},
      {linear + "wmax = nan\n", "scene.toml:10:8: model.wmax = nan"},
      {linear + "wmax = [nan]\n", "model.wmax[0] = nan"},
      {linear + "wmax = [-inf]\n", "model.wmax"},
      {linear + "wmax = 0\n", "scene.toml:10:8: model.wmax has the entry 0; expected more than 0"},
      {linear + "wmax = [-2.5]\n", "model.wmax has the entry -2.5; expected more than 0"},
      {linear + "wmax = \"far\"\n", "model.wmax = \"far\""},
      // files
      {linear + "D = \"none.mtx\"\n", "scene.toml:10:5: model.D: none.mtx"},
      {linear + "D = \"D.csv\"\n", "model.D = \"D.csv\"; expected a MatrixMarket file"},
      {linear + "D = {file = \"D.h5\"}\n", "model.D.dataset is missing; expected a string"},
      {linear + "D = {file = \"none.h5\", dataset = \"/D\"}\n", "model.D: none.h5"},
      // output
      {linear + "[output]\nblocks = [0]\n", "output.blocks lists elements, but only a chain has elements"},
      {linear + "[output]\nblocks = \"some\"\n", "output.blocks is neither \"all\" nor a list"},
      {linear + "[output]\nevery = 0\n", "scene.toml:11:9: output.every = 0; expected at least 1"},
      {linear + "[output]\nevery = 1.5\n", "output.every = 1.5; expected an integer"},
      {linear + "[output]\nfile = \"\"\n", "output.file = \"\"; expected the name of a file"},
      {chain + "count = 3\n[output]\nblocks = [0, 3]\n",
       "output.blocks has entry 3; expected element numbers from 0 to 2"},
      {chain + "count = 3\n[output]\nblocks = [1, 0, 1]\n", "output.blocks lists element 1 twice"},
      {chain + "count = 3\n[output]\nblocks = []\n", "output.blocks is empty"},
      // chains
      {chain, "scene.toml:4:1: model.count is missing; expected an integer"},
      {chain + "count = 0\n", "scene.toml:7:9: model.count = 0; expected at least 1"},
      {chain + "count = 2\ntopology = \"ring\"\n", "model.count = 2; expected at least 3 in a ring"},
      {chain + "count = 4000000000000000000\n", "expected at most"},
      {chain + "count = 3\na1 = [1, 2]\n",
       "model.a1 has 2 entries; expected a single value, or model.count = 3 entries"},
      {chain + "count = 3\nforce = [1, 2]\n", "model.force has 2 entries"},
      {chain + "count = 1\nforce = [{amplitude = 1, frequency = 1, phase_spread = 1}]\n",
       "model.force[0].phase_spread spreads the phase"},
      {chain + "count = 1\nforce = {amplitude = 1, frequency = 1, phase_spred = 1}\n",
       "model.force has no key 'phase_spred'; did you mean 'phase_spread'?"},
      {chain + "count = 3\nforce = true\n", "model.force = true; expected a number or {offset"},
      {chain + "count = 3\nx0 = [1]\n", "model.x0 has 1 entries; expected 5 model.count = 15"},
      {chain + "count = 3\nmass = 1\n", "model has no key 'mass'"},
      {chain + "count = 3\ntopology = \"rnig\"\n",
       "model.topology = \"rnig\" is unknown; did you mean 'ring'?"},
      // of the contract, but not built
      {times + "[model]\nkind = \"lagrangian\"\n", "model.M is missing"},
      {times + "[model]\nkind = \"liner\"\n", "model.kind = \"liner\" is unknown; did you mean 'linear'?"},
      {times + "[model]\nkind = \"chain\"\nelement = \"zhuravlev-ivanof\"\n",
       "model.element = \"zhuravlev-ivanof\" is unknown; did you mean 'zhuravlev-ivanov'?"},
      {times + "[model]\nkind = \"chain\"\nelement = \"wall\"\ncount = 3\n",
       "scene.toml:4:1: model.e = 0.5 unless the scene says otherwise; the scheme \"homsp\" takes"},
      {chain + "count = 3\ncoupling = \"K.mtx\"\n", "scene.toml:8:12: model.coupling: K.mtx"},
      {linear + "[output]\ncheckpoint = -60\n",
       "output.checkpoint = -60 s; expected 0 (only when stopped) or"},
  };
  for (const Case& c : cases)
    expect_complaint(c.text, {}, c.fragment);
}

TEST_F(SceneTest, ComplaintsNameTheOverride) {
  struct Case {
    const char *key, *value;
    std::string fragment;
  };
  const Case cases[] = {
      {"time.stpe", "1", "--set time.stpe=1: time has no key 'stpe'; did you mean 'step'?"},
      {"tiem.step", "1", "--set tiem.step=1: the file has no key 'tiem'"},
      {"time.step.x", "1", "--set time.step.x=1: time.step = 0.1, not a table"},
      {"model.x0.1", "1", "--set model.x0.1=1: model.x0 is an array, not a table"},
      {"time..step", "1", "--set time..step=1: 'time..step' is not a key"},
      {"time.a b", "1", "'time.a b' is not a key"},
      {"time.step", "fast", "--set time.step=fast: time.step = \"fast\"; expected a number"},
      {"time.step", "nan", "--set time.step=nan: time.step = nan; expected a finite number"},
      {"time.step", "0", "time.step = 0 s; expected more than 0"},
      {"time.step", "-1", "time.step = -1 s; expected more than 0"},
      {"time.step", "1e-12", "makes 1e+12 steps; expected at most 2147483647"},
      {"time.step", "1e-320", "steps; expected at most 2147483647"},
      {"time.end", "0", "--set time.end=0: time.end = 0 s; expected more than time.start = 0 s"},
      {"time.start", "1", "expected more than time.start = 1 s"},
      {"time", "{start = 1e15, end = 1000000000000001, step = 0.01}", "is lost in the rounding"},
      {"time", "{start = -1.7e308, end = 1.7e308, step = 1}", "is too far from time.start"},
      {"time.gamma", "0.5", "--set time.gamma=0.5: time.gamma = 0.5 goes with zhuravlev-ivanov"},
      {"time.theta", "2", "time.theta = 2 is outside (0, 1]"},
      {"time.gamma", "0.5", "time.gamma = 0.5 goes with zhuravlev-ivanov"},
      {"time.detection", "current", "time.detection goes with the scheme \"moreau-jean\""},
      {"time.tolerance", "1e-8", "time.tolerance goes with the scheme"},
      {"time.scheme", "moreau-jean",
       "time.scheme = \"moreau-jean\" does not fit this model; expected homsp, zd-euler, naive-euler"},
      {"time.scheme", "zd_euler", "time.scheme = \"zd_euler\" is unknown; did you mean 'zd-euler'?"},
      {"title", "3", "title = 3; expected a string; put it in double quotes"},
      {"model.D", "none.mtx", "--set model.D=none.mtx: model.D: none.mtx"},
  };
  for (const Case& c : cases)
    expect_complaint(linear, {{c.key, c.value}}, c.fragment);
}

TEST_F(SceneTest, SaysWhyItCannotOpenAFile) {
  const auto said = [&](const fs::path& path) {
    return complaint([&] { read_scene(MPI_COMM_WORLD, path.string(), {}); });
  };
  EXPECT_EQ(said(folder_ / "none.toml"), "none.toml: cannot be opened: No such file or directory");
  EXPECT_NE(said(folder_).find("is a folder; expected a TOML file"), std::string::npos);
}

TEST_F(SceneTest, ProblemHasDefaultsAndInfiniteBounds) {
  const Problem lcp = read_one("[problem]\nM = [[2, 1], [1, 2]]\nq = [-1, 2]\n");
  const Problem mixed =
      read_one("[problem]\nM = [[2, 1], [1, 2]]\nq = [-1, 2]\nlower = [-inf, 0]\nupper = 3\nu0 = [1, 1]\n");
  if (!is_root()) {
    EXPECT_TRUE(lcp.M.values.empty() && lcp.q.empty() && lcp.lower.empty() && lcp.upper.empty() &&
                lcp.u0.empty());
    return;
  }
  using Numbers = std::vector<double>;
  EXPECT_EQ(lcp.M.rows, 2);
  EXPECT_EQ(lcp.q, (Numbers{-1, 2}));
  EXPECT_EQ(lcp.lower, (Numbers{0, 0}));
  EXPECT_EQ(lcp.upper, (Numbers{infinity, infinity}));
  EXPECT_EQ(lcp.u0, (Numbers{0, 0}));
  EXPECT_EQ(mixed.lower, (Numbers{-infinity, 0}));
  EXPECT_EQ(mixed.upper, (Numbers{3, 3}));
  EXPECT_EQ(mixed.u0, (Numbers{1, 1}));
}

TEST_F(SceneTest, ProblemComplaints) {
  struct Case {
    std::string text;
    std::string fragment;
  };
  const std::string lcp = "[problem]\nM = [[2, 1], [1, 2]]\nq = [-1, 2]\n";
  const Case cases[] = {
      {"", "problem.toml: problem.M is missing; expected rows of numbers"},
      {lcp + "uper = 1\n", "problem.toml:4:1: problem has no key 'uper'; did you mean 'upper'?"},
      {lcp + "[time]\nend = 1\n", "the file has no key 'time'"},
      {"[problem]\nM = [[2, 1]]\n", "problem.M is 1 x 2; expected n x n"},
      {"[problem]\nM = [[2]]\nq = [1, 2]\n", "problem.q has 2 entries; expected n = 1 as in problem.M"},
      {"[problem]\nM = [[2]]\nq = [inf]\n", "problem.q[0] = inf; expected a finite number"},
      {lcp + "lower = [1]\n", "problem.lower has 1 entries; expected n = 2"},
      {lcp + "lower = nan\n", "problem.lower = nan; expected a number"},
      {lcp + "lower = [0, 2]\nupper = 1\n", "problem.lower leaves no room for u[1]: lower = 2, upper = 1"},
      {lcp + "lower = inf\n", "problem.lower leaves no room for u[0]"},
      {lcp + "upper = -1\n", "problem.upper leaves no room for u[0]: lower = 0, upper = -1"},
      {lcp + "u0 = [1]\n", "problem.u0 has 1 entries; expected n = 2"},
  };
  for (const Case& c : cases) {
    const std::string said = complaint([&] { read_one(c.text); });
    EXPECT_NE(said.find(c.fragment), std::string::npos)
        << c.text << "\nsays: " << said << "\nnot:  " << c.fragment;
  }
}

}  // namespace
}  // namespace sweepvi
