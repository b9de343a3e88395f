#include "app/command_line.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdlib>
#include <span>
#include <string_view>

#include "app/service_verbs.hpp"
#include "io/toml_table.hpp"

namespace sweepvi::app {

namespace {

struct VerbEntry {
  std::string name;
  Verb verb;
  std::string operand;  ///< what follows the verb
  std::string text;
};

const std::vector<VerbEntry>& verbs() {
  static const std::vector<VerbEntry> entries = {
      {"run", Verb::run, "SCENE.toml", "simulate a scene and record its trajectory"},
      {"check", Verb::check, "SCENE.toml",
       "read and classify a scene, or read a problem; solve nothing, write nothing"},
      {"solve", Verb::solve, "PROBLEM.toml", "solve one box VI, LCP or mixed LCP"},
      {"compare", Verb::compare, "A.h5 B.h5",
       "distances between two recorded runs, or from a table FILE.csv"},
      {"study", Verb::study, "SCENE.toml",
       "run a scene with several steps, schemes and solver settings: errors against time"},
      {"bench", Verb::bench, "SCENE.toml",
       "time the steps of a scene, write no trajectory: seconds, counts, memory"},
      {"info", Verb::info, "", "versions of sweepvi and of the libraries it uses; also --version"},
      {"help", Verb::help, "[VERB]", "this text, or that of a verb; also -h, --help, -help"}};
  return entries;
}

const VerbEntry& entry_of(Verb verb) {
  return *std::find_if(verbs().begin(), verbs().end(),
                       [&](const VerbEntry& entry) { return entry.verb == verb; });
}

struct OptionEntry {
  std::string word;
  std::string value;        ///< what follows it; empty: nothing
  std::vector<Verb> verbs;  ///< who takes it
  bool built;
  std::string text;
};

const std::vector<OptionEntry>& options() {
  static const std::vector<OptionEntry> entries = {
      {"-o", "FILE.h5", {Verb::run}, true, "output file (default: output.file, or the scene's stem + .h5)"},
      {"-o", "FILE.h5", {Verb::solve}, true, "output file (default: the problem's stem + .h5)"},
      {"--set",
       "key=value",
       {Verb::run, Verb::check, Verb::study, Verb::bench},
       true,
       "override a key, as in time.step=1e-3; repeatable"},
      {"--summary",
       "FILE.json",
       {Verb::run, Verb::solve},
       true,
       "write one JSON object with status, counts and times"},
      {"--steps", "1e-1,1e-2,...", {Verb::study}, true, "time steps to run with [s]"},
      {"--schemes", "a,b", {Verb::study}, true, "schemes to run (default: the scene's own)"},
      {"--tolerances",
       "1e-4,1e-8,...",
       {Verb::study},
       true,
       "of the scheme hybrid, instead of steps (default: the scene's)"},
      {"--settings",
       "FILE.toml",
       {Verb::study, Verb::bench},
       true,
       "solver options to compare, [[setting]] with name and options"},
      {"--reference",
       "FILE.h5|FILE.csv|STEP",
       {Verb::study},
       true,
       "what errors refer to: a file, or the scene's scheme at so small a step (default: hybrid at 1e-12)"},
      {"--repeats", "K", {Verb::study}, true, "how often each is run for its time (default: 3)"},
      {"--warmup", "K", {Verb::bench}, true, "steps to take before the first one that is timed (default: 3)"},
      {"--count", "K", {Verb::bench}, true, "steps to time (default: 20)"},
      {"--repeats",
       "K",
       {Verb::bench},
       true,
       "rounds in each of which every setting is timed (default: 3 with --settings, else 1)"},
      {"--wall-limit",
       "SECONDS",
       {Verb::bench},
       true,
       "no step begins when a setting's round has taken so long; what was timed counts"},
      {"--summary", "FILE.json", {Verb::bench}, true, "write the same numbers as one JSON object"},
      {"--csv", "FILE.csv", {Verb::study}, true, "write the table; scripts/plot draws it"},
      {"--summary", "FILE.json", {Verb::study}, true, "write the table and what it refers to as JSON"},
      {"--components",
       "0,1,...",
       {Verb::compare, Verb::study},
       true,
       "columns of /x to look at, numbered from 0 (default: all)"},
      {"--tolerance",
       "X",
       {Verb::compare},
       true,
       "of the Hausdorff distance (default: 1e-3 of it, but at most 1e-6 of the largest |x|)"},
      {"--summary", "FILE.json", {Verb::compare}, true, "write the same numbers as one JSON object"},
      {"--progress",
       "FILE",
       {Verb::run},
       true,
       "append a line of JSON every now and then: step, t, iterations, residual, estimated end"},
      {"--confine",
       "FILES.json",
       {Verb::run, Verb::check, Verb::solve, Verb::study},
       true,
       "for what others wrote: it may name these files only, {\"name\": \"path\"}, and harmless PETSc "
       "options; the process can reach no others, see README.md"},
      {"--force", "", {Verb::run, Verb::solve}, true, "replace output files that exist"},
      {"--restart",
       "FILE.h5",
       {Verb::run},
       true,
       "go on from a checkpoint, or from the file of a stopped run"},
      {"--wall-limit", "SECONDS", {Verb::run}, true, "stop in order after so long, with a checkpoint"},
      {"--help",
       "",
       {Verb::run, Verb::check, Verb::solve, Verb::study, Verb::bench},
       true,
       "this text; after the file also the options of what it builds"},
      {"--help", "", {Verb::compare}, true, "this text"}};
  return entries;
}

/// PETSc's names for keys of `[time]`.
struct Alias {
  std::string word, key;
};
const std::vector<Alias>& aliases() {
  static const std::vector<Alias> entries = {
      {"-ts_dt", "time.step"}, {"-ts_max_time", "time.end"}, {"-ts_theta_theta", "time.theta"}};
  return entries;
}

bool takes(const OptionEntry& option, Verb verb) {
  return std::find(option.verbs.begin(), option.verbs.end(), verb) != option.verbs.end();
}

bool asks_for_help(const std::string& word) {
  return word == "-h" || word == "--help" || word == "-help";
}

/// The whole text as a number, as C reads it.
std::optional<double> to_number(const std::string& text) {
  if (text.empty() || std::isspace(static_cast<unsigned char>(text[0])) != 0) return std::nullopt;
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  return *end == '\0' ? std::optional(value) : std::nullopt;
}

/// As PETSc decides it: -1 and -inf are values.
bool is_option(const std::string& word) {
  if (word.size() < 2 || word[0] != '-' || to_number(word)) return false;
  return word[1] == '-' || std::isalpha(static_cast<unsigned char>(word[1])) != 0;
}

bool same_value(const std::string& a, const std::string& b) {
  const std::optional<double> x = to_number(a), y = to_number(b);
  return x && y ? *x == *y : a == b;
}

class Parser {
public:
  Parser(Verb verb, std::span<const std::string> words) : words_(words) { line_.verb = verb; }

  CommandLine parse() {
    const VerbEntry& entry = entry_of(line_.verb);
    const bool compares = line_.verb == Verb::compare;
    const bool wants_file = line_.verb != Verb::info && line_.verb != Verb::help;
    if (wants_file && !words_.empty() && !is_option(words_[0])) line_.scene = take();
    if (compares && !words_.empty() && !is_option(words_[0])) line_.other = take();
    while (!words_.empty())
      parse_word(take());
    if (line_.help_requested) {
      line_.help_topic = line_.verb;
      if (compares) line_.scene.clear();  // it builds nothing that has options
      if (line_.scene.empty()) line_.verb = Verb::help;
    } else if (wants_file && (line_.scene.empty() || (compares && line_.other.empty()))) {
      throw InputError(fmt::format("'{0}' needs {2}{1} directly after it: sweepvi {0} {1} ...", entry.name,
                                   entry.operand, compares ? "" : "a "));
    } else if (line_.verb == Verb::study) {
      check_study();
    }
    return std::move(line_);
  }

private:
  std::string take() {
    std::string word = words_.front();
    words_ = words_.subspan(1);
    return word;
  }

  std::string take_value(const std::string& word, const std::string& expected) {
    if (words_.empty() || words_[0].empty() || is_option(words_[0]))
      throw InputError(fmt::format("{0} needs a value: {0} {1}", word, expected));
    return take();
  }

  const std::string& verb_name() const { return entry_of(line_.verb).name; }

  void parse_word(const std::string& word) {
    if (asks_for_help(word)) {
      line_.help_requested = true;
    } else if (word.starts_with("--") || word == "-o" || word.starts_with("-o=")) {
      parse_own(word);
    } else if (is_option(word)) {
      parse_petsc(word);
    } else {
      throw InputError(fmt::format(
          "unexpected word '{}'; '{}' takes {}, then options, each with at most one value", word, verb_name(),
          line_.scene.empty()           ? "no file"
          : line_.verb == Verb::compare ? "two files, directly after it"
                                        : "one file, directly after it"));
    }
  }

  void parse_own(const std::string& given) {
    const std::size_t equals = given.find('=');
    const std::string word = given.substr(0, equals);
    std::vector<std::string> known;
    const OptionEntry* option = nullptr;
    for (const OptionEntry& entry : options()) {
      if (takes(entry, line_.verb)) known.push_back(entry.word);
      // The same word may differ between verbs.
      if (entry.word == word && (option == nullptr || takes(entry, line_.verb))) option = &entry;
    }
    if (word == "--version") throw InputError("--version stands alone: sweepvi --version");
    if (option == nullptr)
      throw InputError(fmt::format("'{}' has no option {}{}", verb_name(), word, suggestion(word, known)));
    if (!option->built) throw InputError(fmt::format("{} is not built yet", word));
    if (!takes(*option, line_.verb))
      throw InputError(
          fmt::format("'{}' does not take {}; see 'sweepvi help {}'", verb_name(), word, verb_name()));
    if (option->value.empty() && equals != std::string::npos)
      throw InputError(fmt::format("{} takes no value", word));
    if (word == "-o" && equals != std::string::npos)
      throw InputError(fmt::format("write '-o FILE' instead of '{}'", given));
    if (equals != std::string::npos && equals + 1 == given.size())
      throw InputError(fmt::format("{0} needs a value: {0} {1}", word, option->value));
    if (word == "--force") {
      line_.force = true;
      return;
    }
    if (option->value.empty()) {  // --help=... was refused above
      line_.help_requested = true;
      return;
    }
    const std::string value =
        equals == std::string::npos ? take_value(word, option->value) : given.substr(equals + 1);
    if (word == "--set") {
      add_set(value);
    } else if (word == "--wall-limit") {
      set_wall_limit(value);
    } else if (word == "--components") {
      set_components(value);
    } else if (word == "--tolerance") {
      set_tolerance(value);
    } else if (word == "--steps") {
      set_list(word, value, numbers(word, value), line_.steps);
    } else if (word == "--tolerances") {
      set_list(word, value, numbers(word, value), line_.tolerances);
    } else if (word == "--schemes") {
      set_list(word, value, pieces(value), line_.schemes);
    } else if (word == "--repeats") {
      set_count(word, value, 1, line_.repeats);
    } else if (word == "--warmup") {
      set_count(word, value, 0, line_.warmup);
    } else if (word == "--count") {
      set_count(word, value, 1, line_.count);
    } else {
      keep_once(word, value,
                word == "-o"            ? line_.output
                : word == "--restart"   ? line_.restart
                : word == "--settings"  ? line_.settings
                : word == "--reference" ? line_.reference
                : word == "--csv"       ? line_.csv
                : word == "--progress"  ? line_.progress
                : word == "--confine"   ? line_.confine
                                        : line_.summary);
    }
  }

  void parse_petsc(const std::string& word) {
    for (const Alias& alias : aliases()) {
      if (word.starts_with(alias.word + "="))
        throw InputError(fmt::format("write '{} VALUE' instead of '{}'", alias.word, word));
      if (word != alias.word) continue;
      if (line_.verb != Verb::run && line_.verb != Verb::check && line_.verb != Verb::study &&
          line_.verb != Verb::bench)
        throw InputError(fmt::format("'{}' does not take {}: it has no [time]", verb_name(), word));
      const std::string value = take_value(word, "VALUE");
      const std::optional<double> number = to_number(value);
      if (!number) throw InputError(fmt::format("{} {}: expected a number", word, value));
      // As TOML writes it: PETSc's users may say .5 or 1.
      add_override(alias.key, fmt::format("{}", *number), fmt::format("{} {}", word, value));
      return;
    }
    line_.petsc_words.push_back(word);
    if (word == "-ts_type" && take_value(word, "sweepvi") != "sweepvi")
      throw InputError(
          "-ts_type must be sweepvi, our own time stepper; choose the scheme with --set time.scheme=...");
    if (word == "-ts_type") {
      line_.petsc_words.emplace_back("sweepvi");
    } else if (!words_.empty() && !is_option(words_[0])) {
      line_.petsc_words.push_back(take());
    }
  }

  static void keep_once(const std::string& word, const std::string& value, std::optional<std::string>& kept) {
    if (kept && *kept != value)
      throw InputError(fmt::format("{0} {1} and {0} {2} contradict each other", word, *kept, value));
    kept = value;
  }

  void set_wall_limit(const std::string& text) {
    const std::optional<double> seconds = to_number(text);
    if (!seconds || !(*seconds >= 0.0))
      throw InputError(fmt::format("--wall-limit {}: expected a number of seconds, 0 or more", text));
    if (line_.wall_limit && *line_.wall_limit != *seconds)
      throw InputError(
          fmt::format("--wall-limit {} and --wall-limit {} contradict each other", *line_.wall_limit, text));
    line_.wall_limit = seconds;
  }

  void set_components(const std::string& text) {
    std::vector<std::int64_t> columns;
    const char* const end = text.data() + text.size();
    for (const char* at = text.data();; ++at) {
      std::int64_t column = -1;
      const auto [after, failure] = std::from_chars(at, end, column);
      if (failure != std::errc() || column < 0 || (after != end && *after != ','))
        throw InputError(fmt::format(
            "--components {}: expected column numbers from 0 with commas between, as in 0,1,4", text));
      columns.push_back(column);
      at = after;
      if (at == end) break;
    }
    std::sort(columns.begin(), columns.end());
    const auto twice = std::adjacent_find(columns.begin(), columns.end());
    if (twice != columns.end())
      throw InputError(fmt::format("--components {}: {} is there twice", text, *twice));
    if (!line_.components.empty() && line_.components != columns)
      throw InputError(fmt::format("--components {} contradicts an earlier --components", text));
    line_.components = columns;
  }

  void set_tolerance(const std::string& text) {
    const std::optional<double> tolerance = to_number(text);
    if (!tolerance || !(*tolerance > 0.0) || !std::isfinite(*tolerance))
      throw InputError(fmt::format("--tolerance {}: expected a number above 0", text));
    if (line_.tolerance && *line_.tolerance != *tolerance)
      throw InputError(
          fmt::format("--tolerance {} and --tolerance {} contradict each other", *line_.tolerance, text));
    line_.tolerance = tolerance;
  }

  static std::vector<std::string> pieces(const std::string& text) {
    std::vector<std::string> found(1);
    for (const char c : text)
      if (c == ',')
        found.emplace_back();
      else
        found.back() += c;
    return found;
  }

  static std::vector<double> numbers(const std::string& word, const std::string& text) {
    std::vector<double> found;
    for (const std::string& piece : pieces(text)) {
      const std::optional<double> number = to_number(piece);
      if (!number || !(*number > 0.0) || !std::isfinite(*number))
        throw InputError(
            fmt::format("{} {}: expected numbers above 0 with commas between, as in 1e-1,1e-2", word, text));
      found.push_back(*number);
    }
    return found;
  }

  template <class Entry>
  static void set_list(const std::string& word, const std::string& text, const std::vector<Entry>& found,
                       std::vector<Entry>& kept) {
    std::vector<Entry> sorted = found;
    std::sort(sorted.begin(), sorted.end());
    const auto twice = std::adjacent_find(sorted.begin(), sorted.end());
    if (twice != sorted.end()) throw InputError(fmt::format("{} {}: {} is there twice", word, text, *twice));
    if (!kept.empty() && kept != found)
      throw InputError(fmt::format("{0} {1} contradicts an earlier {0}", word, text));
    kept = found;
  }

  static void set_count(const std::string& word, const std::string& text, int least,
                        std::optional<int>& kept) {
    const std::optional<double> count = to_number(text);
    constexpr double most = 1e9;
    if (!count || !(*count >= least) || *count > most || *count != std::round(*count))
      throw InputError(fmt::format("{} {}: expected a whole number, {} or more", word, text, least));
    if (kept && *kept != *count)
      throw InputError(fmt::format("{0} {1} and {0} {2} contradict each other", word, *kept, text));
    kept = static_cast<int>(*count);
  }

  // Its steps, schemes and tolerances come from their lists.
  void check_study() const {
    if (line_.steps.empty() && line_.tolerances.empty())
      throw InputError(
          "'study' needs steps to run with: --steps 1e-1,1e-2,...; for hybrid alone also --tolerances");
    const auto clash = [&](const char* key, const char* word, bool listed) {
      for (std::size_t i = 0; i < said_.size(); ++i)
        if (listed && line_.overrides[i].first == key)
          throw InputError(fmt::format("{} contradicts {}; leave out one of them", said_[i], word));
    };
    clash("time.step", "--steps", !line_.steps.empty());
    clash("time.scheme", "--schemes", !line_.schemes.empty());
    clash("time.tolerance", "--tolerances", !line_.tolerances.empty());
  }

  void add_set(const std::string& text) {
    const std::size_t equals = text.find('=');
    if (equals == std::string::npos || equals == 0)
      throw InputError(fmt::format("--set {}: expected key=value, as in --set time.step=1e-3", text));
    add_override(text.substr(0, equals), text.substr(equals + 1), "--set " + text);
  }

  void add_override(const std::string& key, const std::string& value, const std::string& said) {
    for (std::size_t i = 0; i < line_.overrides.size(); ++i) {
      if (line_.overrides[i].first != key) continue;
      if (same_value(line_.overrides[i].second, value)) return;
      throw InputError(fmt::format("{} and {} contradict each other; give {} once", said_[i], said, key));
    }
    line_.overrides.emplace_back(key, value);
    said_.push_back(said);
  }

  std::span<const std::string> words_;  ///< what is left to read
  CommandLine line_;
  std::vector<std::string> said_;  ///< per override, how the user put it
};

std::string columns(const std::vector<std::pair<std::string, std::string>>& rows) {
  std::size_t width = 0;
  for (const auto& row : rows)
    width = std::max(width, row.first.size());
  std::string text;
  for (const auto& [left, right] : rows)
    text += fmt::format("  {:<{}}  {}\n", left, width, right);
  return text;
}

std::string general_help() {
  std::vector<std::pair<std::string, std::string>> rows;
  for (const VerbEntry& entry : verbs())
    rows.emplace_back(entry.operand.empty() ? entry.name : entry.name + " " + entry.operand, entry.text);
  return fmt::format(
      "sweepvi simulates nonsmooth dynamical systems; each step is a variational inequality solved with "
      "PETSc.\n"
      "\nUsage: [mpirun -n N] sweepvi VERB ...\n\n{}"
      "\nAs a service, without MPI:\n\n{}"
      "\n'sweepvi help VERB' lists the options of a verb.\n"
      "\nWords with one dash, except -o and -h, go to PETSc: -log_view, -snes_monitor, ... Our own among "
      "them start\n"
      "with -sweepvi_; -help after a scene lists those of the objects it builds.\n"
      "\nExit codes:\n{}",
      columns(rows), columns(service_verbs()),
      columns({{"0", "done; every step certified"},
               {"1", "internal error: a bug"},
               {"2", "bad usage, scene or data; nothing was computed or written"},
               {"3", "a step could not be solved or certified; the output holds everything before it"},
               {"4", "stopped by SIGUSR1, SIGTERM, SIGINT or --wall-limit; --restart goes on"},
               {"5", "output could not be written (disk full, no permission, existing file without --force)"},
               {"6", "done, but not certified: -sweepvi_certificate_rtol is above 1e-6"}}));
}

}  // namespace

CommandLine parse_command_line(const std::vector<std::string>& words) {
  const std::span<const std::string> all(words);
  if (words.empty()) return Parser(Verb::help, all).parse();
  const std::string& first = words[0];
  if (asks_for_help(first) || first == "help") {
    if (words.size() == 1 || is_option(words[1])) {
      CommandLine line = Parser(Verb::help, all.subspan(1)).parse();
      line.help_requested = asks_for_help(first) || line.help_requested;
      line.help_topic.reset();
      return line;
    }
    // `help run scene.toml` asks for the same as `run scene.toml --help`.
    std::vector<std::string> rest(words.begin() + 1, words.end());
    rest.emplace_back("--help");
    return parse_command_line(rest);
  }
  if (first == "--version") return Parser(Verb::info, all.subspan(1)).parse();
  std::vector<std::string> known;
  for (const VerbEntry& entry : verbs()) {
    if (entry.name == first) return Parser(entry.verb, all.subspan(1)).parse();
    known.push_back(entry.name);
  }
  for (const auto& [name, text] : service_verbs())
    known.push_back(name);
  if (is_option(first))
    throw InputError(fmt::format("'{}' comes before the verb; expected sweepvi VERB ...", first));
  if (first.ends_with(".toml"))
    throw InputError(fmt::format("'{0}' is no verb; did you mean 'sweepvi run {0}'?", first));
  throw InputError(fmt::format("unknown verb '{}'{}", first, suggestion(first, known)));
}

std::string help_text(std::optional<Verb> topic) {
  if (!topic || *topic == Verb::help) return general_help();
  const VerbEntry& verb = entry_of(*topic);
  std::vector<std::pair<std::string, std::string>> rows;
  for (const OptionEntry& option : options())
    if (option.built && takes(option, *topic))
      rows.emplace_back(option.value.empty() ? option.word : option.word + " " + option.value, option.text);
  if (*topic == Verb::run || *topic == Verb::check || *topic == Verb::study || *topic == Verb::bench)
    for (const Alias& alias : aliases())
      rows.emplace_back(alias.word + " VALUE", fmt::format("the same as --set {}=VALUE", alias.key));
  if (rows.empty()) return fmt::format("Usage: sweepvi {}\n\n{}\n", verb.name, verb.text);
  if (*topic == Verb::compare)
    return fmt::format(
        "Usage: [mpirun -n N] sweepvi {} {} [options]\n\n{}; writes nothing but --summary\n\n{}", verb.name,
        verb.operand, verb.text, columns(rows));
  return fmt::format(
      "Usage: sweepvi {} {} [options] [PETSc options]\n\n{}\n\n{}"
      "\nOther words with one dash go to PETSc; '-help' after {} lists those that apply, ours among them as\n"
      "-sweepvi_... File names here are relative to the working directory, those inside {} to its folder.\n",
      verb.name, verb.operand, verb.text, columns(rows), verb.operand, verb.operand);
}

}  // namespace sweepvi::app
