#include "baker/scene/scene_file.h"

#include <array>

#include "baker/files/flat_file.h"
#include "baker/scene/scene_records.h"
#include "proto/sha256.h"

namespace kiln::scene {
namespace {
using proto::Expected;

TextureRecord record_of(const Texture& t) {
  return {t.image, std::uint32_t(t.wrap_u), std::uint32_t(t.wrap_v), t.nearest};
}

MaterialRecord record_of(const Material& m) {
  return {m.base_color,
          m.emission,
          record_of(m.base_texture),
          record_of(m.emission_texture),
          m.double_sided,
          std::uint32_t(m.alpha_mode),
          m.alpha_cutoff,
          m.source};
}

std::uint32_t append(std::string& text, const std::string& piece) {
  text += piece;
  return static_cast<std::uint32_t>(piece.size());
}

/// The small arrays of a scene, as records.
struct Records {
  std::vector<PartRecord> parts;
  std::vector<InstanceRecord> instances;
  std::vector<MaterialRecord> materials;
  std::vector<ImageRecord> images;
  std::vector<SkyRecord> sky;
  std::vector<LightRecord> lights;
  std::vector<CameraRecord> cameras;
  std::vector<WarningRecord> warnings;
  std::string text;

  explicit Records(const Scene& scene) {
    for (const Part& p : scene.parts)
      parts.push_back(
          {p.primitive, p.material, p.vertex_count, p.triangle_count, p.has_lightmap_uv});
    for (const Instance& i : scene.instances)
      instances.push_back({i.node, i.mesh, i.part_count, i.mirrored, append(text, i.name)});
    for (const Material& m : scene.materials) materials.push_back(record_of(m));
    for (const Image& i : scene.images) images.push_back({i.width, i.height});
    const SkyMap& map = scene.sky_map;
    if (!map.empty()) sky.push_back({map.width, map.height});
    for (const PunctualLight& l : scene.lights)
      lights.push_back({std::uint32_t(l.type), l.intensity, l.position, l.direction, l.range,
                        l.cos_inner, l.cos_outer});
    for (const Camera& c : scene.cameras)
      cameras.push_back(
          {append(text, c.name), c.orthographic, c.position, c.forward, c.up, c.half_height});
    for (const proto::Warning& w : scene.warnings) {
      const std::uint32_t code = append(text, w.code), pointer = append(text, w.pointer);
      warnings.push_back({code, pointer, append(text, w.message)});
    }
  }
};

}  // namespace

proto::Expected<void> write_scene_file(int fd, const std::string& key, const Scene& scene) {
  const Records records(scene);
  const std::array<files::FlatSection, kText + 1> sections{
      files::flat_section(scene.positions),      files::flat_section(scene.normals),
      files::flat_section(scene.base_uv),        files::flat_section(scene.emission_uv),
      files::flat_section(scene.lightmap_uv),    files::flat_section(scene.colors),
      files::flat_section(scene.source_vertex),  files::flat_section(scene.triangles),
      files::flat_section(records.parts),        files::flat_section(records.instances),
      files::flat_section(records.materials),    files::flat_section(records.images),
      files::flat_section(scene.image_texels),   files::flat_section(records.sky),
      files::flat_section(scene.sky_map.texels), files::flat_section(records.lights),
      files::flat_section(records.cameras),      files::flat_section(records.warnings),
      files::FlatSection{1, records.text}};
  return write_flat(fd, header_of(key), sections);
}

}  // namespace kiln::scene
