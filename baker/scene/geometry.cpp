#include "baker/scene/geometry.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "baker/scene/gltf_json.h"
#include "baker/scene/tinygltf.h"

namespace kiln::baker {
namespace {

using proto::Expected;
using proto::Unexpected;
using Triangle = std::array<std::uint32_t, 3>;

constexpr std::uint64_t kPollMask = 0xffff;  // a stop request is looked for this often
constexpr float kMaxCoordinate = 1e9f;       // m; squared areas of larger triangles overflow

Unexpected invalid(const std::string& why, const std::string& pointer) {
  return proto::fail("invalid_scene", why, "scene", pointer);
}
Unexpected canceled() {
  return proto::fail(proto::kCanceledCode, "canceled");
}

// Formats [glTF 2.0, 3.7.2.1; KHR_mesh_quantization] ----------------------------------------------
using Types = std::vector<std::pair<Component, bool>>;
const Types kFloatOnly{{Component::kFloat, false}};
const Types kQuantized{{Component::kByte, false},          {Component::kByte, true},
                       {Component::kUnsignedByte, false},  {Component::kUnsignedByte, true},
                       {Component::kShort, false},         {Component::kShort, true},
                       {Component::kUnsignedShort, false}, {Component::kUnsignedShort, true}};
const Types kUnit{{Component::kFloat, false},
                  {Component::kUnsignedByte, true},
                  {Component::kUnsignedShort, true}};
const Types kIndexTypes{{Component::kUnsignedByte, false},
                        {Component::kUnsignedShort, false},
                        {Component::kUnsignedInt, false}};

Types with_quantized(const Types& types, const Document& document) {
  const auto& used = document.model->extensionsUsed;
  Types out = types;
  if (std::find(used.begin(), used.end(), "KHR_mesh_quantization") != used.end()) {
    out.insert(out.end(), kQuantized.begin(), kQuantized.end());
  }
  return out;
}

/// Opens attributes of one primitive; remembers the first error.
class AttributeReader {
 public:
  AttributeReader(Document& document, Accessors& accessors, const tinygltf::Primitive& primitive,
                  const std::string& at)
      : document_(document),
        accessors_(accessors),
        primitive_(primitive),
        at_(at + "/attributes") {}

  Expected<std::optional<AccessorView>> open(const std::string& name, std::uint32_t min_components,
                                             std::uint32_t max_components, const Types& types) {
    const auto found = primitive_.attributes.find(name);
    if (found == primitive_.attributes.end()) return std::optional<AccessorView>();
    auto view = accessors_.open(
        found->second, {min_components, max_components, with_quantized(types, document_)}, name);
    if (!view) return Unexpected(view.error());
    if (!count_) count_ = view->count;
    if (view->count != *count_) {
      return invalid("has " + std::to_string(view->count) + " elements, but POSITION has " +
                         std::to_string(*count_),
                     pointer_to(at_, std::string_view(name)));
    }
    return std::optional(*view);
  }

 private:
  Document& document_;
  Accessors& accessors_;
  const tinygltf::Primitive& primitive_;
  std::string at_;
  std::optional<std::uint64_t> count_;
};

Expected<void> open_attributes(PrimitiveSource& out, Document& document, Accessors& accessors,
                               const tinygltf::Primitive& primitive) {
  AttributeReader reader(document, accessors, primitive, out.pointer);
  const auto positions = reader.open("POSITION", 3, 3, kFloatOnly);
  if (!positions) return Unexpected(positions.error());
  out.positions = **positions;
  const auto normals = reader.open("NORMAL", 3, 3, kFloatOnly);
  if (!normals) return Unexpected(normals.error());
  out.normals = *normals;
  const auto colors = reader.open("COLOR_0", 3, 4, kUnit);
  if (!colors) return Unexpected(colors.error());
  out.colors = *colors;
  for (int set = 0; primitive.attributes.contains("TEXCOORD_" + std::to_string(set)); ++set) {
    const auto uv = reader.open("TEXCOORD_" + std::to_string(set), 2, 2, kUnit);
    if (!uv) return Unexpected(uv.error());
    out.uv_sets.push_back(*uv);
  }
  return {};
}

// Triangles ---------------------------------------------------------------------------------------

std::uint64_t triangle_count(int mode, std::uint64_t corners) {
  if (mode == TINYGLTF_MODE_TRIANGLES) return corners / 3;
  return corners < 3 ? 0 : corners - 2;
}

/// Places in the list of corners of triangle i [glTF 2.0, 3.7.2.1].
std::array<std::uint64_t, 3> triangle_corners(int mode, std::uint64_t i) {
  if (mode == TINYGLTF_MODE_TRIANGLES) return {3 * i, 3 * i + 1, 3 * i + 2};
  if (mode == TINYGLTF_MODE_TRIANGLE_FAN) return {i + 1, i + 2, 0};
  return {i, i + 1 + i % 2, i + 2 - i % 2};
}

std::uint32_t restart_value(Component c) {
  if (c == Component::kUnsignedByte) return 0xffu;
  return c == Component::kUnsignedShort ? 0xffffu : 0xffffffffu;
}

Expected<void> check_indices(const AccessorView& indices, std::uint64_t vertex_count,
                             const std::string& at, const std::stop_token& stop) {
  const std::uint32_t restart = restart_value(indices.component);
  for (std::uint64_t i = 0; i < indices.count; ++i) {
    if ((i & kPollMask) == 0 && stop.stop_requested()) return canceled();
    const std::uint32_t index = indices.index(i);
    if (index == restart) {
      return invalid("element " + std::to_string(i) + " is the primitive restart value " +
                         std::to_string(index) + ", which glTF forbids",
                     at);
    }
    if (index >= vertex_count) {
      return invalid("element " + std::to_string(i) + " is the index " + std::to_string(index) +
                         ", but there are " + std::to_string(vertex_count) + " vertices",
                     at);
    }
  }
  return {};
}

/// Triangles of one primitive and the vertices they name.
struct Assembly {
  std::vector<std::uint32_t> used;  ///< source vertices, ascending
  std::vector<Triangle> triangles;  ///< into `used`, glTF order
};

/// Fills `used` and makes the triangles' corners, source vertices so far, indices into it.
void compact(Assembly& p) {
  std::uint32_t low = 0xffffffffu, high = 0;
  for (const Triangle& t : p.triangles) {
    low = std::min({low, t[0], t[1], t[2]});
    high = std::max({high, t[0], t[1], t[2]});
  }
  const std::uint64_t corners = 3 * p.triangles.size();
  if (std::uint64_t(high) - low < 8 * corners + 1024) {  // a table costs no more than the triangles
    std::vector<std::uint32_t> place(std::size_t(high) - low + 1, 0);
    for (const Triangle& t : p.triangles) {
      for (const std::uint32_t v : t) place[v - low] = 1;
    }
    for (std::size_t i = 0; i < place.size(); ++i) {
      if (place[i] == 0) continue;
      place[i] = static_cast<std::uint32_t>(p.used.size());
      p.used.push_back(low + static_cast<std::uint32_t>(i));
    }
    for (Triangle& t : p.triangles) {
      for (std::uint32_t& v : t) v = place[v - low];
    }
    return;
  }
  for (const Triangle& t : p.triangles) p.used.insert(p.used.end(), t.begin(), t.end());
  std::sort(p.used.begin(), p.used.end());
  p.used.erase(std::unique(p.used.begin(), p.used.end()), p.used.end());
  for (Triangle& t : p.triangles) {
    for (std::uint32_t& v : t) {
      v = static_cast<std::uint32_t>(std::lower_bound(p.used.begin(), p.used.end(), v) -
                                     p.used.begin());
    }
  }
}

Expected<Assembly> assemble(const PrimitiveSource& source, const std::stop_token& stop) {
  Assembly out;
  out.triangles.resize(source.triangle_count);
  for (std::uint64_t i = 0; i < source.triangle_count; ++i) {
    if ((i & kPollMask) == 0 && stop.stop_requested()) return canceled();
    out.triangles[i] = source.triangle(i);
  }
  compact(out);
  return out;
}

/// Mode, indices and counts.
Expected<void> open_triangles(PrimitiveSource& out, Document& document, Accessors& accessors,
                              const tinygltf::Primitive& primitive, GeometryBudget& budget,
                              const std::stop_token& stop) {
  out.mode = primitive.mode;
  if (primitive.indices >= 0) {
    const auto view = accessors.open(primitive.indices, {1, 1, kIndexTypes, false}, "indices");
    if (!view) return Unexpected(view.error());
    out.indices = *view;
  }
  const std::uint64_t corners = out.indices ? out.indices->count : out.positions.count;
  out.triangle_count = triangle_count(primitive.mode, corners);
  out.vertex_bound =
      out.normals ? std::min(3 * out.triangle_count, out.positions.count) : 3 * out.triangle_count;
  auto taken = budget.take(out.vertex_bound, out.triangle_count, out.pointer);
  if (!taken) return taken;
  if (out.indices) {
    auto checked = check_indices(*out.indices, out.positions.count, out.pointer + "/indices", stop);
    if (!checked) return checked;
  }
  if (primitive.mode == TINYGLTF_MODE_TRIANGLES && corners % 3 != 0) {
    document.warnings.add("incomplete_triangle", out.pointer,
                          "the number of vertices is no multiple of 3: the last are left out");
  }
  return {};
}

/// Why a primitive has no triangles to bake; "" when it may have some.
std::string no_triangles(const tinygltf::Primitive& primitive) {
  if (primitive.mode < TINYGLTF_MODE_TRIANGLES) return "points and lines are not baked";
  if (!primitive.attributes.contains("POSITION"))
    return "a primitive without POSITION is not baked";
  return "";
}

// Placing -----------------------------------------------------------------------------------------

/// The same measure as everywhere: what geometric_normal can make a unit vector of.
bool has_area(Vec3 a, Vec3 b, Vec3 c) {
  const Vec3 n = cross(b - a, c - a);
  return dot(n, n) >= std::numeric_limits<float>::min();
}

Vec3 face_normal(const WorldPrimitive& w, const Triangle& t) {
  return normalize(
      cross(w.positions[t[1]] - w.positions[t[0]], w.positions[t[2]] - w.positions[t[0]]));
}

/// A vertex in world space.
Expected<Vec3> world_point(const PrimitiveSource& source, std::uint32_t vertex,
                           const Transform& to_world) {
  const auto p = source.positions.floats(vertex);
  const Vec3 point = to_world.point({p[0], p[1], p[2]});
  if (!(max_abs(point) <= kMaxCoordinate)) {
    return invalid("vertex " + std::to_string(vertex) + " lies beyond 1e9 m in world space",
                   source.pointer + "/attributes/POSITION");
  }
  return point;
}

/// Three vertices for each triangle, with the triangle's normal.
void emit_flat(WorldPrimitive& out, const std::vector<std::uint32_t>& used,
               const std::vector<Vec3>& points) {
  for (Triangle& t : out.triangles) {
    const auto first = static_cast<std::uint32_t>(out.positions.size());
    for (const std::uint32_t v : t) {
      out.positions.push_back(points[v]);
      out.source_vertex.push_back(used[v]);
    }
    t = {first, first + 1, first + 2};
    out.normals.insert(out.normals.end(), 3, face_normal(out, t));
  }
}

/// Vertices without a normal get the sum of their faces' area vectors.
void repair_normals(WorldPrimitive& out, const std::vector<bool>& broken) {
  for (const Triangle& t : out.triangles) {
    const Vec3 area =
        cross(out.positions[t[1]] - out.positions[t[0]], out.positions[t[2]] - out.positions[t[0]]);
    for (const std::uint32_t v : t) {
      if (broken[v]) out.normals[v] += area;
    }
  }
  for (const Triangle& t : out.triangles) {
    for (const std::uint32_t v : t) {
      if (broken[v]) out.normals[v] = normalize(out.normals[v], face_normal(out, t));
    }
  }
}

/// Vertices in source order, those that no triangle uses any more left out.
void emit_smooth(WorldPrimitive& out, const AccessorView& normals,
                 const std::vector<std::uint32_t>& used, const std::vector<Vec3>& points,
                 const Transform& to_world) {
  constexpr std::uint32_t kUnused = 0xffffffffu;
  std::vector<std::uint32_t> place(points.size(), kUnused);
  for (const Triangle& t : out.triangles) {
    for (const std::uint32_t v : t) place[v] = 0;
  }
  Transform normal_map;  // inverse transpose, up to a positive factor
  normal_map.m = to_world.cofactors();
  const float side = to_world.determinant() < 0 ? -1.f : 1.f;
  std::vector<bool> broken;
  for (std::uint32_t v = 0; v < points.size(); ++v) {
    if (place[v] == kUnused) continue;
    place[v] = static_cast<std::uint32_t>(out.positions.size());
    const auto n = normals.floats(used[v]);
    const Vec3 unit = normalize({n[0], n[1], n[2]}, {0, 0, 0});
    const Vec3 normal =
        normalize(normalize(normal_map.direction(unit), {0, 0, 0}) * side, {0, 0, 0});
    broken.push_back(normal == Vec3{0, 0, 0});
    out.broken_normals += broken.back() ? 1 : 0;
    out.positions.push_back(points[v]);
    out.normals.push_back(normal);
    out.source_vertex.push_back(used[v]);
  }
  for (Triangle& t : out.triangles) t = {place[t[0]], place[t[1]], place[t[2]]};
  if (out.broken_normals > 0) repair_normals(out, broken);
}

}  // namespace

Expected<void> GeometryBudget::take(std::uint64_t vertices, std::uint64_t triangles,
                                    const std::string& pointer) {
  if (vertices > vertices_ || triangles > triangles_) {
    return proto::fail("limit_exceeded",
                       "the scene has too many " +
                           std::string(triangles > triangles_ ? "triangles" : "vertices") +
                           ", each use of a mesh counted",
                       "scene", pointer);
  }
  vertices_ -= vertices;
  triangles_ -= triangles;
  return {};
}

Expected<std::optional<PrimitiveSource>> open_primitive(Document& document, Accessors& accessors,
                                                        std::uint32_t mesh, std::uint32_t primitive,
                                                        GeometryBudget& budget,
                                                        const std::stop_token& stop) {
  if (stop.stop_requested()) return canceled();
  const auto& p = document.model->meshes[mesh].primitives[primitive];
  PrimitiveSource out;
  out.pointer = pointer_to(pointer_to("/meshes", mesh) + "/primitives", primitive);
  if (const std::string why = no_triangles(p); !why.empty()) {
    document.warnings.add("not_triangles", out.pointer, why);
    return std::optional<PrimitiveSource>();
  }
  const auto& positions =
      document.model->accessors[static_cast<std::size_t>(p.attributes.at("POSITION"))];
  if (p.extensions.contains("KHR_draco_mesh_compression") && positions.bufferView < 0) {
    return proto::fail(
        "unsupported_extension",
        "the primitive has no data but KHR_draco_mesh_compression, which is not supported", "scene",
        out.pointer + "/extensions/KHR_draco_mesh_compression");
  }
  if (auto opened = open_attributes(out, document, accessors, p); !opened) {
    return Unexpected(opened.error());
  }
  if (!p.targets.empty()) {
    document.warnings.add("morph_ignored", out.pointer + "/targets",
                          "morph targets are not applied: the base shape is baked");
  }
  if (auto opened = open_triangles(out, document, accessors, p, budget, stop); !opened) {
    return Unexpected(opened.error());
  }
  if (out.triangle_count == 0) return std::optional<PrimitiveSource>();
  return std::optional(std::move(out));
}

Triangle PrimitiveSource::triangle(std::uint64_t i) const {
  const auto at = triangle_corners(mode, i);
  Triangle out;
  for (std::size_t k = 0; k < 3; ++k) {
    out[k] = indices ? indices->index(at[k]) : static_cast<std::uint32_t>(at[k]);
  }
  return out;
}

Expected<WorldPrimitive> place_primitive(const PrimitiveSource& source, const Transform& to_world,
                                         const std::stop_token& stop) {
  const auto assembly = assemble(source, stop);
  if (!assembly) return Unexpected(assembly.error());
  std::vector<Vec3> points(assembly->used.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    if ((i & kPollMask) == 0 && stop.stop_requested()) return canceled();
    const auto point = world_point(source, assembly->used[i], to_world);
    if (!point) return Unexpected(point.error());
    points[i] = *point;
  }
  const bool mirrored = to_world.determinant() < 0;
  WorldPrimitive out;
  for (std::size_t i = 0; i < assembly->triangles.size(); ++i) {
    if ((i & kPollMask) == 0 && stop.stop_requested()) return canceled();
    const Triangle t = assembly->triangles[i];
    if (!has_area(points[t[0]], points[t[1]], points[t[2]])) {
      ++out.degenerate;
      continue;
    }
    out.triangles.push_back(mirrored ? Triangle{t[0], t[2], t[1]} : t);
  }
  if (source.normals) {
    emit_smooth(out, *source.normals, assembly->used, points, to_world);
  } else {
    emit_flat(out, assembly->used, points);
  }
  return out;
}

Expected<bool> has_triangles(const PrimitiveSource& source, const Transform& to_world,
                             const std::stop_token& stop) {
  bool any = false;
  for (std::uint64_t i = 0; i < source.triangle_count; ++i) {
    if ((i & kPollMask) == 0 && stop.stop_requested()) return canceled();
    const Triangle t = source.triangle(i);
    std::array<Vec3, 3> corner;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto point = world_point(source, t[k], to_world);
      if (!point) return Unexpected(point.error());
      corner[k] = *point;
    }
    any = any || has_area(corner[0], corner[1], corner[2]);
  }
  return any;
}

}  // namespace kiln::baker
