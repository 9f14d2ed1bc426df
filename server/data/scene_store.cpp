#include "server/data/scene_store.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <fstream>
#include <sstream>
#include <system_error>

namespace kiln::data {
namespace fs = std::filesystem;
namespace {

constexpr std::uint64_t kMaxIndexBytes = 1 << 20;

/// The importer goes by content; the suffix is for people who look into the folder.
const char* main_name(const fs::path& file) {
  std::array<char, 4> magic{};
  std::ifstream(file, std::ios::binary).read(magic.data(), magic.size());
  return std::string_view(magic.data(), magic.size()) == "glTF" ? "scene.glb" : "scene.gltf";
}

std::string side_name(std::size_t i) {
  return "side_" + std::to_string(i);
}

void sort_by_name(std::vector<UploadedFile>& side) {
  std::sort(side.begin(), side.end(),
            [](const UploadedFile& a, const UploadedFile& b) { return a.name < b.name; });
}

proto::Expected<void> rename_path(const fs::path& from, const fs::path& to) {
  std::error_code error;
  fs::rename(from, to, error);
  if (!error) return {};
  errno = error.value();
  return proto::storage_error("rename", from);
}

}  // namespace

proto::Expected<SceneUpload> SceneUpload::create(const DataFolder& data) {
  const fs::path folder = data.new_temporary();
  std::error_code error;
  fs::create_directory(folder, error);
  if (error) {
    errno = error.value();
    return proto::storage_error("create the folder", folder);
  }
  return SceneUpload(folder);
}

SceneUpload::~SceneUpload() {
  std::error_code error;
  if (!folder_.empty()) fs::remove_all(folder_, error);
}

fs::path SceneUpload::next_path() {
  return folder_ / ("file_" + std::to_string(next_++));
}

files::SceneFiles SceneUpload::files() const {
  files::SceneFiles files;
  if (main) files.main = main->path;
  for (const auto& file : side) files.side[file.name] = file.path;
  return files;
}

proto::SceneName identify_scene(const std::string& main_sha256,
                                const std::vector<UploadedFile>& side) {
  std::vector<proto::SideDigest> digests;
  for (const auto& file : side) digests.push_back({file.name, file.sha256});
  return proto::scene_name(main_sha256, std::move(digests));
}

proto::Expected<SceneStore::Put> SceneStore::put(SceneUpload&& upload) const {
  const proto::SceneName identity = identify_scene(upload.main->sha256, upload.side);
  if (auto known = use(identity.key)) return Put{std::move(*known), false};

  sort_by_name(upload.side);
  const fs::path main = upload.main->path;
  if (auto ok = rename_path(main, upload.folder() / main_name(main)); !ok)
    return proto::Unexpected(ok.error());
  for (std::size_t i = 0; i < upload.side.size(); ++i)
    if (auto ok = rename_path(upload.side[i].path, upload.folder() / side_name(i)); !ok)
      return proto::Unexpected(ok.error());
  if (auto ok = proto::write_bytes(upload.folder() / "index", identity.index); !ok)
    return proto::Unexpected(ok.error());

  std::error_code error;
  fs::rename(upload.folder(), data_.scenes() / identity.key, error);
  const bool lost_race = error == std::errc::directory_not_empty || error == std::errc::file_exists;
  if (error && !lost_race) {
    errno = error.value();
    return proto::storage_error("rename", upload.folder());
  }
  if (auto ok = proto::sync_folder(data_.scenes()); !ok) return proto::Unexpected(ok.error());
  auto stored = use(identity.key);
  if (!stored) return proto::Unexpected(stored.error());
  return Put{std::move(*stored), !lost_race};
}

proto::Expected<StoredScene> SceneStore::find(const std::string& key) const {
  const auto missing = [&] {
    return proto::fail("not_found", "There is no scene sha256:" + key + ".");
  };
  if (!proto::is_sha256(key)) return missing();
  const fs::path folder = data_.scenes() / key;
  std::error_code error;
  if (!fs::exists(folder / "index", error)) return missing();
  auto index = proto::read_file(folder / "index", kMaxIndexBytes);
  if (!index) return proto::Unexpected(index.error());

  StoredScene scene;
  scene.key = key;
  std::istringstream lines(*index);
  std::string line;
  while (std::getline(lines, line)) {
    if (line.size() < 66)
      return proto::fail("internal", "The index of scene " + key + " is damaged.");
    fs::path file;
    if (scene.main_sha256.empty()) {
      scene.main_sha256 = line.substr(0, 64);
      const bool binary = fs::exists(folder / "scene.glb", error);
      file = scene.files.main = folder / (binary ? "scene.glb" : "scene.gltf");
    } else {
      file = folder / side_name(scene.side_files++);
      scene.files.side[line.substr(66)] = file;
    }
    scene.bytes += fs::file_size(file, error);
    if (error) return proto::fail("internal", "A file of scene " + key + " is missing.");
  }
  return scene;
}

proto::Expected<StoredScene> SceneStore::use(const std::string& key) const {
  const std::lock_guard lock(mutex_);
  auto scene = find(key);
  if (!scene) return scene;
  std::error_code error;
  fs::last_write_time(data_.scenes() / key, fs::file_time_type::clock::now(), error);
  if (!error) return scene;
  errno = error.value();
  return proto::storage_error("mark", data_.scenes() / key);
}

std::vector<std::string> SceneStore::collect(
    std::chrono::seconds age, const std::function<bool(const std::string&)>& is_named) const {
  std::vector<std::string> collected;
  std::error_code error;
  for (fs::directory_iterator at(data_.scenes(), error), end; !error && at != end;
       at.increment(error)) {
    const std::string key = at->path().filename().string();
    const fs::path away = data_.new_temporary();
    std::error_code failed;
    {
      const std::lock_guard lock(mutex_);
      const auto used = fs::last_write_time(at->path(), failed);
      if (failed || fs::file_time_type::clock::now() - used < age || is_named(key)) continue;
      fs::rename(at->path(), away, failed);
    }
    if (failed) continue;
    fs::remove_all(away, failed);
    collected.push_back(key);
  }
  return collected;
}

}  // namespace kiln::data
