#pragma once

#include <cstdint>
#include <deque>
#include <memory>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "baker/files/mapped_file.h"
#include "baker/import/import.h"
#include "baker/output/lit/binary.h"
#include "proto/expected.h"

namespace kiln::output::lit {

using Json = nlohmann::ordered_json;

/// The values of a glTF accessor, wherever they lie. Bounds were checked.
struct SourceAccessor {
  std::uint64_t count = 0;
  std::uint32_t element_bytes = 0;  ///< without padding
  std::uint32_t stride = 0;
  std::string_view bytes;                     ///< from the first element on; empty: all zero
  std::vector<std::uint64_t> sparse_indices;  ///< ascending
  std::string_view sparse_values;

  /// Copies element i, i < count, to `out`.
  void read(std::uint64_t i, char* out) const;
};

/// A glTF document that is being turned into one self-contained .glb: all its JSON, with the
/// buffers of the upload merged into the BIN chunk and the images of the upload in buffer views.
class LitDocument {
 public:
  /// Errors: `invalid_scene`, `missing_file` (neither can happen to files that were imported).
  static proto::Expected<std::unique_ptr<LitDocument>> open(const files::SceneFiles&);
  ~LitDocument();
  LitDocument(const LitDocument&) = delete;
  LitDocument& operator=(const LitDocument&) = delete;

  Json& json() { return *json_; }

  /// Appends bytes and returns their buffer view. `target`, `stride`: 0 leaves them out.
  std::uint32_t add_view(std::string bytes, int target = 0, std::uint32_t stride = 0);
  /// Appends to one of the document's arrays ("textures") and returns the index.
  std::uint32_t add(const char* collection, Json item);

  /// Accessor of the source document. Errors: `invalid_scene`.
  proto::Expected<SourceAccessor> accessor(std::uint64_t index) const;

  /// The whole .glb. Errors: `io_error`, `limit_exceeded` beyond 4 GiB.
  proto::Expected<void> write(int fd);

 private:
  explicit LitDocument(const files::SceneFiles& files);
  proto::Expected<void> load_buffers(std::optional<std::string_view> binary);
  proto::Expected<void> load_views();
  std::optional<std::string_view> unpack(const Json& view);
  void merge_buffers();
  proto::Expected<void> unpack_meshes();
  bool allows_image(const std::string& media_type) const;
  void embed_images();
  std::optional<std::string> image_bytes(const std::string& uri) const;

  files::SceneFiles files_;
  std::deque<files::MappedFile> mapped_;  ///< the main file, then side files
  std::unique_ptr<Json> json_;
  std::deque<std::string> decoded_;                       ///< what data URIs and packed views held
  std::vector<std::optional<std::string_view>> buffers_;  ///< of the source; nothing: no data
  std::vector<std::optional<std::string_view>> views_;    ///< of the source
  GlbBinary binary_;
};

/// A whole number >= 0, also when written as 1.0; nothing for anything else.
std::optional<std::uint64_t> as_count(const Json&);
/// object[key] as such a number, or `missing` where the key is absent; nothing when it is no
/// number.
std::optional<std::uint64_t> count_at(const Json& object, const char* key, std::uint64_t missing);

/// object["extensions"], made where there are none.
Json& extensions_of(Json& object);

/// Components of a glTF element type; 0 for unknown ones.
std::uint32_t component_count(std::string_view type);

}  // namespace kiln::output::lit
