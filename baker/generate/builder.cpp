#include "baker/generate/builder.h"

#include <algorithm>
#include <numeric>

#include "baker/image/page_image.h"

namespace kiln::generate {
namespace {

/// Returns the unit normal of the surface |x| = radius * relief(x / |x|), which is the gradient of
/// |x| - r(x/|x|).
math::Vec3 relief_normal(math::Vec3 direction, float r, const Relief& relief) {
  constexpr float kStep = 1.f / 1024;
  const auto along = [&](math::Vec3 axis) {
    return (relief(normalize(direction + axis * kStep)) -
            relief(normalize(direction - axis * kStep))) /
           (2 * kStep);
  };
  const math::Vec3 gradient{along({1, 0, 0}), along({0, 1, 0}), along({0, 0, 1})};
  const math::Vec3 tangential = gradient - direction * dot(gradient, direction);
  return normalize(direction - tangential * (1 / r), direction);
}

std::uint32_t cells(float meters, double cells_per_meter) {
  return std::max(1u, static_cast<std::uint32_t>(double(meters) * cells_per_meter));
}

bool try_pack(const std::vector<math::Vec2>& sizes_m, const std::vector<std::size_t>& order,
              double cells_per_meter, std::vector<CellRect>& rects) {
  constexpr std::uint32_t kGap = 2, kBorder = 1, kEnd = kCells - kBorder;
  std::uint32_t x = kBorder, y = kBorder, row_height = 0;
  for (const std::size_t i : order) {
    const std::uint32_t w = cells(sizes_m[i].x, cells_per_meter);
    const std::uint32_t h = cells(sizes_m[i].y, cells_per_meter);
    if (x + w > kEnd) {
      x = kBorder;
      y += row_height + kGap;
      row_height = 0;
    }
    if (x + w > kEnd || y + h > kEnd) return false;
    rects[i] = {x, y, w, h};
    x += w + kGap;
    row_height = std::max(row_height, h);
  }
  return true;
}

void append_patch(gltf::GlbPrimitive& out, const Patch& patch, const CellRect& rect,
                  float texture_m) {
  const auto first = static_cast<std::uint32_t>(out.positions.size());
  const std::uint32_t columns = patch.columns, rows = patch.rows;
  for (std::uint32_t j = 0; j <= rows; ++j)
    for (std::uint32_t i = 0; i <= columns; ++i) {
      if (patch.triangle && i + j > columns) continue;
      const float s = float(i) / float(columns), t = float(j) / float(rows);
      const SurfacePoint p = patch.at(i, j);
      out.positions.push_back(p.position);
      out.normals.push_back(p.normal);
      // v runs down the image and t up the surface, so nothing is mirrored when seen from the
      // front.
      out.uv0.push_back({s * patch.width_m / texture_m, (1 - t) * patch.height_m / texture_m});
      out.uv1.push_back({(float(rect.x) + s * float(rect.width)) / float(kCells),
                         (float(rect.y) + (1 - t) * float(rect.height)) / float(kCells)});
    }
  if (patch.triangle) {
    out.triangles.push_back({first, first + 1, first + 2});
    return;
  }
  for (std::uint32_t j = 0; j < rows; ++j)
    for (std::uint32_t i = 0; i < columns; ++i) {
      const std::uint32_t a = first + j * (columns + 1) + i, b = a + 1, c = b + columns + 1,
                          d = c - 1;
      out.triangles.push_back({a, b, c});
      out.triangles.push_back({a, c, d});
    }
}

}  // namespace

std::vector<CellRect> pack_charts(const std::vector<math::Vec2>& sizes_m) {
  std::vector<std::size_t> order(sizes_m.size());
  std::iota(order.begin(), order.end(), std::size_t(0));
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return sizes_m[a].y != sizes_m[b].y ? sizes_m[a].y > sizes_m[b].y : sizes_m[a].x > sizes_m[b].x;
  });
  std::vector<CellRect> rects(sizes_m.size()), tried(sizes_m.size());
  double low = 0, high = 1;
  while (try_pack(sizes_m, order, high, tried)) high *= 2;
  for (int step = 0; step < 40; ++step) {
    const double middle = (low + high) / 2;
    if (try_pack(sizes_m, order, middle, tried)) {
      rects = tried;
      low = middle;
    } else {
      high = middle;
    }
  }
  return rects;
}

std::string make_png(
    std::uint32_t size,
    const std::function<std::array<std::uint8_t, 3>(std::uint32_t, std::uint32_t)>& color) {
  std::vector<std::array<std::uint8_t, 3>> pixels;
  for (std::uint32_t y = 0; y < size; ++y)
    for (std::uint32_t x = 0; x < size; ++x) pixels.push_back(color(x, y));
  return image::encode_png(pixels, size, size).value();
}

std::int32_t SceneBuilder::material(std::string name, math::Rgb base_color, math::Rgb emission) {
  gltf::GlbMaterial m;
  m.name = std::move(name);
  m.base_color = base_color;
  m.emission = emission;
  doc_.materials.push_back(std::move(m));
  texture_size_m_.push_back(1);
  return static_cast<std::int32_t>(doc_.materials.size()) - 1;
}

void SceneBuilder::texture(std::int32_t material, std::string png, float size_m) {
  gltf::GlbMaterial& m = doc_.materials[std::size_t(material)];
  (is_black(m.emission) ? m.base_image : m.emission_image) =
      static_cast<std::int32_t>(doc_.images.size());
  doc_.images.push_back(std::move(png));
  texture_size_m_[std::size_t(material)] = size_m;
}

void SceneBuilder::quad(const std::string& node, std::int32_t material, math::Vec3 corner,
                        math::Vec3 edge_u, math::Vec3 edge_v) {
  const math::Vec3 normal = normalize(cross(edge_u, edge_v));
  const auto at = [=](std::uint32_t i, std::uint32_t j) {
    return SurfacePoint{corner + edge_u * float(i) + edge_v * float(j), normal};
  };
  patches_.push_back({node, material, length(edge_u), length(edge_v), 1, 1, false, at});
}

void SceneBuilder::triangle(const std::string& node, std::int32_t material, math::Vec3 corner,
                            math::Vec3 edge_u, math::Vec3 edge_v) {
  quad(node, material, corner, edge_u, edge_v);
  patches_.back().triangle = true;
}

void SceneBuilder::faces(const std::string& node, std::int32_t material, const Box& box,
                         unsigned faces, bool inwards) {
  const math::Vec3 axis_z = cross(box.axis_x, {0, 1, 0});
  const math::Vec3 middle = box.bottom + math::Vec3{0, box.size.y / 2, 0};
  const auto place = [&](math::Vec3 unit) {
    return box.axis_x * (unit.x * box.size.x / 2) + math::Vec3{0, unit.y * box.size.y / 2, 0} +
           axis_z * (unit.z * box.size.z / 2);
  };
  for (const CubeFace& f : kCube) {
    if ((faces & f.face) == 0) continue;
    math::Vec3 u = place(f.edge_u);
    const math::Vec3 v = place(f.edge_v);
    if (inwards) u = -u;
    quad(node, material, middle + place(f.center) - u - v, u * 2, v * 2);
  }
}

void SceneBuilder::solid(const std::string& node, std::int32_t material, const Box& box,
                         unsigned f) {
  faces(node, material, box, f, false);
}

void SceneBuilder::room(const std::string& node, std::int32_t material, const Box& box,
                        unsigned f) {
  faces(node, material, box, f, true);
}

void SceneBuilder::ball(const std::string& node, std::int32_t material, math::Vec3 center,
                        float radius, std::uint32_t detail, const Relief& relief) {
  for (const CubeFace& f : kCube) {
    const auto signed_share = [=](std::uint32_t i) {
      return (2 * float(i) - float(detail)) / float(detail);
    };
    const auto at = [=](std::uint32_t i, std::uint32_t j) {
      const math::Vec3 d =
          normalize(f.center + f.edge_u * signed_share(i) + f.edge_v * signed_share(j));
      if (!relief) return SurfacePoint{center + d * radius, d};
      const float r = relief(d);
      return SurfacePoint{center + d * (radius * r), relief_normal(d, r, relief)};
    };
    const float side_m = radius * math::kPi / 2;
    patches_.push_back({node, material, side_m, side_m, detail, detail, false, at});
  }
}

void SceneBuilder::light(gltf::GlbLight light, math::Vec3 position, math::Vec3 direction) {
  gltf::GlbNode node;
  node.name = light.name;
  node.light = static_cast<std::int32_t>(doc_.lights.size());
  node.translation = position;
  node.direction = normalize(direction);
  doc_.lights.push_back(std::move(light));
  doc_.nodes.push_back(std::move(node));
}

gltf::GlbPrimitive& SceneBuilder::primitive_of(const Patch& patch) {
  const auto same_name = [&](const gltf::GlbMesh& m) { return m.name == patch.node; };
  auto mesh = std::find_if(doc_.meshes.begin(), doc_.meshes.end(), same_name);
  if (mesh == doc_.meshes.end()) {
    gltf::GlbNode node;
    node.name = patch.node;
    node.mesh = static_cast<std::int32_t>(doc_.meshes.size());
    doc_.nodes.push_back(std::move(node));
    mesh = doc_.meshes.insert(doc_.meshes.end(), gltf::GlbMesh{patch.node, {}});
  }
  for (gltf::GlbPrimitive& p : mesh->primitives)
    if (p.material == patch.material) return p;
  gltf::GlbPrimitive fresh;
  fresh.material = patch.material;
  mesh->primitives.push_back(std::move(fresh));
  return mesh->primitives.back();
}

std::string SceneBuilder::finish() {
  std::vector<math::Vec2> sizes_m;
  for (const Patch& p : patches_) sizes_m.push_back({p.width_m, p.height_m});
  const std::vector<CellRect> rects = pack_charts(sizes_m);
  for (std::size_t i = 0; i < patches_.size(); ++i)
    append_patch(primitive_of(patches_[i]), patches_[i], rects[i],
                 texture_size_m_[std::size_t(patches_[i].material)]);
  return write_glb(doc_);
}

}  // namespace kiln::generate
