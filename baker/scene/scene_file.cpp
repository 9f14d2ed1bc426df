#include "baker/scene/scene_file.h"

#include <array>
#include <cmath>
#include <utility>

#include "baker/exec/stop.h"
#include "baker/scene/errors.h"
#include "baker/scene/flat_file.h"
#include "baker/scene/utf8.h"
#include "proto/sha256.h"

namespace kiln::baker {
namespace {

using proto::Expected;

/// To be raised when the layout changes, or what an import makes of the same bytes.
constexpr std::uint32_t kVersion = 4;

constexpr float kMaxCoordinate = 1e9f;

// Records: fixed sizes, no padding, no bool, no enumeration, nothing that some bits can't be.
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
  Rgb base_color, emission;
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
  Rgb intensity;
  Vec3 position, direction;
  float range, cos_inner, cos_outer;
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
  kWarnings,
  kText,  ///< names of instances, then code, pointer and message of each warning
};
constexpr std::array<std::uint32_t, kText + 1> kRecordBytes{
    sizeof(Vec3),           sizeof(Vec3),           sizeof(Vec2),
    sizeof(Vec2),           sizeof(Vec2),           sizeof(Color),
    sizeof(std::uint32_t),  sizeof(Triangle),       sizeof(PartRecord),
    sizeof(InstanceRecord), sizeof(MaterialRecord), sizeof(ImageRecord),
    sizeof(Texel),          sizeof(SkyRecord),      sizeof(Rgb),
    sizeof(LightRecord),    sizeof(WarningRecord),  1};

FlatHeader header_of(const std::string& key) {
  return {FlatKind::kScene, kVersion, key};
}

// Writing -----------------------------------------------------------------------------------------

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

/// The small arrays, as records.
struct Records {
  std::vector<PartRecord> parts;
  std::vector<InstanceRecord> instances;
  std::vector<MaterialRecord> materials;
  std::vector<ImageRecord> images;
  std::vector<SkyRecord> sky;
  std::vector<LightRecord> lights;
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
    for (const proto::Warning& w : scene.warnings) {
      const std::uint32_t code = append(text, w.code), pointer = append(text, w.pointer);
      warnings.push_back({code, pointer, append(text, w.message)});
    }
  }
};

// Reading -----------------------------------------------------------------------------------------

bool is_in(float value, float low, float high) {
  return value >= low && value <= high;  // false for what is no number
}
bool is_light(Rgb c) {
  constexpr float kMax = std::numeric_limits<float>::max();
  return is_in(c.r, 0, kMax) && is_in(c.g, 0, kMax) && is_in(c.b, 0, kMax);
}
/// Unit length, as far as normalising the shortest vectors gives it.
bool is_direction(Vec3 v) {
  return is_in(dot(v, v), 0.25f, 4);
}

class Reader {
 public:
  Reader(const FlatFile& file, std::stop_token stop) : file_(file), stop_(stop), stopped_(stop) {}

  Expected<Scene> read() {
    for (const auto step : {&Reader::copy_arrays, &Reader::read_materials, &Reader::read_instances,
                            &Reader::read_vertices, &Reader::read_triangles, &Reader::read_sky,
                            &Reader::read_lights, &Reader::read_warnings})
      if (auto ok = (this->*step)(); !ok) return proto::Unexpected(ok.error());
    if (text_at_ != file_.bytes(kText).size()) return bad_flat_file("it has text that nobody owns");
    return std::move(scene_);
  }

 private:
  Expected<void> copy_arrays() {
    const bool all = copy(kPositions, scene_.positions) && copy(kNormals, scene_.normals) &&
                     copy(kBaseUv, scene_.base_uv) && copy(kEmissionUv, scene_.emission_uv) &&
                     copy(kLightmapUv, scene_.lightmap_uv) && copy(kColors, scene_.colors) &&
                     copy(kSourceVertex, scene_.source_vertex) &&
                     copy(kTriangles, scene_.triangles) && copy(kTexels, scene_.image_texels) &&
                     copy(kSkyTexels, scene_.sky_map.texels);
    if (!all || stop_.stop_requested()) return canceled();
    return {};
  }

  template <class T>
  bool copy(Section section, std::vector<T>& to) const {
    return file_.copy_records(section, to, stop_);
  }

  Expected<void> read_materials() {
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

  /// Instances with their parts, which follow each other without gaps.
  Expected<void> read_instances() {
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

  /// Texture coordinates of the materials may be anything: whoever samples an image bounds them.
  Expected<void> read_vertices() {
    const std::size_t n = scene_.positions.size();
    if (scene_.normals.size() != n || scene_.base_uv.size() != n ||
        scene_.emission_uv.size() != n || scene_.lightmap_uv.size() != n ||
        scene_.colors.size() != n || scene_.source_vertex.size() != n)
      return bad("the vertices");
    for (std::size_t i = 0; i < n; ++i) {
      if (stopped_()) return canceled();
      const Vec2 uv = scene_.lightmap_uv[i];
      const Color& c = scene_.colors[i];
      if (!is_finite(scene_.positions[i]) || max_abs(scene_.positions[i]) > kMaxCoordinate ||
          !is_direction(scene_.normals[i]) || !std::isfinite(uv.x) || !std::isfinite(uv.y) ||
          !std::isfinite(c[0]) || !std::isfinite(c[1]) || !std::isfinite(c[2]) ||
          !std::isfinite(c[3]))
        return bad("a vertex");
    }
    return {};
  }

  Expected<void> read_triangles() {
    for (std::size_t t = 0; t < scene_.triangles.size(); ++t) {
      if (stopped_()) return canceled();
      const Part& part = scene_.parts[scene_.triangle_part[t]];
      const Triangle& v = scene_.triangles[t];
      for (const std::uint32_t i : v)  // below first_vertex, the difference is large
        if (i - part.first_vertex >= part.vertex_count) return bad("a triangle");
      if (!has_area(scene_.positions[v[0]], scene_.positions[v[1]], scene_.positions[v[2]]))
        return bad("a triangle");
    }
    return {};
  }

  Expected<void> read_sky() {
    SkyMap& map = scene_.sky_map;
    const auto records = file_.records<SkyRecord>(kSky);
    if (records.size() > 1 || records.empty() != map.empty()) return bad("the sky map");
    if (records.empty()) return {};
    map.width = records[0].width;
    map.height = records[0].height;
    if (map.width != 2 * std::uint64_t(map.height) ||
        std::uint64_t(map.width) * map.height != map.texels.size())
      return bad("the sky map");
    for (const Rgb& c : map.texels) {
      if (stopped_()) return canceled();
      if (!is_in(c.r, 0, kMaxSkyValue) || !is_in(c.g, 0, kMaxSkyValue) ||
          !is_in(c.b, 0, kMaxSkyValue))
        return bad("the sky map");
    }
    return {};
  }

  Expected<void> read_lights() {
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

  Expected<void> read_warnings() {
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
    return is_utf8(out);
  }

  static proto::Unexpected bad(const char* what) {
    return bad_flat_file(std::string(what) + " is not what an import makes");
  }

  const FlatFile& file_;
  std::stop_token stop_;
  StopPoll stopped_;
  Scene scene_;
  std::uint64_t vertices_ = 0, triangles_ = 0;  ///< of the parts so far
  std::size_t text_at_ = 0;
};

}  // namespace

std::string import_key(const std::string& scene_key, const ImportLimits& limits,
                       const std::optional<std::string>& sky_map) {
  std::string text = LIGHTKILN_VERSION "\n" + std::to_string(kVersion) + "\n" + scene_key + "\n";
  for (const std::uint64_t limit :
       {limits.file_bytes, limits.json_bytes, std::uint64_t{limits.json_depth},
        std::uint64_t{limits.nodes}, std::uint64_t{limits.node_depth}, limits.vertices,
        limits.triangles, limits.image_pixels, limits.all_image_pixels,
        std::uint64_t{limits.lights}})
    text += std::to_string(limit) + "\n";
  if (sky_map) text += "sky map " + *sky_map + "\n";
  return proto::sha256_hex(text);
}

Expected<void> write_scene_file(int fd, const std::string& key, const Scene& scene) {
  const Records records(scene);
  const std::array<FlatSection, kText + 1> sections{
      flat_section(scene.positions),      flat_section(scene.normals),
      flat_section(scene.base_uv),        flat_section(scene.emission_uv),
      flat_section(scene.lightmap_uv),    flat_section(scene.colors),
      flat_section(scene.source_vertex),  flat_section(scene.triangles),
      flat_section(records.parts),        flat_section(records.instances),
      flat_section(records.materials),    flat_section(records.images),
      flat_section(scene.image_texels),   flat_section(records.sky),
      flat_section(scene.sky_map.texels), flat_section(records.lights),
      flat_section(records.warnings),     FlatSection{1, records.text}};
  return write_flat(fd, header_of(key), sections);
}

Expected<Scene> read_scene_file(std::string_view bytes, const std::string& key,
                                std::stop_token stop) {
  const auto file = FlatFile::open(bytes, header_of(key), kRecordBytes);
  if (!file) return proto::Unexpected(file.error());
  return Reader(*file, std::move(stop)).read();
}

}  // namespace kiln::baker
