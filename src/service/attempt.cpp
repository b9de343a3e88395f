#include "service/attempt.hpp"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <system_error>

#include "io/output_file.hpp"
#include "service/digest.hpp"

namespace sweepvi::service {

using nlohmann::json;

void Attempt::write_order(const Order& order) const {
  const json text = {{"words", order.words},
                     {"file_bytes", order.file_bytes},
                     {"log_bytes", order.log_bytes},
                     {"seconds", order.seconds},
                     {"grace", order.grace}};
  write_output(folder_ / "order.json", text.dump(2) + "\n");
}

Order Attempt::order() const {
  const json text = json::parse(read_file(folder_ / "order.json").value_or(""));
  return {text.at("words"), text.at("file_bytes"), text.at("log_bytes"), text.at("seconds"),
          text.at("grace")};
}

// The lock is there before the name is: nobody can see a claim that is not held and take it for an old one.
Descriptor Attempt::claim() const {
  const auto fail = [&] { throw std::system_error(errno, std::generic_category(), folder_.string()); };
  std::filesystem::create_directory(folder_);  // a daemon may have died before it did
  const std::string temporary = (folder_ / ("claim-" + random_hex(8))).string();
  Descriptor file(open(temporary.c_str(), O_WRONLY | O_CREAT | O_EXCL | O_CLOEXEC, 0600));
  if (!file || flock(file.get(), LOCK_EX | LOCK_NB) != 0) fail();
  const bool first = link(temporary.c_str(), (folder_ / "claim").c_str()) == 0;
  const int error = errno;
  unlink(temporary.c_str());
  if (first) return file;
  if (error != EEXIST) throw std::system_error(error, std::generic_category(), folder_.string());
  return Descriptor();
}

bool Attempt::claimed() const {
  std::error_code failure;
  return std::filesystem::exists(folder_ / "claim", failure);
}

bool Attempt::alive() const {
  const Descriptor file(open((folder_ / "claim").c_str(), O_RDONLY | O_CLOEXEC));
  return file && flock(file.get(), LOCK_SH | LOCK_NB) != 0 && errno == EWOULDBLOCK;
}

void Attempt::beat(const Descriptor& claim) noexcept {
  futimens(claim.get(), nullptr);
}

double Attempt::last_beat() const {
  struct stat about {};
  if (stat((folder_ / "claim").c_str(), &about) != 0) return 0.0;
  return static_cast<double>(about.st_mtim.tv_sec) + 1e-9 * static_cast<double>(about.st_mtim.tv_nsec);
}

void Attempt::note_scratch(const std::filesystem::path& path) const {
  std::filesystem::create_symlink(path, folder_ / "scratch");
}

void Attempt::remove_scratch() const noexcept {
  std::error_code failure;
  const std::filesystem::path path = std::filesystem::read_symlink(folder_ / "scratch", failure);
  if (!failure) std::filesystem::remove_all(path, failure);
}

void Attempt::ask_to_stop() const {
  const std::filesystem::path path = folder_ / "stop";
  const Descriptor file(open(path.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
  if (!file) throw std::system_error(errno, std::generic_category(), path.string());
}

bool Attempt::asked_to_stop() const {
  return access((folder_ / "stop").c_str(), F_OK) == 0;
}

void Attempt::write_ending(const Ending& ending) const {
  const auto number = [](const std::optional<int>& value) { return value ? json(*value) : json(); };
  const json text = {{"code", number(ending.code)}, {"signal", number(ending.signal)},
                     {"asked", ending.asked},       {"late", ending.late},
                     {"forced", ending.forced},     {"started", ending.started},
                     {"finished", ending.finished}, {"log_from", ending.log_from},
                     {"bytes", ending.bytes},       {"sha256", ending.sha256}};
  write_output(folder_ / "ending.json", text.dump(2) + "\n");
}

std::optional<Ending> Attempt::ending() const {
  const std::optional<std::string> file = read_file(folder_ / "ending.json");
  if (!file) return std::nullopt;
  const json text = json::parse(*file, nullptr, false);
  const auto number = [&](const char* key) {
    return text.at(key).is_null() ? std::optional<int>() : std::optional(text.at(key).get<int>());
  };
  try {
    return Ending{number("code"),    number("signal"),   text.at("asked"),    text.at("late"),
                  text.at("forced"), text.at("started"), text.at("finished"), text.at("log_from"),
                  text.at("bytes"),  text.at("sha256")};
  } catch (const json::exception&) {  // damaged: nobody knows how it ended
    return std::nullopt;
  }
}

}  // namespace sweepvi::service
