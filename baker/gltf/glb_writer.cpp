#include "baker/gltf/glb_writer.h"

#include <array>
#include <bit>
#include <charconv>
#include <limits>
#include <nlohmann/json.hpp>

#include "baker/gltf/container.h"
#include "baker/gltf/json.h"

namespace kiln::gltf {
namespace {

static_assert(std::endian::native == std::endian::little, "glTF buffers are little-endian");

constexpr int kFloat = 5126, kUnsignedShort = 5123, kUnsignedInt = 5125;
constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;

/// The shortest decimal that reads back as the same float: 0.725, not 0.7250000238418579.
double short_decimal(float value) {
  std::array<char, 32> text{};
  const auto written = std::to_chars(text.data(), text.data() + text.size(), value);
  double decimal = 0;
  std::from_chars(text.data(), written.ptr, decimal);
  return decimal;
}

Json numbers(math::Rgb c) {
  return {short_decimal(c.r), short_decimal(c.g), short_decimal(c.b)};
}
Json numbers(math::Vec3 v) {
  return {short_decimal(v.x), short_decimal(v.y), short_decimal(v.z)};
}

/// Returns the rotation (x, y, z, w) that takes -Z to the unit vector `d` by the shortest way.
Json rotation_from_minus_z(math::Vec3 d) {
  const float w = 1 - d.z;
  if (w < 1e-6f) return {0, 1, 0, 0};  // straight back: half a turn about Y
  const math::Vec3 axis = cross({0, 0, -1}, d);
  const float scale = 1 / std::sqrt(dot(axis, axis) + w * w);
  return {short_decimal(axis.x * scale), short_decimal(axis.y * scale),
          short_decimal(axis.z * scale), short_decimal(w * scale)};
}

class Writer {
 public:
  explicit Writer(const GlbDocument& doc) : doc_(doc) {}

  std::string write() {
    json_["asset"] = {{"version", "2.0"}, {"generator", "lightkiln " LIGHTKILN_VERSION}};
    json_["scene"] = 0;
    Json roots = Json::array();
    for (std::size_t i = 0; i < doc_.nodes.size(); ++i) roots.push_back(i);
    json_["scenes"] = Json::array({Json{{"name", doc_.name}, {"nodes", std::move(roots)}}});
    for (const GlbNode& node : doc_.nodes) json_["nodes"].push_back(node_json(node));
    for (const GlbMesh& mesh : doc_.meshes) json_["meshes"].push_back(mesh_json(mesh));
    for (const GlbMaterial& m : doc_.materials) json_["materials"].push_back(material_json(m));
    write_lights();
    write_images();
    json_["buffers"] = Json::array({Json{{"byteLength", bin_.size()}}});
    if (!extensions_.empty()) json_["extensionsUsed"] = extensions_;
    bin_.resize((bin_.size() + 3) / 4 * 4, '\0');
    return glb_head(json_.dump(), bin_.size()) + bin_;
  }

 private:
  void use_extension(const char* name) {
    for (const Json& used : extensions_)
      if (used == name) return;
    extensions_.push_back(name);
  }

  std::size_t add_view(const void* data, std::size_t bytes, int target) {
    bin_.resize((bin_.size() + 3) / 4 * 4, '\0');
    Json view = {{"buffer", 0}, {"byteOffset", bin_.size()}, {"byteLength", bytes}};
    if (target != 0) view["target"] = target;
    bin_.append(static_cast<const char*>(data), bytes);
    json_["bufferViews"].push_back(std::move(view));
    return json_["bufferViews"].size() - 1;
  }

  template <class T>
  std::size_t add_accessor(const std::vector<T>& values, int component, const char* type,
                           std::size_t count, int target) {
    const std::size_t view = add_view(values.data(), values.size() * sizeof(T), target);
    json_["accessors"].push_back(
        {{"bufferView", view}, {"componentType", component}, {"count", count}, {"type", type}});
    return json_["accessors"].size() - 1;
  }

  std::size_t add_positions(const std::vector<math::Vec3>& p) {
    const std::size_t index = add_accessor(p, kFloat, "VEC3", p.size(), kArrayBuffer);
    constexpr float kMax = std::numeric_limits<float>::max();
    std::array<float, 3> low{kMax, kMax, kMax}, high{-kMax, -kMax, -kMax};
    for (const math::Vec3 v : p)
      for (int k = 0; k < 3; ++k) {
        low[std::size_t(k)] = std::min(low[std::size_t(k)], v[k]);
        high[std::size_t(k)] = std::max(high[std::size_t(k)], v[k]);
      }
    json_["accessors"][index]["min"] = low;
    json_["accessors"][index]["max"] = high;
    return index;
  }

  std::size_t add_indices(const GlbPrimitive& prim) {
    const std::size_t count = prim.triangles.size() * 3;
    if (prim.positions.size() > 0xffff)  // 0xffff itself would restart a strip
      return add_accessor(prim.triangles, kUnsignedInt, "SCALAR", count, kElementArrayBuffer);
    std::vector<std::uint16_t> small;
    small.reserve(count);
    for (const auto& t : prim.triangles)
      for (const std::uint32_t v : t) small.push_back(static_cast<std::uint16_t>(v));
    return add_accessor(small, kUnsignedShort, "SCALAR", count, kElementArrayBuffer);
  }

  Json node_json(const GlbNode& node) {
    Json j = {{"name", node.name}};
    if (node.mesh >= 0) j["mesh"] = node.mesh;
    if (node.translation != math::Vec3{}) j["translation"] = numbers(node.translation);
    if (node.direction != math::Vec3{0, 0, -1})
      j["rotation"] = rotation_from_minus_z(node.direction);
    if (node.light >= 0) j["extensions"]["KHR_lights_punctual"]["light"] = node.light;
    return j;
  }

  Json mesh_json(const GlbMesh& mesh) {
    Json j = {{"name", mesh.name}, {"primitives", Json::array()}};
    for (const GlbPrimitive& p : mesh.primitives) {
      Json prim;
      prim["attributes"]["POSITION"] = add_positions(p.positions);
      prim["attributes"]["NORMAL"] =
          add_accessor(p.normals, kFloat, "VEC3", p.normals.size(), kArrayBuffer);
      prim["attributes"]["TEXCOORD_0"] =
          add_accessor(p.uv0, kFloat, "VEC2", p.uv0.size(), kArrayBuffer);
      prim["attributes"]["TEXCOORD_1"] =
          add_accessor(p.uv1, kFloat, "VEC2", p.uv1.size(), kArrayBuffer);
      prim["indices"] = add_indices(p);
      if (p.material >= 0) prim["material"] = p.material;
      j["primitives"].push_back(std::move(prim));
    }
    return j;
  }

  Json material_json(const GlbMaterial& m) {
    Json pbr;
    pbr["baseColorFactor"] = numbers(m.base_color);
    pbr["baseColorFactor"].push_back(1);
    if (m.base_image >= 0) pbr["baseColorTexture"]["index"] = m.base_image;
    pbr["metallicFactor"] = 0;
    pbr["roughnessFactor"] = 1;
    Json j = {{"name", m.name}, {"pbrMetallicRoughness", std::move(pbr)}};
    if (!is_black(m.emission)) {
      const float strength = std::max(1.f, max_channel(m.emission));
      j["emissiveFactor"] = numbers(m.emission * (1 / strength));
      if (strength > 1) {
        use_extension("KHR_materials_emissive_strength");
        j["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] =
            short_decimal(strength);
      }
      if (m.emission_image >= 0) j["emissiveTexture"]["index"] = m.emission_image;
    }
    if (m.double_sided) j["doubleSided"] = true;
    return j;
  }

  static Json light_json(const GlbLight& light) {
    constexpr std::array<const char*, 3> kNames{"directional", "point", "spot"};
    Json j = {{"name", light.name},
              {"type", kNames[static_cast<std::size_t>(light.type)]},
              {"color", numbers(light.color)},
              {"intensity", short_decimal(light.intensity)}};
    if (light.range > 0) j["range"] = short_decimal(light.range);
    if (light.type == GlbLight::Type::kSpot)
      j["spot"] = {{"innerConeAngle", short_decimal(light.inner_cone)},
                   {"outerConeAngle", short_decimal(light.outer_cone)}};
    return j;
  }

  void write_lights() {
    if (doc_.lights.empty()) return;
    use_extension("KHR_lights_punctual");
    Json& lights = json_["extensions"]["KHR_lights_punctual"]["lights"];
    for (const GlbLight& light : doc_.lights) lights.push_back(light_json(light));
  }

  void write_images() {
    for (std::size_t i = 0; i < doc_.images.size(); ++i) {
      const std::size_t view = add_view(doc_.images[i].data(), doc_.images[i].size(), 0);
      json_["images"].push_back({{"bufferView", view}, {"mimeType", "image/png"}});
      json_["textures"].push_back({{"source", i}, {"sampler", 0}});
    }
    if (!doc_.images.empty())
      json_["samplers"] = Json::array(
          {Json{{"magFilter", 9729}, {"minFilter", 9987}, {"wrapS", 10497}, {"wrapT", 10497}}});
  }

  const GlbDocument& doc_;
  Json json_;
  Json extensions_ = Json::array();
  std::string bin_;
};

}  // namespace

std::string write_glb(const GlbDocument& doc) {
  return Writer(doc).write();
}

}  // namespace kiln::gltf
