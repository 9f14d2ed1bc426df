#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "baker/files/mapped_file.h"
#include "baker/files/upload.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/json.h"
#include "proto/expected.h"

namespace tinygltf {
class Model;
}

namespace kiln::gltf {

/// Files of one upload, each mapped once, within one budget of bytes.
class FileCache {
 public:
  FileCache(files::SceneFiles files, std::uint64_t max_bytes)
      : files_(std::move(files)), left_(max_bytes) {}

  proto::Expected<std::string_view> main_file();
  /// Returns the path of a URI's file. Errors: those of find_side_file.
  proto::Expected<std::filesystem::path> find(const std::string& uri,
                                              const std::string& pointer) const;
  /// Errors: those of find_side_file, `limit_exceeded`.
  proto::Expected<std::string_view> side_file(const std::string& uri, const std::string& pointer);
  /// Returns the file of that name, for which `where` and `pointer` ask. Errors: those of
  /// find_named_file, `limit_exceeded`.
  proto::Expected<std::string_view> named_file(const std::string& name, const char* where,
                                               const std::string& pointer);

 private:
  proto::Expected<std::string_view> load(const std::filesystem::path&, const std::string& pointer,
                                         const char* where = "scene");

  files::SceneFiles files_;
  std::uint64_t left_;
  std::map<std::filesystem::path, files::MappedFile> mapped_;  ///< nodes of a map never move
};

/// The place of an image's encoded bytes: a URI or a buffer view.
struct ImageSource {
  std::string uri;
  std::string mime_type;
  int buffer_view = -1;
};

/// A camera in its node's space: it looks along -Z, +Y is up.
struct CameraSource {
  std::string name;
  bool orthographic = false;
  /// Half the height of the picture, m; of a perspective one at a distance of 1 m. NaN where the
  /// document does not say it.
  double half_height = 0;
};

/// A glTF whose structure was checked: every index has its target, every buffer view lies in its
/// buffer and every accessor in its view. Compressed views and meshes are plain: they have buffer
/// views of their own, the last ones of the model. `model` has no buffers, images, skins, cameras
/// or animations: those are beside it, where the library can't touch them.
struct Document {
  Document(const files::SceneFiles&, const files::ImportLimits&);
  Document(Document&&) noexcept;
  ~Document();

  std::unique_ptr<tinygltf::Model> model;
  /// The whole parsed document for Keep::kEverything, else null. It has the views and accessors of
  /// meshes that were unpacked, too.
  std::unique_ptr<Json> json;
  std::vector<std::optional<std::string_view>> buffers;  ///< nothing: a buffer without data
  /// Contents of the views that were compressed; nothing for others. Empty: none was.
  std::vector<std::optional<std::string_view>> unpacked_views;
  std::size_t source_views = 0;  ///< buffer views of the file itself
  std::vector<ImageSource> images;
  std::vector<CameraSource> cameras;
  bool has_animations = false;
  WarningList warnings;

  FileCache files;
  std::vector<std::unique_ptr<std::string>> decoded;  ///< bytes of data URIs and packed views
};

/// Reads container, JSON and buffers, and checks all of it but the contents of accessors.
/// Errors: `invalid_scene`, `unsupported_extension`, `missing_file`, `limit_exceeded`, `canceled`.
proto::Expected<Document> open_document(const files::SceneFiles&, const files::ImportLimits&,
                                        std::stop_token, Keep = Keep::kWhatABakeReads);

/// Returns the bytes of a buffer view. Errors: `invalid_scene` when its buffer has no data.
proto::Expected<std::string_view> buffer_view_bytes(const Document&, int view,
                                                    const std::string& pointer);

/// Says what a .glb or .gltf needs beside its own bytes.
struct Needs {
  /// The names of the files of the relative URIs of its buffers and images (uri.h). URIs that name
  /// no such file are left out.
  std::vector<std::string> side_files;
  bool images = true;  ///< false: the document has none, so that none is decoded
};
/// Reads the JSON text alone. A file that can't be read names no other: an import says what is
/// wrong with it.
Needs find_needs(std::string_view bytes, const files::ImportLimits&);

}  // namespace kiln::gltf
