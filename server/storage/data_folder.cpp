#include "server/storage/data_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <system_error>

namespace kiln::server {
namespace fs = std::filesystem;
namespace {

proto::Expected<void> make_folder(const fs::path& path) {
  std::error_code error;
  fs::create_directories(path, error);
  if (!error) return {};
  errno = error.value();
  return proto::storage_error("create the folder", path);
}

}  // namespace

proto::Expected<DataFolder> DataFolder::open(const fs::path& path) {
  if (auto made = make_folder(path); !made) return proto::Unexpected(made.error());
  const fs::path root = fs::absolute(path).lexically_normal();
  proto::Fd lock(::open((root / "lock").c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0600));
  if (!lock.valid()) return proto::storage_error("open", root / "lock");
  if (::flock(lock.get(), LOCK_EX | LOCK_NB) != 0)
    return proto::fail("data_folder_in_use", "The data folder " + root.string() +
                                                 " is in use by another lightkiln server.");
  std::error_code ignored_when_absent;
  fs::remove_all(root / "tmp", ignored_when_absent);
  for (const char* name : {"scenes", "jobs", "tmp"})
    if (auto made = make_folder(root / name); !made) return proto::Unexpected(made.error());
  if (auto ok = proto::sync_folder(root); !ok) return proto::Unexpected(ok.error());
  return DataFolder(root, std::move(lock));
}

proto::Expected<void> DataFolder::make_job_folders(const std::string& id) const {
  std::error_code error;
  fs::remove_all(results(id), error);
  if (auto made = make_folder(results(id)); !made) return made;
  return make_folder(checkpoints(id));
}

void DataFolder::remove_job(const std::string& id) const {
  std::error_code error;
  fs::remove_all(job(id), error);
}

void DataFolder::remove_checkpoints(const std::string& id) const {
  std::error_code error;
  fs::remove_all(checkpoints(id), error);
}

fs::path DataFolder::new_temporary() const {
  static std::atomic<std::uint64_t> counter{0};
  return temporary() / ("u" + std::to_string(++counter));
}

bool DataFolder::writable() const {
  const fs::path probe = new_temporary();
  const proto::Fd fd(::open(probe.c_str(), O_CREAT | O_EXCL | O_WRONLY | O_CLOEXEC, 0600));
  if (!fd.valid()) return false;
  const bool written = ::write(fd.get(), "x", 1) == 1;
  ::unlink(probe.c_str());
  return written;
}

double DataFolder::free_share() const {
  std::error_code error;
  const auto space = fs::space(root_, error);
  if (error || space.capacity == 0) return 0;
  return static_cast<double>(space.available) / static_cast<double>(space.capacity);
}

}  // namespace kiln::server
