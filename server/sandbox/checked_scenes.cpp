#include "server/sandbox/checked_scenes.h"

#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <utility>

namespace kiln::sandbox {
namespace {

constexpr auto kKeptFor = std::chrono::seconds(15);
constexpr std::size_t kMostKept = 8;

/// Appends what tells a file from others. False when it can't be read.
bool add_identity(std::string& out, const std::string& name, const std::filesystem::path& path) {
  struct stat file {};
  if (::stat(path.c_str(), &file) != 0) return false;
  out += std::to_string(name.size()) + ":" + name;
  for (const std::uint64_t number :
       {std::uint64_t(file.st_dev), std::uint64_t(file.st_ino), std::uint64_t(file.st_size),
        std::uint64_t(file.st_mtim.tv_sec), std::uint64_t(file.st_mtim.tv_nsec)})
    out += " " + std::to_string(number);
  out += "\n";
  return true;
}

}  // namespace

CheckedScene::~CheckedScene() {
  if (!temporary.empty()) ::unlink(temporary.c_str());
}

std::string identity_of(const files::SceneFiles& files) {
  std::string out;
  if (!add_identity(out, "", files.main)) return "";
  for (const auto& [name, path] : files.side)
    if (!add_identity(out, name, path)) return "";
  return out + (files.sky_map ? "sky " + *files.sky_map : "");
}

CheckedScenes::CheckedScenes()
    : dropper_([this](const std::stop_token& stop) { drop_in_time(stop); }) {}

void CheckedScenes::put(std::unique_ptr<CheckedScene> scene) {
  std::list<Kept> dropped;  // destroyed without the lock: that waits for a process
  {
    const std::lock_guard lock(mutex_);
    kept_.push_back({Clock::now() + kKeptFor, std::move(scene)});
    if (kept_.size() > kMostKept) dropped.splice(dropped.begin(), kept_, kept_.begin());
  }
  changed_.notify_all();
}

std::unique_ptr<CheckedScene> CheckedScenes::take(const std::string& files) {
  const std::lock_guard lock(mutex_);
  const auto found = std::find_if(kept_.begin(), kept_.end(),
                                  [&](const Kept& k) { return k.scene->files == files; });
  if (files.empty() || found == kept_.end()) return nullptr;
  auto scene = std::move(found->scene);
  kept_.erase(found);
  return scene;
}

bool CheckedScenes::drop_oldest() {
  std::list<Kept> dropped;
  {
    const std::lock_guard lock(mutex_);
    if (kept_.empty()) return false;
    dropped.splice(dropped.begin(), kept_, kept_.begin());
  }
  return true;
}

void CheckedScenes::drop_in_time(const std::stop_token& stop) {
  std::unique_lock lock(mutex_);
  while (!stop.stop_requested()) {
    if (kept_.empty()) {
      changed_.wait(lock, stop, [&] { return !kept_.empty(); });
      continue;
    }
    const auto until = kept_.front().until;
    if (Clock::now() < until) {
      changed_.wait_until(lock, stop, until, [] { return false; });
      continue;
    }
    std::list<Kept> dropped;
    dropped.splice(dropped.begin(), kept_, kept_.begin());
    lock.unlock();
    dropped.clear();
    lock.lock();
  }
}

}  // namespace kiln::sandbox
