#include "baker/import/graph.h"

#include <cmath>
#include <optional>
#include <string>

#include "baker/exec/stop.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/json.h"
#include "baker/gltf/tinygltf.h"

namespace kiln::import {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr std::uint32_t kNone = 0xffffffffu;

std::string node_pointer(std::uint32_t node) {
  return gltf::pointer_to("/nodes", node);
}

proto::Expected<Transform> matrix_transform(const std::vector<double>& m, const std::string& at) {
  constexpr double kSlack = 1e-6;
  if (std::abs(m[3]) > kSlack || std::abs(m[7]) > kSlack || std::abs(m[11]) > kSlack ||
      std::abs(m[15] - 1) > kSlack) {
    return gltf::invalid("is not affine: its last row must be 0, 0, 0, 1", at + "/matrix");
  }
  Transform out;
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column) out.m[row][column] = m[column * 4 + row];
    out.t[row] = m[12 + row];
  }
  return out;
}

/// Returns the rotation by a quaternion x, y, z, w of any length but zero.
Expected<Transform> rotation_transform(const std::vector<double>& q, const std::string& at) {
  const double n = q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3];
  if (!(n > 1e-12) || !std::isfinite(n))
    return gltf::invalid("is not a quaternion", at + "/rotation");
  const double s = 2 / n, x = q[0], y = q[1], z = q[2], w = q[3];
  Transform out;
  out.m = {{{1 - s * (y * y + z * z), s * (x * y - w * z), s * (x * z + w * y)},
            {s * (x * y + w * z), 1 - s * (x * x + z * z), s * (y * z - w * x)},
            {s * (x * z - w * y), s * (y * z + w * x), 1 - s * (x * x + y * y)}}};
  return out;
}

proto::Expected<Transform> local_transform(const tinygltf::Node& node, const std::string& at) {
  if (!node.matrix.empty()) return matrix_transform(node.matrix, at);
  Transform out;
  if (!node.rotation.empty()) {
    auto rotation = rotation_transform(node.rotation, at);
    if (!rotation) return rotation;
    out = *rotation;
  }
  for (std::size_t i = 0; i < 3; ++i) {
    for (std::size_t j = 0; j < 3 && !node.scale.empty(); ++j) out.m[i][j] *= node.scale[j];
    if (!node.translation.empty()) out.t[i] = node.translation[i];
  }
  return out;
}

/// Returns each node's parent, kNone for roots.
Expected<std::vector<std::uint32_t>> find_parents(const tinygltf::Model& model,
                                                  exec::StopPoll& stopped) {
  std::vector<std::uint32_t> parent(model.nodes.size(), kNone);
  for (std::uint32_t n = 0; n < model.nodes.size(); ++n) {
    if (stopped()) return exec::canceled();
    for (std::size_t c = 0; c < model.nodes[n].children.size(); ++c) {
      const auto child = static_cast<std::size_t>(model.nodes[n].children[c]);
      if (parent[child] != kNone) {
        return gltf::invalid("node " + std::to_string(child) + " already has the parent " +
                                 std::to_string(parent[child]),
                             gltf::pointer_to(node_pointer(n) + "/children", c));
      }
      parent[child] = n;
    }
  }
  return parent;
}

/// Refuses cycles: with one parent each, nodes that no root leads to lie on or under one.
Expected<void> check_no_cycle(const tinygltf::Model& model,
                              const std::vector<std::uint32_t>& parent, exec::StopPoll& stopped) {
  std::vector<std::uint32_t> open;
  std::size_t reached = 0;
  std::vector<bool> seen(parent.size(), false);
  for (std::uint32_t n = 0; n < parent.size(); ++n) {
    if (parent[n] == kNone) open.push_back(n);
  }
  while (!open.empty()) {
    if (stopped()) return exec::canceled();
    const auto n = open.back();
    open.pop_back();
    seen[n] = true;
    ++reached;
    for (const int child : model.nodes[n].children)
      open.push_back(static_cast<std::uint32_t>(child));
  }
  if (reached == parent.size()) return {};
  // Going up from any such node ends on the cycle; as many steps as nodes are enough.
  std::uint32_t n = 0;
  while (seen[n]) ++n;
  for (std::size_t step = 0; step < parent.size(); ++step) n = parent[n];
  return gltf::invalid("the node is its own ancestor", node_pointer(n) + "/children");
}

proto::Expected<std::vector<std::uint32_t>> scene_roots(gltf::Document& document,
                                                        const std::vector<std::uint32_t>& parent) {
  const auto& model = *document.model;
  std::vector<std::uint32_t> roots;
  if (model.scenes.empty()) {
    for (std::uint32_t n = 0; n < parent.size(); ++n) {
      if (parent[n] == kNone) roots.push_back(n);
    }
    document.warnings.add("no_scene", "", "the file has no scene: all its nodes are baked");
    return roots;
  }
  const auto scene = static_cast<std::size_t>(std::max(model.defaultScene, 0));
  const std::string at = gltf::pointer_to("/scenes", scene) + "/nodes";
  std::vector<bool> listed(parent.size(), false);
  for (std::size_t i = 0; i < model.scenes[scene].nodes.size(); ++i) {
    const auto n = static_cast<std::uint32_t>(model.scenes[scene].nodes[i]);
    if (parent[n] != kNone) {
      return gltf::invalid("node " + std::to_string(n) + " is a child of node " +
                               std::to_string(parent[n]) + ", not a root",
                           gltf::pointer_to(at, i));
    }
    if (listed[n])
      return gltf::invalid("lists node " + std::to_string(n) + " twice", gltf::pointer_to(at, i));
    listed[n] = true;
    roots.push_back(n);
  }
  return roots;
}

struct Visit {
  std::uint32_t node = 0, depth = 0;
  Transform parent;
};

}  // namespace

proto::Expected<std::vector<PlacedNode>> place_nodes(gltf::Document& document,
                                                     const files::ImportLimits& limits,
                                                     const std::stop_token& stop) {
  const auto& nodes = document.model->nodes;
  exec::StopPoll stopped(stop);
  const auto parent = find_parents(*document.model, stopped);
  if (!parent) return Unexpected(parent.error());
  if (auto acyclic = check_no_cycle(*document.model, *parent, stopped); !acyclic) {
    return Unexpected(acyclic.error());
  }
  const auto roots = scene_roots(document, *parent);
  if (!roots) return Unexpected(roots.error());
  std::vector<Visit> open;
  for (auto root = roots->rbegin(); root != roots->rend(); ++root) open.push_back({*root, 1, {}});
  std::vector<PlacedNode> placed;
  while (!open.empty()) {
    if (stopped()) return exec::canceled();
    const Visit visit = open.back();
    open.pop_back();
    const std::string at = node_pointer(visit.node);
    if (visit.depth > limits.node_depth) {
      return gltf::over_limit("nodes are nested too deep", limits.node_depth, "node_depth", at);
    }
    const auto local = local_transform(nodes[visit.node], at);
    if (!local) return Unexpected(local.error());
    placed.push_back({visit.node, visit.parent * *local});
    const auto& children = nodes[visit.node].children;
    for (auto child = children.rbegin(); child != children.rend(); ++child) {
      open.push_back({static_cast<std::uint32_t>(*child), visit.depth + 1, placed.back().to_world});
    }
  }
  return placed;
}

}  // namespace kiln::import
