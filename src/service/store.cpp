#include "service/store.hpp"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>

#include <algorithm>
#include <system_error>

#include "service/digest.hpp"
#include "service/refusal.hpp"

namespace sweepvi::service {

namespace fs = std::filesystem;

Store::Store(fs::path folder) : folder_(std::move(folder)) {
  umask(077);
  fs::create_directories(folder_);
  fs::permissions(folder_, fs::perms::owner_all);
  lock_ = Descriptor(open((folder_ / "lock").c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0600));
  if (!lock_) throw std::system_error(errno, std::generic_category(), folder_.string());
  if (flock(lock_.get(), LOCK_EX | LOCK_NB) != 0)
    throw UsageError(fmt::format("{}: another daemon works here; choose another --data", folder_.string()));
  fs::create_directories(folder_ / "jobs");
  fs::create_directories(folder_ / "incoming");
}

fs::path Store::receive() const {
  fs::path folder = folder_ / "incoming" / random_hex(16);
  fs::create_directory(folder);
  return folder;
}

void Store::keep(const fs::path& incoming, std::int64_t id) const {
  fs::rename(incoming, job(id));
}

void Store::remove(std::int64_t id) const {
  fs::remove_all(job(id));
}

void Store::discard(const fs::path& incoming) noexcept {
  std::error_code failure;
  fs::remove_all(incoming, failure);
}

void Store::clean(const std::vector<std::int64_t>& ids) const {
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_ / "incoming"))
    fs::remove_all(entry.path());
  for (const fs::directory_entry& entry : fs::directory_iterator(folder_ / "jobs")) {
    const std::string name = entry.path().filename();
    const bool known =
        std::any_of(ids.begin(), ids.end(), [&](std::int64_t id) { return std::to_string(id) == name; });
    if (!known) fs::remove_all(entry.path());
  }
}

}  // namespace sweepvi::service
