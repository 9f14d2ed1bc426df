#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "baker/files/mapped_file.h"
#include "baker/files/upload.h"
#include "baker/gltf/warnings.h"
#include "proto/expected.h"

namespace tinygltf {
class Model;
}

namespace kiln::gltf {

/// Files of one upload, each mapped once, within one budget of bytes.
class FileCache {
 public:
  FileCache(const files::SceneFiles& files, std::uint64_t max_bytes)
      : files_(files), left_(max_bytes) {}

  proto::Expected<std::string_view> main_file();
  /// Where the file of a URI lies. Errors: those of find_side_file.
  proto::Expected<std::filesystem::path> find(const std::string& uri,
                                              const std::string& pointer) const;
  /// Errors: those of find_side_file, `limit_exceeded`.
  proto::Expected<std::string_view> side_file(const std::string& uri, const std::string& pointer);
  /// The file of that name, which `where` and `pointer` ask for. Errors: those of find_named_file,
  /// `limit_exceeded`.
  proto::Expected<std::string_view> named_file(const std::string& name, const char* where,
                                               const std::string& pointer);

 private:
  proto::Expected<std::string_view> load(const std::filesystem::path&, const std::string& pointer,
                                         const char* where = "scene");

  const files::SceneFiles& files_;
  std::uint64_t left_;
  std::map<std::filesystem::path, files::MappedFile> mapped_;  ///< nodes of a map never move
};

/// Where an image's encoded bytes come from: a URI or a buffer view.
struct ImageSource {
  std::string uri;
  std::string mime_type;
  int buffer_view = -1;
};

/// A glTF whose structure was checked: every index has its target, every buffer view lies in its
/// buffer and every accessor in its view. `model` has no buffers, images, skins, cameras,
/// animations: those are beside it, where the library can't touch them.
struct Document {
  Document(const files::SceneFiles&, const files::ImportLimits&);
  Document(Document&&) noexcept;
  ~Document();

  std::unique_ptr<tinygltf::Model> model;
  std::vector<std::optional<std::string_view>> buffers;  ///< nothing: a buffer without data
  /// Contents of the views that were compressed; nothing for others. Empty: none was.
  std::vector<std::optional<std::string_view>> unpacked_views;
  std::vector<ImageSource> images;
  bool has_animations = false;
  WarningList warnings;

  FileCache files;
  std::vector<std::unique_ptr<std::string>> decoded;  ///< what data URIs and packed views held
};

/// Reads container, JSON and buffers, and checks all of it but the contents of accessors.
/// Errors: `invalid_scene`, `unsupported_extension`, `missing_file`, `limit_exceeded`, `canceled`.
proto::Expected<Document> open_document(const files::SceneFiles&, const files::ImportLimits&,
                                        std::stop_token);

/// The bytes of a buffer view. Errors: `invalid_scene` when its buffer has no data.
proto::Expected<std::string_view> buffer_view_bytes(const Document&, int view,
                                                    const std::string& pointer);

}  // namespace kiln::gltf
