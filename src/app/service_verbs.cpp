#include "app/service_verbs.hpp"

#include <unistd.h>

#include <algorithm>
#include <filesystem>

#include "sweepvi/error.hpp"

namespace sweepvi::app {

const std::vector<std::pair<std::string, std::string>>& service_verbs() {
  static const std::vector<std::pair<std::string, std::string>> verbs = {
      {"serve", "queue and run what others hand in over HTTP"},
      {"fsck", "say what is wrong with a server's data folder, and mend it"},
      {"submit", "hand in a run, solve or study to a server, with the words it has here"},
      {"jobs", "list the jobs of a server"},
      {"watch", "follow a job until it ends"},
      {"fetch", "download the result of a job"},
      {"cancel", "stop a job, with a checkpoint"},
      {"resume", "go on with a job that did not come to its end"}};
  return verbs;
}

void become_service(const std::vector<std::string>& words) {
  const bool asks = words.size() > 1 && (words[0] == "help" || words[0] == "--help" || words[0] == "-h");
  const std::string verb = asks ? words[1] : words.empty() ? "" : words[0];
  const auto& verbs = service_verbs();
  if (std::none_of(verbs.begin(), verbs.end(), [&](const auto& entry) { return entry.first == verb; }))
    return;
  const std::filesystem::path program =
      std::filesystem::read_symlink("/proc/self/exe").parent_path() / "sweepvi-serve";
  std::vector<std::string> all = words;
  if (asks) all = {verb, "--help"};
  all.insert(all.begin(), program.string());
  std::vector<char*> argv;
  argv.reserve(all.size() + 1);
  for (std::string& word : all)
    argv.push_back(word.data());
  argv.push_back(nullptr);
  execv(argv[0], argv.data());
  throw InputError("'" + verb + "' needs " + program.string() + ", which cannot be started");
}

}  // namespace sweepvi::app
