// ranks: 1
#include "app/command_line.hpp"

#include <gtest/gtest.h>

#include "sweepvi/error.hpp"

// Words in, fields or a complaint out; nothing here touches files, MPI or PETSc.

namespace sweepvi::app {
namespace {

using Words = std::vector<std::string>;

std::string complaint_about(const Words& words) {
  try {
    parse_command_line(words);
  } catch (const Error& error) {
    EXPECT_EQ(error.code(), ExitCode::bad_input);
    return error.what();
  }
  return "none";
}

TEST(CommandLine, SplitsOursFromPetscs) {
  const CommandLine line = parse_command_line({"run", "a.toml", "-snes_type", "vinewtonrsls", "-o", "b.h5",
                                               "--set=model.A=[[1]]", "-log_view", "--summary", "s.json",
                                               "-shift", "-1e-3", "-bound", "-inf", "--force", "-last"});
  EXPECT_EQ(line.verb, Verb::run);
  EXPECT_EQ(line.scene, "a.toml");
  EXPECT_EQ(line.output, "b.h5");
  EXPECT_EQ(line.summary, "s.json");
  EXPECT_TRUE(line.force);
  EXPECT_FALSE(line.help_requested);
  EXPECT_EQ(line.overrides, (Overrides{{"model.A", "[[1]]"}}));
  EXPECT_EQ(line.petsc_words,
            (Words{"-snes_type", "vinewtonrsls", "-log_view", "-shift", "-1e-3", "-bound", "-inf", "-last"}));
}

TEST(CommandLine, KnowsItsVerbs) {
  EXPECT_EQ(parse_command_line({"check", "a.toml"}).verb, Verb::check);
  EXPECT_EQ(parse_command_line({"solve", "a.toml", "-o", "u.h5"}).verb, Verb::solve);
  EXPECT_EQ(parse_command_line({"compare", "a.h5", "b.h5"}).verb, Verb::compare);
  EXPECT_EQ(parse_command_line({"info"}).verb, Verb::info);
  EXPECT_EQ(parse_command_line({"--version"}).verb, Verb::info);
  EXPECT_EQ(parse_command_line({}).verb, Verb::help);
}

TEST(CommandLine, TakesTwoFilesToCompare) {
  const CommandLine line = parse_command_line(
      {"compare", "a.h5", "b.csv", "--components", "4,0,2", "--tolerance=1e-9", "--summary", "s.json"});
  EXPECT_EQ(line.scene, "a.h5");
  EXPECT_EQ(line.other, "b.csv");
  EXPECT_EQ(line.components, (std::vector<std::int64_t>{0, 2, 4}));
  EXPECT_EQ(line.tolerance, 1e-9);
  EXPECT_EQ(line.summary, "s.json");
  const CommandLine help = parse_command_line({"compare", "a.h5", "b.h5", "--help"});
  EXPECT_EQ(help.verb, Verb::help);
  EXPECT_EQ(help.help_topic, Verb::compare);
}

TEST(CommandLine, TakesListsToStudy) {
  const CommandLine line = parse_command_line(
      {"study", "a.toml", "--steps", "1e-1,.05", "--schemes=homsp,hybrid", "--tolerances", "1e-3,1e-6",
       "--repeats", "5", "--settings", "s.toml", "--reference=1e-4", "--csv", "o.csv", "-snes_type", "x"});
  EXPECT_EQ(line.verb, Verb::study);
  EXPECT_EQ(line.steps, (std::vector<double>{0.1, 0.05}));
  EXPECT_EQ(line.schemes, (Words{"homsp", "hybrid"}));
  EXPECT_EQ(line.tolerances, (std::vector<double>{1e-3, 1e-6}));
  EXPECT_EQ(line.repeats, 5);
  EXPECT_EQ(line.settings, "s.toml");
  EXPECT_EQ(line.reference, "1e-4");
  EXPECT_EQ(line.csv, "o.csv");
  EXPECT_EQ(line.petsc_words, (Words{"-snes_type", "x"}));
}

TEST(CommandLine, FoldsTimesOfPetscIntoOverrides) {
  const CommandLine line = parse_command_line(
      {"run", "a.toml", "-ts_dt", ".5", "-ts_max_time", "3", "-ts_theta_theta", "1", "-ts_type", "sweepvi"});
  EXPECT_EQ(line.overrides, (Overrides{{"time.step", "0.5"}, {"time.end", "3"}, {"time.theta", "1"}}));
  EXPECT_EQ(line.petsc_words, (Words{"-ts_type", "sweepvi"}));
  // Said twice, but the same number.
  EXPECT_EQ(parse_command_line({"run", "a.toml", "--set", "time.step=5e-1", "-ts_dt", "0.5"}).overrides,
            (Overrides{{"time.step", "5e-1"}}));
}

TEST(CommandLine, AnswersRequestsForHelp) {
  for (const std::string word : {"help", "-h", "--help", "-help"}) {
    EXPECT_EQ(parse_command_line({word}).verb, Verb::help) << word;
    EXPECT_FALSE(parse_command_line({word}).help_topic) << word;
    EXPECT_EQ(parse_command_line({word, "solve"}).verb, Verb::help) << word;
    EXPECT_EQ(parse_command_line({word, "solve"}).help_topic, Verb::solve) << word;
    const CommandLine scene = parse_command_line({word, "run", "a.toml", "-pc_type", "lu"});
    EXPECT_EQ(scene.verb, Verb::run) << word;
    EXPECT_TRUE(scene.help_requested) << word;
    EXPECT_EQ(scene.petsc_words, (Words{"-pc_type", "lu"})) << word;
    if (word == "help") continue;
    EXPECT_EQ(parse_command_line({"run", word}).help_topic, Verb::run) << word;
    EXPECT_TRUE(parse_command_line({"check", "a.toml", "-pc_type", word}).help_requested) << word;
  }
}

TEST(CommandLine, TakesCountsToBench) {
  const CommandLine line =
      parse_command_line({"bench", "a.toml", "--warmup", "0", "--count=1e3", "--repeats", "2", "--settings",
                          "s.toml", "--wall-limit", "60", "--set", "model.count=7", "-ts_dt", "1e-3"});
  EXPECT_EQ(line.verb, Verb::bench);
  EXPECT_EQ(line.warmup, 0);
  EXPECT_EQ(line.count, 1000);
  EXPECT_EQ(line.repeats, 2);
  EXPECT_EQ(line.settings, "s.toml");
  EXPECT_EQ(line.wall_limit, 60.0);
  EXPECT_EQ(line.overrides, (Overrides{{"model.count", "7"}, {"time.step", "0.001"}}));
}

TEST(CommandLine, ComplainsAboutWhatItCannotUse) {
  struct Case {
    Words words;
    std::string fragment;
  };
  const Case cases[] = {
      {{"rnu", "a.toml"}, "unknown verb 'rnu'; did you mean 'run'?"},
      {{"a.toml"}, "did you mean 'sweepvi run a.toml'?"},
      {{"-log_view", "run"}, "'-log_view' comes before the verb"},
      {{"study"}, "'study' needs a SCENE.toml directly after it"},
      {{"study", "a.toml"}, "'study' needs steps to run with: --steps"},
      {{"study", "a.toml", "--steps", "1e-1,x"}, "--steps 1e-1,x: expected numbers above 0"},
      {{"study", "a.toml", "--steps", "1e-1,"}, "--steps 1e-1,: expected numbers above 0"},
      {{"study", "a.toml", "--steps=0"}, "--steps 0: expected numbers above 0"},
      {{"study", "a.toml", "--steps=1,2,1.0"}, "--steps 1,2,1.0: 1 is there twice"},
      {{"study", "a.toml", "--steps=1", "--steps=2"}, "--steps 2 contradicts an earlier --steps"},
      {{"study", "a.toml", "--tolerances", "inf"}, "--tolerances inf: expected numbers above 0"},
      {{"study", "a.toml", "--steps=1", "--schemes", "homsp,homsp"}, "homsp is there twice"},
      {{"study", "a.toml", "--steps=1", "--repeats", "1.5"}, "--repeats 1.5: expected a whole number"},
      {{"study", "a.toml", "--steps=1", "--repeats=2", "--repeats=3"}, "contradict each other"},
      {{"study", "a.toml", "--steps=1", "--set", "time.step=2"}, "--set time.step=2 contradicts --steps"},
      {{"study", "a.toml", "--steps=1", "-ts_dt", "2"}, "-ts_dt 2 contradicts --steps"},
      {{"study", "a.toml", "--steps=1", "--schemes=homsp", "--set=time.scheme=hybrid"},
       "contradicts --schemes"},
      {{"study", "a.toml", "--steps=1", "--tolerances=1", "--set=time.tolerance=2"},
       "contradicts --tolerances"},
      {{"study", "a.toml", "--steps=1", "-o", "a.h5"}, "'study' does not take -o"},
      {{"run", "a.toml", "--steps=1"}, "'run' does not take --steps"},
      {{"bench"}, "'bench' needs a SCENE.toml directly after it"},
      {{"bench", "a.toml", "--count", "0"}, "--count 0: expected a whole number, 1 or more"},
      {{"bench", "a.toml", "--warmup=-1"}, "--warmup -1: expected a whole number, 0 or more"},
      {{"bench", "a.toml", "--count=2", "--count=3"}, "--count 2 and --count 3 contradict each other"},
      {{"bench", "a.toml", "--steps=1"}, "'bench' does not take --steps"},
      {{"bench", "a.toml", "-o", "a.h5"}, "'bench' does not take -o"},
      {{"run", "a.toml", "--count=2"}, "'run' does not take --count"},
      {{"run"}, "'run' needs a SCENE.toml directly after it"},
      {{"run", ""}, "'run' needs a SCENE.toml directly after it"},
      {{"run", "-log_view", ":out.txt"}, "'run' needs a SCENE.toml directly after it"},
      {{"compare"}, "'compare' needs A.h5 B.h5 directly after it"},
      {{"compare", "a.h5"}, "'compare' needs A.h5 B.h5 directly after it"},
      {{"compare", "a.h5", "--tolerance", "1", "b.h5"}, "unexpected word 'b.h5'; 'compare' takes two files"},
      {{"compare", "a.h5", "b.h5", "c.h5"}, "unexpected word 'c.h5'; 'compare' takes two files"},
      {{"compare", "a.h5", "b.h5", "--components", "0,x"}, "--components 0,x: expected column numbers"},
      {{"compare", "a.h5", "b.h5", "--components=1,"}, "--components 1,: expected column numbers"},
      {{"compare", "a.h5", "b.h5", "--components", "1 2"}, "--components 1 2: expected column numbers"},
      {{"compare", "a.h5", "b.h5", "--components=-1"}, "--components -1: expected column numbers"},
      {{"compare", "a.h5", "b.h5", "--components=2,0,2"}, "--components 2,0,2: 2 is there twice"},
      {{"compare", "a.h5", "b.h5", "--components=2", "--components=0"}, "contradicts an earlier"},
      {{"compare", "a.h5", "b.h5", "--tolerance=0"}, "--tolerance 0: expected a number above 0"},
      {{"compare", "a.h5", "b.h5", "--tolerance", "inf"}, "--tolerance inf: expected a number above 0"},
      {{"compare", "a.h5", "b.h5", "--tolerance=1", "--tolerance=2"}, "contradict each other"},
      {{"compare", "a.h5", "b.h5", "-o", "c.h5"}, "'compare' does not take -o"},
      {{"run", "a.toml", "--tolerance", "1"}, "'run' does not take --tolerance"},
      {{"solve", "-o", "x.h5"}, "'solve' needs a PROBLEM.toml directly after it"},
      {{"run", "a.toml", "b.toml"}, "unexpected word 'b.toml'"},
      {{"run", "a.toml", "-pc_type", "lu", "b.toml"}, "unexpected word 'b.toml'"},
      {{"info", "a.toml"}, "unexpected word 'a.toml'; 'info' takes no file"},
      {{"run", "a.toml", "--sumary", "s"}, "'run' has no option --sumary; did you mean '--summary'?"},
      {{"run", "a.toml", "--zzz"}, "'run' has no option --zzz; known: -o, --set"},
      {{"run", "a.toml", "--"}, "'run' has no option --"},
      {{"run", "a.toml", "--restart"}, "--restart needs a value: --restart FILE.h5"},
      {{"check", "a.toml", "--restart", "a.h5"}, "'check' does not take --restart"},
      {{"run", "a.toml", "--wall-limit=-1"}, "--wall-limit -1: expected a number of seconds, 0 or more"},
      {{"run", "a.toml", "--wall-limit", "nan"}, "--wall-limit nan: expected a number of seconds"},
      {{"run", "a.toml", "--wall-limit=1", "--wall-limit=2"},
       "--wall-limit 1 and --wall-limit 2 contradict each other"},
      {{"check", "a.toml", "-o", "b.h5"}, "'check' does not take -o"},
      {{"check", "a.toml", "--force"}, "'check' does not take --force"},
      {{"solve", "a.toml", "--set", "a=1"}, "'solve' does not take --set"},
      {{"info", "--summary", "s"}, "'info' does not take --summary"},
      {{"run", "a.toml", "--version"}, "--version stands alone"},
      {{"run", "a.toml", "-o"}, "-o needs a value: -o FILE.h5"},
      {{"run", "a.toml", "-o", ""}, "-o needs a value"},
      {{"run", "a.toml", "-o", "--force"}, "-o needs a value"},
      {{"run", "a.toml", "-o=b.h5"}, "write '-o FILE'"},
      {{"run", "a.toml", "--summary", "-log_view"}, "--summary needs a value: --summary FILE.json"},
      {{"run", "a.toml", "--summary="}, "--summary needs a value"},
      {{"run", "a.toml", "--force=yes"}, "--force takes no value"},
      {{"run", "a.toml", "--set"}, "--set needs a value"},
      {{"run", "a.toml", "--set", "time.step"}, "expected key=value"},
      {{"run", "a.toml", "--set", "=1"}, "expected key=value"},
      {{"run", "a.toml", "-o", "a.h5", "-o", "b.h5"}, "-o a.h5 and -o b.h5 contradict"},
      {{"run", "a.toml", "--summary=a", "--summary=b"}, "contradict"},
      {{"run", "a.toml", "--set", "time.step=1", "--set", "time.step=2"}, "contradict"},
      {{"run", "a.toml", "--set", "time.step=0.1", "-ts_dt", "0.2"},
       "--set time.step=0.1 and -ts_dt 0.2 contradict each other; give time.step once"},
      {{"run", "a.toml", "-ts_max_time", "1", "--set", "time.end=2"}, "contradict"},
      {{"run", "a.toml", "-ts_dt"}, "-ts_dt needs a value"},
      {{"run", "a.toml", "-ts_dt=1"}, "write '-ts_dt VALUE'"},
      {{"run", "a.toml", "-ts_dt", "fast"}, "-ts_dt fast: expected a number"},
      {{"solve", "a.toml", "-ts_dt", "1"}, "'solve' does not take -ts_dt"},
      {{"run", "a.toml", "-ts_type", "beuler"}, "-ts_type must be sweepvi"},
      {{"run", "a.toml", "-ts_type"}, "-ts_type needs a value"},
  };
  for (const Case& c : cases) {
    std::string all;
    for (const std::string& word : c.words)
      all += word + " ";
    EXPECT_NE(complaint_about(c.words).find(c.fragment), std::string::npos)
        << "sweepvi " << all << "\nsays: " << complaint_about(c.words) << "\nnot:  " << c.fragment;
  }
}

TEST(CommandLine, SameAnswerTwiceIsNoContradiction) {
  EXPECT_EQ(parse_command_line({"run", "a.toml", "-o", "b", "-o", "b"}).output, "b");
  EXPECT_EQ(parse_command_line({"run", "a.toml", "--set=a=1", "--set=a=1.0"}).overrides.size(), 1U);
}

TEST(HelpText, NamesWhatTheParserTakesAndNothingElse) {
  const std::string general = help_text(std::nullopt);
  for (const char* fragment : {"run SCENE.toml", "check SCENE.toml", "solve PROBLEM.toml", "Exit codes",
                               "-sweepvi_", "study SCENE.toml", "bench SCENE.toml"})
    EXPECT_NE(general.find(fragment), std::string::npos) << fragment;
  struct Case {
    Verb verb;
    Words taken, refused;
  };
  const Case cases[] = {
      {Verb::run,
       {"-o FILE", "--set ", "--summary", "--force", "-ts_dt", "--restart FILE", "--wall-limit SECONDS"},
       {}},
      {Verb::check, {"--set "}, {"-o FILE", "--summary", "--force"}},
      {Verb::solve, {"-o FILE", "--summary", "--force"}, {"--set ", "-ts_dt"}},
      {Verb::compare,
       {"--components 0,1", "--tolerance X", "--summary FILE"},
       {"-o FILE", "--set ", "--force"}},
      {Verb::study,
       {"--steps 1e-1", "--schemes a,b", "--tolerances", "--settings FILE", "--reference FILE", "--repeats K",
        "--csv FILE", "--summary FILE", "--components 0,1", "--set "},
       {"-o FILE", "--force"}},
      {Verb::bench,
       {"--warmup K", "--count K", "--repeats K", "--settings FILE", "--wall-limit SECONDS", "--summary FILE",
        "--set ", "-ts_dt"},
       {"-o FILE", "--force", "--steps"}},
      {Verb::info, {"versions"}, {"-o FILE", "--set "}}};
  for (const Case& c : cases) {
    const std::string text = help_text(c.verb);
    for (const std::string& word : c.taken)
      EXPECT_NE(text.find(word), std::string::npos) << word << " in\n" << text;
    for (const std::string& word : c.refused)
      EXPECT_EQ(text.find(word), std::string::npos) << word << " in\n" << text;
  }
}

}  // namespace
}  // namespace sweepvi::app
