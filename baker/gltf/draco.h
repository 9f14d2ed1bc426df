#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

#include "baker/gltf/json.h"
#include "proto/expected.h"

namespace kiln::gltf {

/// One attribute as the glTF wants it.
struct DracoAttribute {
  std::uint64_t id = 0;  ///< unique id within the mesh
  std::uint32_t component_type = 5126, components = 3;
};

/// A mesh of KHR_draco_mesh_compression as the document describes it.
struct DracoRequest {
  std::uint64_t vertices = 0, indices = 0;
  std::uint32_t index_type = 5125;  ///< glTF component type; 0: the indices are not wanted
  std::vector<DracoAttribute> attributes;
};

/// The plain contents of accessors. Elements of attributes start at multiples of four bytes.
struct DracoMesh {
  std::string indices;
  std::vector<std::string> attributes;
};

/// Returns the bytes of one attribute's element, padding included; 0 for a type that glTF lacks.
std::uint32_t draco_stride(const DracoAttribute&);

/// Decodes by Draco's library, when the header's numbers are those of the document. The message
/// says what is wrong, for instance that the number of vertices is another. Errors:
/// `invalid_scene`.
proto::Expected<DracoMesh> decode_draco(std::string_view bytes, const DracoRequest&);

/// The bytes behind a document's buffer views, and where new ones go.
struct DracoViews {
  std::function<std::optional<std::string_view>(std::size_t view)> bytes;
  /// Takes the bytes of a new view, with a stride unless that is 0; returns its index.
  std::function<std::size_t(std::string bytes, std::uint32_t stride)> add;
};

/// Gives plain buffer views to the accessors whose data lies in KHR_draco_mesh_compression alone:
/// the document then reads as if it had never been compressed. The extensions stay where they are.
/// Requires that check_gltf() passed the document. Errors: `invalid_scene`, `unsupported_extension`
/// (triangle strips), `limit_exceeded` (more than `max_bytes` of plain data), `canceled`.
proto::Expected<void> unpack_draco(Json& document, const DracoViews&, std::uint64_t max_bytes,
                                   const std::stop_token&);

}  // namespace kiln::gltf
