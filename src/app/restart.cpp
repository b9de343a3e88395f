#include "app/restart.hpp"

#include <fmt/format.h>

#include <filesystem>
#include <utility>

#include "parallel/gather.hpp"

namespace sweepvi::app {

namespace fs = std::filesystem;

namespace {

constexpr const char* suffix = ".checkpoint";
constexpr const char* while_running = ".partial";
constexpr const char* while_restarted = ".restart";  // RowSource::partial_beside

bool same_file(const fs::path& a, const fs::path& b) {
  std::error_code failure;
  return fs::weakly_canonical(a, failure) == fs::weakly_canonical(b, failure);
}

/// The name without `.checkpoint`, if it ends so.
std::string output_of(const std::string& path) {
  const std::string end = suffix;
  return path.ends_with(end) ? path.substr(0, path.size() - end.size()) : path;
}

/// Refuses a scene that is not the checkpoint's, and says where they differ.
void compare_scenes(const std::string& path, const std::map<std::string, std::string>& before,
                    const std::map<std::string, std::string>& now) {
  const auto refuse = [&](const std::string& key, const std::string& was, const std::string& is) {
    throw InputError(
        fmt::format("{}: a checkpoint of another scene: {} was {}, here it is {}; go on with the scene and "
                    "the --set that it was written with",
                    path, key, was, is));
  };
  for (const auto& [key, value] : before) {
    const auto at = now.find(key);
    if (at == now.end()) refuse(key, value, "not set");
    if (at->second != value) refuse(key, value, at->second);
  }
  for (const auto& [key, value] : now)
    if (!before.contains(key)) refuse(key, "not set", value);
}

std::string shared(MPI_Comm comm, const std::string& text) {
  std::vector<char> bytes(text.begin(), text.end());
  broadcast(comm, bytes);
  return {bytes.begin(), bytes.end()};
}

}  // namespace

Restart::Restart(MPI_Comm comm, const std::string& path, const std::map<std::string, std::string>& scene)
    : comm_(comm), path_(path) {
  MPI_Comm_rank(comm_, &rank_);
  std::int64_t facts[2] = {0, 0};
  std::string started;
  agreed(comm_, [&] {
    if (rank_ != 0) return;
    data_ = read_checkpoint(path_);
    try {
      compare_scenes(path_, data_.facts.at("scene").get<std::map<std::string, std::string>>(), scene);
      facts[0] = data_.facts.at("steps").get<std::int64_t>();
      facts[1] = path_.ends_with(suffix) ? 0 : 1;
      started = data_.facts.at("started").get<std::string>();
    } catch (const nlohmann::json::exception& error) {
      throw InputError(fmt::format("{}: the checkpoint was written by another version of this program: {}",
                                   path_, error.what()));
    }
  });
  MPI_Bcast(facts, 2, MPI_INT64_T, 0, comm_);
  steps_done_ = facts[0];
  stopped_file_ = facts[1] != 0;
  started_ = shared(comm_, started);
}

void Restart::put_state(Case& model) const {
  restore_state(
      comm_, [&](StateVisitor& visitor) { model.dvi().visit(visitor); }, model.state_order(), model.form(),
      data_);
}

void Restart::put_state(Case& model, TimeMarch& march) const {
  restore_state(
      comm_, [&](StateVisitor& visitor) { march.visit_hybrid(visitor); }, model.state_order(), model.form(),
      data_);
}

// A killed writer may have renamed its file and not said so yet.
void Restart::open_rows() {
  TableMark mark;
  agreed(comm_, [&] {
    if (rank_ != 0) return;
    try {
      mark = data_.mark();
    } catch (const std::exception& error) {
      throw InputError(fmt::format("{}: the checkpoint was written by another version of this program: {}",
                                   path_, error.what()));
    }
  });
  const std::string name = fs::path(output_of(path_)).filename().string();
  if (stopped_file_) mark.file = name;
  rows_ = std::make_unique<RowSource>(
      comm_, fs::path(path_).parent_path().string(), std::move(mark),
      std::vector<std::string>{name + while_running, name + while_restarted, name});
}

bool Restart::may_replace(const std::string& output) const {
  return same_file(output, rows_->path()) || same_file(output, path_) || same_file(output, output_of(path_));
}

std::unique_ptr<Recorder> Restart::recorder(const std::string& output, bool force, const TimeSpec& time,
                                            std::int64_t every, const Dvi& dvi, Recording recording) {
  const std::string partial = rows_->partial_beside(output);
  beside_ = partial != output + while_running;
  return std::make_unique<Recorder>(output, force || may_replace(output), time, every, dvi,
                                    std::move(recording), Recorder::Resume{*rows_, data_, partial});
}

void Restart::put_counts(Summary& summary) const {
  std::vector<std::int64_t> counts;
  std::vector<double> measures;
  agreed(comm_, [&] {
    if (rank_ != 0) return;
    try {
      counts = data_.facts.at("counts").get<std::vector<std::int64_t>>();
      measures = data_.numbers.at("measures");
    } catch (const std::exception&) {
      counts.clear();
    }
    if (!Summary::fits(counts, measures))
      throw InputError(path_ + ": the counts of the checkpoint were written by another version");
  });
  broadcast(comm_, counts);
  broadcast(comm_, measures);
  summary.go_on_from(counts, measures);
}

void Restart::release_rows(const std::string& output, Recorder& recorder) {
  const std::string old = rows_->path();
  if (beside_) {
    recorder.file().rename_partial();
  } else if (same_file(old, output + while_restarted)) {
    std::error_code failure;
    if (rank_ == 0) fs::remove(old, failure);
  }
  rows_.reset();
}

Checkpointing::Checkpointing(MPI_Comm comm, const std::string& output,
                             std::map<std::string, std::string> scene, std::string started)
    : comm_(comm), file_(output + suffix), scene_(std::move(scene)), started_(std::move(started)) {
  MPI_Comm_rank(comm_, &rank_);
}

CheckpointData Checkpointing::collect(Case& model, TimeMarch& march, Recorder& recorder,
                                      const Summary& summary) const {
  CheckpointData data;
  data.facts["scene"] = scene_;
  data.facts["steps"] = summary.steps;
  data.facts["started"] = started_;
  const auto [counts, measures] = summary.to_go_on(comm_);
  data.facts["counts"] = counts;
  data.numbers["measures"] = measures;
  const auto show = [&](StateVisitor& visitor) {
    model.dvi().visit(visitor);
    march.visit_hybrid(visitor);
  };
  save_state(comm_, show, model.state_order(), model.form(), data);
  recorder.save(data);
  return data;
}

void Checkpointing::reserve(const CheckpointData& data) {
  agreed(comm_, [&] {
    if (rank_ == 0) file_.reserve(encode(data).size());
  });
}

void Checkpointing::write(const CheckpointData& data) {
  agreed(comm_, [&] {
    if (rank_ == 0) file_.write(encode(data));
  });
}

void Checkpointing::remove() const {
  agreed(comm_, [&] {
    if (rank_ == 0) file_.remove();
  });
}

}  // namespace sweepvi::app
