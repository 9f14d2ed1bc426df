#include "baker/import/cameras.h"

#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "baker/gltf/findings.h"
#include "baker/gltf/json.h"
#include "baker/gltf/tinygltf.h"

namespace kiln::import {
namespace {

/// Returns the unit vector along a direction of the node's space; nothing when it has none.
std::optional<math::Vec3> direction(const Transform& to_world, math::Vec3 local) {
  const math::Vec3 v = to_world.direction(local);
  const float size = length(v);
  if (!(size > std::numeric_limits<float>::min()) || !std::isfinite(size)) return std::nullopt;
  return v * (1 / size);
}

std::optional<scene::Camera> place(const gltf::CameraSource& source, const std::string& node_name,
                                   const Transform& to_world) {
  constexpr std::size_t kBytes = scene::Camera::kNameBytes - 3;  // shortened() may add an ellipsis
  scene::Camera out;
  out.name = gltf::shortened(node_name.empty() ? source.name : node_name, kBytes);
  out.position = to_world.point({0, 0, 0});
  out.orthographic = source.orthographic;
  out.half_height = static_cast<float>(source.half_height);
  const auto forward = direction(to_world, {0, 0, -1}), up = direction(to_world, {0, 1, 0});
  if (!forward || !up || !is_finite(out.position) || !(out.half_height > 0) ||
      !std::isfinite(out.half_height))
    return std::nullopt;
  // A node that shears leaves the two askew.
  const math::Vec3 upright = *up - *forward * dot(*forward, *up);
  const float size = length(upright);
  if (!(size > 1e-4f)) return std::nullopt;
  out.forward = *forward;
  out.up = upright * (1 / size);
  return out;
}

}  // namespace

void add_cameras(scene::Scene& scene, gltf::Document& document,
                 const std::vector<PlacedNode>& placed) {
  const auto& nodes = document.model->nodes;
  for (const PlacedNode& node : placed) {
    const int index = nodes[node.node].camera;
    if (index < 0) continue;
    const std::string at = gltf::pointer_to("/nodes", node.node) + "/camera";
    if (scene.cameras.size() == scene::Camera::kMost) {
      document.warnings.add("camera_ignored", at,
                            "there are too many cameras: the rest is left out");
      continue;
    }
    auto camera = place(document.cameras[static_cast<std::size_t>(index)], nodes[node.node].name,
                        node.to_world);
    if (camera)
      scene.cameras.push_back(std::move(*camera));
    else
      document.warnings.add("camera_ignored", at,
                            "a camera without a size or a direction is left out");
  }
}

}  // namespace kiln::import
