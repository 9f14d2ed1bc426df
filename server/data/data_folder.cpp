#include "server/data/data_folder.h"

#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <set>
#include <system_error>

namespace kiln::data {
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
  for (const char* name : {"scenes", "jobs", "uploads", "tmp"})
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

proto::Expected<void> DataFolder::link_results(const std::string& from, const std::string& to,
                                               const std::vector<proto::ResultFile>& files) const {
  if (auto made = make_folder(results(to)); !made) return made;
  for (const auto& file : files) {
    std::error_code error;
    fs::create_hard_link(results(from) / file.name, results(to) / file.name, error);
    if (!error) continue;
    errno = error.value();
    return proto::storage_error("link", results(from) / file.name);
  }
  if (auto ok = proto::sync_folder(results(to)); !ok) return ok;
  if (auto ok = proto::sync_folder(job(to)); !ok) return ok;
  return proto::sync_folder(root_ / "jobs");
}

std::vector<std::string> DataFolder::job_folders() const {
  std::vector<std::string> names;
  std::error_code error;
  for (fs::directory_iterator at(root_ / "jobs", error), end; !error && at != end;
       at.increment(error))
    names.push_back(at->path().filename().string());
  return names;
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

std::uint64_t DataFolder::bytes() const {
  std::uint64_t total = 0;
  std::set<ino_t> counted;
  for (const auto& folder : {scenes(), root_ / "jobs", uploads()}) {
    std::error_code error;
    for (fs::recursive_directory_iterator at(folder, error), end; !error && at != end;
         at.increment(error)) {
      struct stat info {};
      if (::lstat(at->path().c_str(), &info) != 0 || !S_ISREG(info.st_mode)) continue;
      if (info.st_nlink == 1 || counted.insert(info.st_ino).second)
        total += static_cast<std::uint64_t>(info.st_size);
    }
  }
  return total;
}

double DataFolder::free_share() const {
  std::error_code error;
  const auto space = fs::space(root_, error);
  if (error || space.capacity == 0) return 0;
  return static_cast<double>(space.available) / static_cast<double>(space.capacity);
}

}  // namespace kiln::data
