#pragma once

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "baker/files/upload.h"
#include "proto/expected.h"
#include "proto/scene_name.h"
#include "server/data/data_folder.h"

namespace kiln::data {

/// A file that has arrived whole and lies in a SceneUpload's folder.
struct UploadedFile {
  std::string name;  ///< as the client sent it; "" for the main file
  std::filesystem::path path;
  std::uint64_t bytes = 0;
  std::string sha256;
};

/// The files of one upload, in a folder of their own under tmp/ that goes with this object.
class SceneUpload {
 public:
  static proto::Expected<SceneUpload> create(const DataFolder&);
  SceneUpload(SceneUpload&&) noexcept = default;
  SceneUpload& operator=(SceneUpload&&) = delete;
  ~SceneUpload();

  const std::filesystem::path& folder() const { return folder_; }
  std::filesystem::path next_path();  ///< for the next file's content
  files::SceneFiles files() const;    ///< what the importer reads

  std::optional<UploadedFile> main;
  std::vector<UploadedFile> side;

 private:
  explicit SceneUpload(std::filesystem::path folder) : folder_(std::move(folder)) {}
  std::filesystem::path folder_;
  int next_ = 0;
};

/// A stored scene: the main file and its side files. Immutable.
struct StoredScene {
  std::string key;  ///< 64 hexadecimal digits: the scene's name in the API
  std::string main_sha256;
  std::uint64_t bytes = 0;  ///< of all files together
  std::uint64_t side_files = 0;
  files::SceneFiles files;
};

/// Scenes named by content (proto::SceneName), whose index is kept beside the files.
class SceneStore {
 public:
  explicit SceneStore(const DataFolder& data) : data_(data) {}

  struct Put {
    StoredScene scene;
    bool created = false;  ///< false: the content was known
  };
  /// Moves an upload in; durable when it returns. Callable from many threads.
  proto::Expected<Put> put(SceneUpload&&) const;
  /// Errors: `not_found`.
  proto::Expected<StoredScene> find(const std::string& key) const;
  /// find() for a job to come: collect() leaves the scene alone for a while. Same errors.
  proto::Expected<StoredScene> use(const std::string& key) const;
  /// Removes the scenes that were neither put nor used for `age` and that `is_named` does not know.
  /// Returns their keys.
  std::vector<std::string> collect(
      std::chrono::seconds age, const std::function<bool(const std::string& key)>& is_named) const;

 private:
  const DataFolder& data_;
  mutable std::mutex mutex_;  ///< between use() and collect(): a scene is marked, or gone
};

/// Returns the name that an upload will have.
proto::SceneName identify_scene(const std::string& main_sha256,
                                const std::vector<UploadedFile>& side);

}  // namespace kiln::data
