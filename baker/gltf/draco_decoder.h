#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "proto/expected.h"

namespace kiln::gltf {

/// One attribute as the glTF wants it.
struct DracoAttribute {
  std::uint64_t id = 0;  ///< unique id within the mesh
  std::uint32_t component_type = 5126, components = 3;
};

/// A mesh of KHR_draco_mesh_compression, and what the document says of it.
struct DracoRequest {
  std::uint64_t vertices = 0, indices = 0;
  std::uint32_t index_type = 5125;  ///< glTF component type; 0: the indices are not wanted
  std::vector<DracoAttribute> attributes;
};

/// Plain contents of accessors. Elements of attributes start at multiples of four bytes.
struct DracoMesh {
  std::string indices;
  std::vector<std::string> attributes;
};

/// Bytes of one attribute's element, padding included; 0 for what glTF has not.
std::uint32_t draco_stride(const DracoAttribute&);

/// By Draco's library, when the header's numbers are those of the document. The message says what
/// is wrong, for instance that a number of vertices or triangles is another than that. Errors:
/// `invalid_scene`.
proto::Expected<DracoMesh> decode_draco(std::string_view bytes, const DracoRequest&);

}  // namespace kiln::gltf
