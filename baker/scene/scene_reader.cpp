#include <cmath>
#include <limits>
#include <utility>

#include "baker/exec/stop.h"
#include "baker/files/flat_file.h"
#include "baker/files/utf8.h"
#include "baker/scene/scene_file.h"
#include "baker/scene/scene_records.h"

namespace kiln::scene {
namespace {
using proto::Expected;

constexpr float kMaxCoordinate = 1e9f;

bool is_in(float value, float low, float high) {
  return value >= low && value <= high;  // NaN gives false
}
bool is_light(math::Rgb c) {
  constexpr float kMax = std::numeric_limits<float>::max();
  return is_in(c.r, 0, kMax) && is_in(c.g, 0, kMax) && is_in(c.b, 0, kMax);
}
/// Returns whether `v` has unit length, as far as normalizing the shortest vectors achieves it.
bool is_direction(math::Vec3 v) {
  return is_in(dot(v, v), 0.25f, 4);
}

class Reader {
 public:
  Reader(const files::FlatFile& file, std::stop_token stop)
      : file_(file), stop_(stop), stopped_(stop) {}

  proto::Expected<Scene> read() {
    for (const auto step : {&Reader::copy_arrays, &Reader::read_materials, &Reader::read_instances,
                            &Reader::read_vertices, &Reader::read_triangles, &Reader::read_sky,
                            &Reader::read_lights, &Reader::read_cameras, &Reader::read_warnings})
      if (auto ok = (this->*step)(); !ok) return proto::Unexpected(ok.error());
    if (text_at_ != file_.bytes(kText).size())
      return files::bad_flat_file("it holds text that no record uses");
    return std::move(scene_);
  }

 private:
  proto::Expected<void> copy_arrays() {
    const bool all = copy(kPositions, scene_.positions) && copy(kNormals, scene_.normals) &&
                     copy(kBaseUv, scene_.base_uv) && copy(kEmissionUv, scene_.emission_uv) &&
                     copy(kLightmapUv, scene_.lightmap_uv) && copy(kColors, scene_.colors) &&
                     copy(kSourceVertex, scene_.source_vertex) &&
                     copy(kTriangles, scene_.triangles) && copy(kTexels, scene_.image_texels) &&
                     copy(kSkyTexels, scene_.sky_map.texels);
    if (!all || stop_.stop_requested()) return exec::canceled();
    return {};
  }

  template <class T>
  bool copy(Section section, std::vector<T>& to) const {
    return file_.copy_records(section, to, stop_);
  }

  proto::Expected<void> read_materials() {
    std::uint64_t first = 0;
    for (const ImageRecord& r : file_.records<ImageRecord>(kImages)) {
      const std::uint64_t texels = std::uint64_t(r.width) * r.height;  // below 2^64
      if (texels == 0 || texels > scene_.image_texels.size() - first) return bad("an image");
      scene_.images.push_back({r.width, r.height, first});
      first += texels;
    }
    if (first != scene_.image_texels.size()) return bad("the images");
    for (const MaterialRecord& r : file_.records<MaterialRecord>(kMaterials)) {
      Material m;
      if (!read_texture(r.base_texture, m.base_texture) ||
          !read_texture(r.emission_texture, m.emission_texture) || !is_light(r.base_color) ||
          max_channel(r.base_color) > 1 || !is_light(r.emission) || r.double_sided > 1 ||
          r.alpha_mode > std::uint32_t(AlphaMode::kBlend) || std::isnan(r.alpha_cutoff) ||
          r.source < -1)
        return bad("a material");
      m.base_color = r.base_color;
      m.emission = r.emission;
      m.double_sided = r.double_sided != 0;
      m.alpha_mode = AlphaMode(r.alpha_mode);
      m.alpha_cutoff = r.alpha_cutoff;
      m.source = r.source;
      scene_.materials.push_back(m);
    }
    return {};
  }

  bool read_texture(const TextureRecord& r, Texture& out) const {
    constexpr auto kLast = std::uint32_t(Wrap::kClamp);
    if (r.image < -1 || (r.image >= 0 && std::size_t(r.image) >= scene_.images.size()))
      return false;
    if (r.wrap_u > kLast || r.wrap_v > kLast || r.nearest > 1) return false;
    out = {r.image, Wrap(r.wrap_u), Wrap(r.wrap_v), r.nearest != 0};
    return true;
  }

  /// Reads the instances with their parts, which follow each other without gaps.
  proto::Expected<void> read_instances() {
    constexpr std::uint64_t kMaxCount = 0xffffffffu;
    const auto parts = file_.records<PartRecord>(kParts);
    if (scene_.positions.size() > kMaxCount || scene_.triangles.size() > kMaxCount ||
        parts.size() > kMaxCount)
      return bad("a size");
    std::size_t next = 0;
    for (const InstanceRecord& r : file_.records<InstanceRecord>(kInstances)) {
      Instance instance{r.node, r.mesh, {}, std::uint32_t(next), r.parts, r.mirrored != 0};
      if (r.parts == 0 || r.parts > parts.size() - next || r.mirrored > 1 ||
          !read_text(r.name_bytes, instance.name))
        return bad("an instance");
      for (std::uint32_t k = 0; k < r.parts; ++k)
        if (!read_part(parts[next++])) return bad("a part");
      scene_.instances.push_back(std::move(instance));
    }
    if (next != parts.size() || vertices_ != scene_.positions.size() ||
        triangles_ != scene_.triangles.size() || next == 0)
      return bad("the parts");
    return {};
  }

  bool read_part(const PartRecord& r) {
    if (r.material >= scene_.materials.size() || r.has_lightmap_uv > 1 || r.triangles == 0 ||
        r.vertices > scene_.positions.size() - vertices_ ||
        r.triangles > scene_.triangles.size() - triangles_)
      return false;
    Part part;
    part.instance = std::uint32_t(scene_.instances.size());
    part.primitive = r.primitive;
    part.material = r.material;
    part.first_vertex = std::uint32_t(vertices_);
    part.vertex_count = r.vertices;
    part.first_triangle = std::uint32_t(triangles_);
    part.triangle_count = r.triangles;
    part.has_lightmap_uv = r.has_lightmap_uv != 0;
    scene_.triangle_part.insert(scene_.triangle_part.end(), r.triangles,
                                std::uint32_t(scene_.parts.size()));
    scene_.parts.push_back(part);
    vertices_ += r.vertices;
    triangles_ += r.triangles;
    return true;
  }

  /// Reads the vertices. Texture coordinates of the materials may hold any value, since the sampler
  /// of an image bounds them.
  proto::Expected<void> read_vertices() {
    const std::size_t n = scene_.positions.size();
    if (scene_.normals.size() != n || scene_.base_uv.size() != n ||
        scene_.emission_uv.size() != n || scene_.lightmap_uv.size() != n ||
        scene_.colors.size() != n || scene_.source_vertex.size() != n)
      return bad("the vertices");
    for (std::size_t i = 0; i < n; ++i) {
      if (stopped_()) return exec::canceled();
      const math::Vec2 uv = scene_.lightmap_uv[i];
      const Color& c = scene_.colors[i];
      if (!is_finite(scene_.positions[i]) || max_abs(scene_.positions[i]) > kMaxCoordinate ||
          !is_direction(scene_.normals[i]) || !std::isfinite(uv.x) || !std::isfinite(uv.y) ||
          !std::isfinite(c[0]) || !std::isfinite(c[1]) || !std::isfinite(c[2]) ||
          !std::isfinite(c[3]))
        return bad("a vertex");
    }
    return {};
  }

  proto::Expected<void> read_triangles() {
    for (std::size_t t = 0; t < scene_.triangles.size(); ++t) {
      if (stopped_()) return exec::canceled();
      const Part& part = scene_.parts[scene_.triangle_part[t]];
      const Triangle& v = scene_.triangles[t];
      for (const std::uint32_t i : v)  // an index below first_vertex gives a large difference
        if (i - part.first_vertex >= part.vertex_count) return bad("a triangle");
      if (!has_area(scene_.positions[v[0]], scene_.positions[v[1]], scene_.positions[v[2]]))
        return bad("a triangle");
    }
    return {};
  }

  proto::Expected<void> read_sky() {
    SkyMap& map = scene_.sky_map;
    const auto records = file_.records<SkyRecord>(kSky);
    if (records.size() > 1 || records.empty() != map.empty()) return bad("the sky map");
    if (records.empty()) return {};
    map.width = records[0].width;
    map.height = records[0].height;
    if (map.width != 2 * std::uint64_t(map.height) ||
        std::uint64_t(map.width) * map.height != map.texels.size())
      return bad("the sky map");
    for (const math::Rgb& c : map.texels) {
      if (stopped_()) return exec::canceled();
      if (!is_in(c.r, 0, kMaxSkyValue) || !is_in(c.g, 0, kMaxSkyValue) ||
          !is_in(c.b, 0, kMaxSkyValue))
        return bad("the sky map");
    }
    return {};
  }

  proto::Expected<void> read_lights() {
    for (const LightRecord& r : file_.records<LightRecord>(kLights)) {
      if (r.type > std::uint32_t(PunctualType::kSpot) || !is_light(r.intensity) ||
          !is_finite(r.position) || !is_direction(r.direction) || !(r.range >= 0) ||
          !is_in(r.cos_inner, -1, 1) || !is_in(r.cos_outer, -1, 1))
        return bad("a light");
      scene_.lights.push_back({PunctualType(r.type), r.intensity, r.position, r.direction, r.range,
                               r.cos_inner, r.cos_outer});
    }
    return {};
  }

  proto::Expected<void> read_cameras() {
    const auto records = file_.records<CameraRecord>(kCameras);
    if (records.size() > Camera::kMost) return bad("the cameras");
    for (const CameraRecord& r : records) {
      Camera c;
      if (r.name_bytes > Camera::kNameBytes || r.orthographic > 1 || !is_finite(r.position) ||
          !is_direction(r.forward) || !is_direction(r.up) || !(r.half_height > 0) ||
          !std::isfinite(r.half_height) || !read_text(r.name_bytes, c.name))
        return bad("a camera");
      c.position = r.position;
      c.forward = r.forward;
      c.up = r.up;
      c.orthographic = r.orthographic != 0;
      c.half_height = r.half_height;
      scene_.cameras.push_back(std::move(c));
    }
    return {};
  }

  proto::Expected<void> read_warnings() {
    for (const WarningRecord& r : file_.records<WarningRecord>(kWarnings)) {
      proto::Warning w;
      if (!read_text(r.code_bytes, w.code) || !read_text(r.pointer_bytes, w.pointer) ||
          !read_text(r.message_bytes, w.message))
        return bad("a warning");
      scene_.warnings.push_back(std::move(w));
    }
    return {};
  }

  bool read_text(std::uint32_t size, std::string& out) {
    const std::string_view text = file_.bytes(kText);
    if (size > text.size() - text_at_) return false;
    out = text.substr(text_at_, size);
    text_at_ += size;
    return files::is_utf8(out);
  }

  static proto::Unexpected bad(const char* what) {
    return files::bad_flat_file(std::string(what) + " has a value that no import writes");
  }

  const files::FlatFile& file_;
  std::stop_token stop_;
  exec::StopPoll stopped_;
  Scene scene_;
  std::uint64_t vertices_ = 0, triangles_ = 0;  ///< number in the parts so far
  std::size_t text_at_ = 0;
};

}  // namespace

proto::Expected<Scene> read_scene_file(std::string_view bytes, const std::string& key,
                                       std::stop_token stop) {
  const auto file = files::FlatFile::open(bytes, header_of(key), kRecordBytes);
  if (!file) return proto::Unexpected(file.error());
  return Reader(*file, std::move(stop)).read();
}

}  // namespace kiln::scene
