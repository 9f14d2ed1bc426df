#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "baker/files/flat_file.h"
#include "baker/scene/scene.h"
#include "baker/scene/scene_file.h"

/// The layout of a scene file (scene_file.h), which its writer and its reader share.
namespace kiln::scene {

// Records have fixed sizes and no padding. They hold no bool and no enumeration, since not all bits
// are valid values of those.
struct PartRecord {
  std::uint32_t primitive, material, vertices, triangles, has_lightmap_uv;
};
struct InstanceRecord {
  std::uint32_t node, mesh, parts, mirrored, name_bytes;
};
struct TextureRecord {
  std::int32_t image;
  std::uint32_t wrap_u, wrap_v, nearest;
};
struct MaterialRecord {
  math::Rgb base_color, emission;
  TextureRecord base_texture, emission_texture;
  std::uint32_t double_sided, alpha_mode;
  float alpha_cutoff;
  std::int32_t source;
};
struct ImageRecord {
  std::uint32_t width, height;
};
struct SkyRecord {
  std::uint32_t width, height;
};
struct LightRecord {
  std::uint32_t type;
  math::Rgb intensity;
  math::Vec3 position, direction;
  float range, cos_inner, cos_outer;
};
struct CameraRecord {
  std::uint32_t name_bytes, orthographic;
  math::Vec3 position, forward, up;
  float half_height;
};
struct WarningRecord {
  std::uint32_t code_bytes, pointer_bytes, message_bytes;
};
using Texel = std::array<std::uint8_t, 4>;
using Color = std::array<float, 4>;
using Triangle = std::array<std::uint32_t, 3>;

enum Section : std::size_t {
  kPositions,
  kNormals,
  kBaseUv,
  kEmissionUv,
  kLightmapUv,
  kColors,
  kSourceVertex,
  kTriangles,
  kParts,
  kInstances,
  kMaterials,
  kImages,
  kTexels,
  kSky,  ///< none or one
  kSkyTexels,
  kLights,
  kCameras,
  kWarnings,
  /// The names of instances, those of cameras, then the code, pointer and message of each warning.
  kText,
};
inline constexpr std::array<std::uint32_t, kText + 1> kRecordBytes{sizeof(math::Vec3),
                                                                   sizeof(math::Vec3),
                                                                   sizeof(math::Vec2),
                                                                   sizeof(math::Vec2),
                                                                   sizeof(math::Vec2),
                                                                   sizeof(Color),
                                                                   sizeof(std::uint32_t),
                                                                   sizeof(Triangle),
                                                                   sizeof(PartRecord),
                                                                   sizeof(InstanceRecord),
                                                                   sizeof(MaterialRecord),
                                                                   sizeof(ImageRecord),
                                                                   sizeof(Texel),
                                                                   sizeof(SkyRecord),
                                                                   sizeof(math::Rgb),
                                                                   sizeof(LightRecord),
                                                                   sizeof(CameraRecord),
                                                                   sizeof(WarningRecord),
                                                                   1};

inline files::FlatHeader header_of(const std::string& key) {
  return {files::FlatKind::kScene, kSceneFileVersion, key};
}

}  // namespace kiln::scene
