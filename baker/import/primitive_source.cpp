#include "baker/import/primitive_source.h"

#include <algorithm>
#include <charconv>
#include <set>
#include <string_view>

#include "baker/exec/stop.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/json.h"
#include "baker/gltf/tinygltf.h"

namespace kiln::import {
namespace {

using proto::Expected;
using proto::Unexpected;
using Triangle = std::array<std::uint32_t, 3>;

// Formats [glTF 2.0, 3.7.2.1; KHR_mesh_quantization] ----------------------------------------------
using Types = std::vector<std::pair<gltf::Component, bool>>;
const Types kFloatOnly{{gltf::Component::kFloat, false}};
const Types kQuantized{
    {gltf::Component::kByte, false},          {gltf::Component::kByte, true},
    {gltf::Component::kUnsignedByte, false},  {gltf::Component::kUnsignedByte, true},
    {gltf::Component::kShort, false},         {gltf::Component::kShort, true},
    {gltf::Component::kUnsignedShort, false}, {gltf::Component::kUnsignedShort, true}};
const Types kUnit{{gltf::Component::kFloat, false},
                  {gltf::Component::kUnsignedByte, true},
                  {gltf::Component::kUnsignedShort, true}};
const Types kIndexTypes{{gltf::Component::kUnsignedByte, false},
                        {gltf::Component::kUnsignedShort, false},
                        {gltf::Component::kUnsignedInt, false}};

Types with_quantized(const Types& types, const gltf::Document& document) {
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
  AttributeReader(gltf::Document& document, gltf::Accessors& accessors,
                  const tinygltf::Primitive& primitive, const std::string& at)
      : document_(document),
        accessors_(accessors),
        primitive_(primitive),
        at_(at + "/attributes") {}

  proto::Expected<std::optional<gltf::AccessorView>> open(const std::string& name,
                                                          std::uint32_t min_components,
                                                          std::uint32_t max_components,
                                                          const Types& types) {
    const auto found = primitive_.attributes.find(name);
    if (found == primitive_.attributes.end()) return std::optional<gltf::AccessorView>();
    auto view = accessors_.open(
        found->second, {min_components, max_components, with_quantized(types, document_)}, name);
    if (!view) return Unexpected(view.error());
    if (!count_) count_ = view->count;
    if (view->count != *count_) {
      return gltf::invalid("has " + std::to_string(view->count) + " elements, but POSITION has " +
                               std::to_string(*count_),
                           gltf::pointer_to(at_, std::string_view(name)));
    }
    return std::optional(*view);
  }

 private:
  gltf::Document& document_;
  gltf::Accessors& accessors_;
  const tinygltf::Primitive& primitive_;
  std::string at_;
  std::optional<std::uint64_t> count_;
};

/// Returns the n of all TEXCOORD_n, ascending.
std::set<std::uint32_t> texcoord_sets(const tinygltf::Primitive& primitive) {
  constexpr std::string_view kPrefix = "TEXCOORD_";
  std::set<std::uint32_t> out;
  for (const auto& [name, accessor] : primitive.attributes) {
    if (!name.starts_with(kPrefix)) continue;
    const std::string_view number = std::string_view(name).substr(kPrefix.size());
    std::uint32_t set = 0;
    std::from_chars(number.data(), number.data() + number.size(), set);
    if (number == std::to_string(set)) out.insert(set);
  }
  return out;
}

/// Warns where sets of texture coordinates have gaps. They must be numbered from 0 without gaps
/// [glTF 2.0, 3.7.2.1]; exporters that drop a first set that nothing reads leave the lightmap's
/// behind as TEXCOORD_1, and it is clear what is meant.
void warn_of_gap(const PrimitiveSource& source, gltf::Document& document) {
  std::uint32_t next = 0;
  for (const auto& [set, view] : source.uv_sets) {
    if (set != next++)
      return document.warnings.add("texcoord_gap", source.pointer + "/attributes",
                                   "there is a TEXCOORD_" + std::to_string(set) +
                                       " but no TEXCOORD_" + std::to_string(next - 1) +
                                       ", which glTF does not allow: it is used all the same");
  }
}

proto::Expected<void> open_attributes(PrimitiveSource& out, gltf::Document& document,
                                      gltf::Accessors& accessors,
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
  for (const std::uint32_t set : texcoord_sets(primitive)) {
    const auto uv = reader.open("TEXCOORD_" + std::to_string(set), 2, 2, kUnit);
    if (!uv) return Unexpected(uv.error());
    out.uv_sets.emplace(set, **uv);
  }
  warn_of_gap(out, document);
  return {};
}

// Triangles ---------------------------------------------------------------------------------------

std::uint64_t triangle_count(int mode, std::uint64_t corners) {
  if (mode == TINYGLTF_MODE_TRIANGLES) return corners / 3;
  return corners < 3 ? 0 : corners - 2;
}

/// Returns the places of triangle i in the list of corners [glTF 2.0, 3.7.2.1].
std::array<std::uint64_t, 3> triangle_corners(int mode, std::uint64_t i) {
  if (mode == TINYGLTF_MODE_TRIANGLES) return {3 * i, 3 * i + 1, 3 * i + 2};
  if (mode == TINYGLTF_MODE_TRIANGLE_FAN) return {i + 1, i + 2, 0};
  return {i, i + 1 + i % 2, i + 2 - i % 2};
}

std::uint32_t restart_value(gltf::Component c) {
  if (c == gltf::Component::kUnsignedByte) return 0xffu;
  return c == gltf::Component::kUnsignedShort ? 0xffffu : 0xffffffffu;
}

proto::Expected<void> check_indices(const gltf::AccessorView& indices, std::uint64_t vertex_count,
                                    const std::string& at, const std::stop_token& stop) {
  const std::uint32_t restart = restart_value(indices.component);
  exec::StopPoll stopped(stop);
  for (std::uint64_t i = 0; i < indices.count; ++i) {
    if (stopped()) return exec::canceled();
    const std::uint32_t index = indices.index(i);
    if (index == restart) {
      return gltf::invalid("element " + std::to_string(i) + " is the primitive restart value " +
                               std::to_string(index) + ", which glTF forbids",
                           at);
    }
    if (index >= vertex_count) {
      return gltf::invalid("element " + std::to_string(i) + " is the index " +
                               std::to_string(index) + ", but there are " +
                               std::to_string(vertex_count) + " vertices",
                           at);
    }
  }
  return {};
}

/// Opens mode, indices and counts.
Expected<void> open_triangles(PrimitiveSource& out, gltf::Document& document,
                              gltf::Accessors& accessors, const tinygltf::Primitive& primitive,
                              GeometryBudget& budget, const std::stop_token& stop) {
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

/// Says why a primitive has no triangles to bake; "" when it may have some.
std::string no_triangles(const tinygltf::Primitive& primitive) {
  if (primitive.mode < TINYGLTF_MODE_TRIANGLES) return "points and lines are not baked";
  if (!primitive.attributes.contains("POSITION"))
    return "a primitive without POSITION is not baked";
  return "";
}

}  // namespace

proto::Expected<void> GeometryBudget::take(std::uint64_t vertices, std::uint64_t triangles,
                                           const std::string& pointer) {
  if (vertices > vertices_ || triangles > triangles_) {
    constexpr const char* kCounted = ", each use of a mesh counted";
    if (triangles > triangles_)
      return gltf::over_limit(std::string("too many triangles") + kCounted, limits_.triangles,
                              "triangles", pointer);
    return gltf::over_limit(std::string("too many vertices") + kCounted, limits_.vertices,
                            "vertices", pointer);
  }
  vertices_ -= vertices;
  triangles_ -= triangles;
  return {};
}

proto::Expected<std::optional<PrimitiveSource>> open_primitive(
    gltf::Document& document, gltf::Accessors& accessors, std::uint32_t mesh,
    std::uint32_t primitive, GeometryBudget& budget, const std::stop_token& stop) {
  if (stop.stop_requested()) return exec::canceled();
  const auto& p = document.model->meshes[mesh].primitives[primitive];
  PrimitiveSource out;
  out.pointer = gltf::pointer_to(gltf::pointer_to("/meshes", mesh) + "/primitives", primitive);
  if (const std::string why = no_triangles(p); !why.empty()) {
    document.warnings.add("not_triangles", out.pointer, why);
    return std::optional<PrimitiveSource>();
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

}  // namespace kiln::import
