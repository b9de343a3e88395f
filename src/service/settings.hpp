#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "service/user.hpp"

namespace sweepvi::service {

/// How one daemon works; from the words of `sweepvi serve`.
struct Settings {
  std::string listen = "127.0.0.1:8750";    ///< host:port, or unix:/path
  std::filesystem::path data;               ///< everything it keeps
  std::filesystem::path program;            ///< sweepvi
  std::filesystem::path plot;               ///< draws results; empty: there are no pictures
  std::vector<User> users = {everybody()};  ///< at least one; its token empty: none is asked for
  std::string launcher = "mpirun";
  std::vector<std::string> launcher_words;  ///< more words for mpirun or sbatch

  int cores = 1;                          ///< of all jobs that run at once
  std::int64_t body = 256LL << 20;        ///< of a request [B]
  std::int64_t jobs = 10000;              ///< that are kept
  std::int64_t disk = 100LL << 30;        ///< of all jobs [B]
  std::int64_t job_disk = 20LL << 30;     ///< of one job [B]
  std::int64_t memory = 0;                ///< address space of a rank, at most [B]; 0: no limit
  double wall = 0.0;                      ///< of an attempt, at most [s]; 0: no limit
  double grace = 30.0;                    ///< between SIGUSR1, SIGTERM and SIGKILL [s]
  int check_seconds = 60;                 ///< for `sweepvi check`
  std::int64_t check_memory = 8LL << 30;  ///< the same [B]
  int threads = 64;                       ///< connections at once

  bool open() const { return users.front().token.empty(); }  ///< no token is asked for
  bool on_socket() const { return listen.starts_with("unix:"); }
  std::string host() const;
  int port() const;
  bool on_loopback() const;
};

/// Where the queue and its jobs are unless --data says so. @throws UsageError
std::filesystem::path default_data();

/// @throws UsageError for words that make no sense together, a token file that others may read, ...
Settings read_settings(const std::vector<std::string>& words);

std::string serve_help();

}  // namespace sweepvi::service
