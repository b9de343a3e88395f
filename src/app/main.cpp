// The program: command line -> verb -> exit code. MPI, PETSc and every handle end before main returns.
#include <fmt/format.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

#include "app/command_line.hpp"
#include "app/sandbox.hpp"
#include "app/service_verbs.hpp"
#include "app/verbs.hpp"
#include "app/watch.hpp"
#include "io/output_file.hpp"
#include "io/printable.hpp"
#include "io/table_file.hpp"
#include "sweepvi/petsc.hpp"

namespace {

using namespace sweepvi;

ExitCode act(MPI_Comm comm, int rank, const app::CommandLine& line) {
  if (line.help_requested && line.scene.empty()) {
    if (rank == 0)
      std::fputs(app::help_text(line.verb == app::Verb::help ? line.help_topic : line.verb).c_str(), stdout);
    return ExitCode::done;
  }
  switch (line.verb) {
    case app::Verb::run:
      return app::run(comm, line);
    case app::Verb::check:
      return app::check_scene(comm, line);
    case app::Verb::solve:
      return app::solve(comm, line);
    case app::Verb::compare:
      return app::compare(comm, line);
    case app::Verb::study:
      return app::study(comm, line);
    case app::Verb::bench:
      return app::bench(comm, line);
    case app::Verb::info:
      return app::info(comm);
    case app::Verb::help:
      break;
  }
  if (rank == 0) std::fputs(app::help_text(line.help_topic).c_str(), stdout);
  return ExitCode::done;
}

/// Most that this process has had of it so far [B].
double peak_address_space() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.starts_with("VmPeak:")) return 1024.0 * std::strtod(line.c_str() + 7, nullptr);
  return 0.0;
}

/// Whoever runs out of `ulimit -v` fails anywhere, and rarely says why.
std::string memory_hint() {
  rlimit limit{};
  if (getrlimit(RLIMIT_AS, &limit) != 0 || limit.rlim_cur == RLIM_INFINITY) return {};
  const double most = static_cast<double>(limit.rlim_cur);
  const double peak = peak_address_space();
  constexpr double much = 0.3;  // one large piece may have been asked for
  if (peak < much * most) return {};
  return fmt::format(
      ". It had taken {:.0f} MB of the {:.0f} MB of memory that ulimit -v leaves it: perhaps not enough",
      peak / 1e6, most / 1e6);
}

/// Whoever reads it may have gone away, or its disk may be full: then nobody may take the exit code for a
/// success.
void check_output() {
  try {
    flush_standard_output();
  } catch (const std::system_error& error) {
    throw Error(ExitCode::output, "standard output could not be written: " + error.code().message());
  }
}

void complain(int rank, const char* message) {
  if (rank == 0) std::fprintf(stderr, "sweepvi: %s\n", printable(message).c_str());
}

}  // namespace

int main(int argc, char** argv) {
  app::CommandLine line;
  std::optional<Error> bad_usage;
  std::optional<app::Sandbox> sandbox;  // goes after MPI
  try {
    const std::vector<std::string> given(argv + 1, argv + argc);
    app::become_service(given);
    line = app::parse_command_line(given);
    if (line.confine) {
      const std::vector<std::string> listed = app::confine(line);
      sandbox.emplace(app::paths_of(line, listed));
    }
  } catch (const Error& error) {
    bad_usage = error;
  }
  std::vector<std::string> words = bad_usage ? std::vector<std::string>{} : line.petsc_words;
  if (line.help_requested && !line.scene.empty()) words.emplace_back("-help");

  const bool runs = line.verb == app::Verb::run;
  if (runs) app::note_signals();  // MPI and PETSc take their time to start
  signal(SIGXFSZ, SIG_IGN);       // a file at its size limit is a failed write, not a death,
  signal(SIGPIPE, SIG_IGN);       // and so is a pipe that nobody reads
  // All that a verb prints, unless somebody watches: it is lost or not when it is flushed, and rank 0 alone
  // knows.
  if (isatty(STDOUT_FILENO) == 0) setvbuf(stdout, nullptr, _IOFBF, std::size_t{1} << 20U);
  ExitCode code = ExitCode::internal;
  std::optional<Session> opened;
  try {
    opened.emplace(argv[0], words);
  } catch (const Error& error) {  // an option that PetscInitialize itself refuses; there is no rank to ask
    std::fprintf(stderr, "sweepvi: %s\n", printable(error.what()).c_str());
    return static_cast<int>(error.code());
  }
  Session& session = *opened;
  if (runs) app::note_signals();  // again: MPI may have caught some itself
  int rank = 0;
  MPI_Comm_rank(session.comm(), &rank);
  if (bad_usage) {
    complain(rank, bad_usage->what());
    return static_cast<int>(bad_usage->code());
  }
  try {
    if (sandbox) sandbox->close();
    code = act(session.comm(), rank, line);
    agreed(session.comm(), [&] {
      if (rank == 0) check_output();
    });
  } catch (const Error& error) {
    code = error.code();
    if (code == ExitCode::internal || TableFile::damaged()) {
      // Perhaps only this rank is here; the others must not wait for it.
      std::fprintf(stderr, "sweepvi: [rank %d] %s%s\n", rank, printable(error.what()).c_str(),
                   memory_hint().c_str());
      MPI_Abort(session.comm(), static_cast<int>(code));
    }
    complain(rank, error.what());
  } catch (const std::exception& error) {
    const bool not_printed = std::ferror(stdout) != 0;
    std::fprintf(stderr, "sweepvi: [rank %d] %s: %s%s\n", rank,
                 not_printed ? "standard output could not be written" : "internal error",
                 printable(error.what()).c_str(), memory_hint().c_str());
    MPI_Abort(session.comm(), static_cast<int>(not_printed ? ExitCode::output : ExitCode::internal));
  }
  opened.reset();  // PETSc may print at its end: -log_view
  try {
    if (code == ExitCode::done) check_output();
  } catch (const Error& error) {
    complain(rank, error.what());
    code = error.code();
  }
  return static_cast<int>(code);
}
