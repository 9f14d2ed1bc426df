#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "baker/gltf/accessors.h"
#include "baker/gltf/document.h"
#include "baker/output/lit/binary.h"
#include "proto/expected.h"

namespace kiln::output::lit {

using gltf::as_count;
using gltf::count_at;
using gltf::Json;

/// A glTF document that is being turned into one self-contained .glb: all its JSON, with the
/// buffers of the upload merged into the BIN chunk and the images of the upload in buffer views.
class LitDocument {
 public:
  /// Reads the upload as an import does (gltf::open_document()), within the same limits.
  /// Errors: those of open_document(), which files that were imported do not meet.
  static proto::Expected<std::unique_ptr<LitDocument>> open(const files::SceneFiles&,
                                                            const files::ImportLimits&);
  ~LitDocument();
  LitDocument(const LitDocument&) = delete;
  LitDocument& operator=(const LitDocument&) = delete;

  Json& json() { return *source_.json; }

  /// Appends bytes and returns their buffer view. `target`, `stride`: 0 leaves them out.
  std::uint32_t add_view(std::string bytes, int target = 0, std::uint32_t stride = 0);
  /// Appends to one of the document's arrays ("textures") and returns the index.
  std::uint32_t add(const char* collection, Json item);

  /// Returns an accessor of the source document. Errors: `invalid_scene`.
  proto::Expected<gltf::AccessorView> accessor(std::uint64_t index) const;

  /// Writes the whole .glb. Errors: `io_error`, `limit_exceeded` beyond 4 GiB.
  proto::Expected<void> write(int fd);

 private:
  LitDocument(gltf::Document source, files::SceneFiles files);
  void merge_buffers();
  void append_unpacked_views();
  bool allows_image(const std::string& media_type) const;
  void embed_images();
  std::optional<std::string> image_bytes(const std::string& uri) const;

  gltf::Document source_;
  gltf::Accessors accessors_;
  files::SceneFiles files_;
  GlbBinary binary_;
};

/// Returns object["extensions"], made where there are none.
Json& extensions_of(Json& object);
/// Takes an extension off an object, and `extensions` with the last one.
void drop_extension(Json& object, const char* name);

}  // namespace kiln::output::lit
