#include "baker/scene/scene.h"

namespace kiln::scene {
namespace {

std::array<float, 256> make_srgb_table() {
  std::array<float, 256> table{};
  for (int i = 0; i < 256; ++i) {
    const double c = i / 255.0;
    table[i] = float(c <= 0.04045 ? c / 12.92 : std::pow((c + 0.055) / 1.055, 2.4));
  }
  return table;
}
const std::array<float, 256> kSrgbToLinear = make_srgb_table();

/// Returns the texel index for any integer coordinate [glTF 2.0, 5.26: wrap modes].
std::uint32_t wrap_index(std::int64_t i, std::int64_t n, Wrap wrap) {
  if (i >= 0 && i < n) return std::uint32_t(i);  // most indices are in range, and division is slow
  switch (wrap) {
    case Wrap::kClamp:
      return std::uint32_t(std::clamp<std::int64_t>(i, 0, n - 1));
    case Wrap::kMirror: {
      const std::int64_t m = ((i % (2 * n)) + 2 * n) % (2 * n);
      return std::uint32_t(m < n ? m : 2 * n - 1 - m);
    }
    case Wrap::kRepeat:
      break;
  }
  return std::uint32_t(((i % n) + n) % n);
}

/// Keeps texture coordinates in a range where a float still tells texels apart.
float bounded(float v) {
  return std::isfinite(v) ? std::clamp(v, -65536.f, 65536.f) : 0.f;
}

/// Returns the texture's bilinear value, of which `value` is that of one texel; `white` where there
/// is no texture.
template <class T, class Value>
T sample(const Scene& scene, const Texture& texture, math::Vec2 uv, T white, const Value& value) {
  if (texture.image < 0) return white;
  const Image& image = scene.images[texture.image];
  const float x = bounded(uv.x) * float(image.width), y = bounded(uv.y) * float(image.height);
  const auto at = [&](float ix, float iy) -> T {
    const std::uint32_t column = wrap_index(std::int64_t(ix), image.width, texture.wrap_u);
    const std::uint32_t row = wrap_index(std::int64_t(iy), image.height, texture.wrap_v);
    return value(scene.image_texels[image.first_texel + std::uint64_t(row) * image.width + column]);
  };
  if (texture.nearest) return at(std::floor(x), std::floor(y));
  const float x0 = std::floor(x - 0.5f), y0 = std::floor(y - 0.5f);
  const float fx = x - 0.5f - x0, fy = y - 0.5f - y0;
  return (at(x0, y0) * (1 - fx) + at(x0 + 1, y0) * fx) * (1 - fy) +
         (at(x0, y0 + 1) * (1 - fx) + at(x0 + 1, y0 + 1) * fx) * fy;
}

math::Rgb sample(const Scene& scene, const Texture& texture, math::Vec2 uv) {
  return sample(scene, texture, uv, math::Rgb{1, 1, 1}, [](const auto& t) {
    return math::Rgb{kSrgbToLinear[t[0]], kSrgbToLinear[t[1]], kSrgbToLinear[t[2]]};
  });
}

math::Vec2 interpolate_uv(const std::vector<math::Vec2>& uv, const std::array<std::uint32_t, 3>& v,
                          Bary t) {
  return uv[v[0]] * (1 - t.u - t.v) + uv[v[1]] * t.u + uv[v[2]] * t.v;
}

}  // namespace

float srgb_to_linear(std::uint8_t code) {
  return kSrgbToLinear[code];
}

math::Vec3 position_at(const Scene& scene, std::uint32_t triangle, Bary t) {
  const auto& v = scene.triangles[triangle];
  return interpolate(scene.positions[v[0]], scene.positions[v[1]], scene.positions[v[2]], t);
}

math::Vec3 geometric_normal(const Scene& scene, std::uint32_t triangle) {
  const auto& v = scene.triangles[triangle];
  const math::Vec3 p = scene.positions[v[0]];
  return normalize(cross(scene.positions[v[1]] - p, scene.positions[v[2]] - p));
}

math::Vec3 shading_normal(const Scene& scene, std::uint32_t triangle, Bary t) {
  const auto& v = scene.triangles[triangle];
  const math::Vec3 ng = geometric_normal(scene, triangle);
  const math::Vec3 ns =
      normalize(interpolate(scene.normals[v[0]], scene.normals[v[1]], scene.normals[v[2]], t), ng);
  return dot(ns, ng) < 0 ? -ns : ns;
}

float triangle_area(const Scene& scene, std::uint32_t triangle) {
  const auto& v = scene.triangles[triangle];
  const math::Vec3 p = scene.positions[v[0]];
  return 0.5f * length(cross(scene.positions[v[1]] - p, scene.positions[v[2]] - p));
}

math::Rgb albedo_at(const Scene& scene, std::uint32_t triangle, Bary t) {
  const auto& v = scene.triangles[triangle];
  const Material& m = scene.material_of(triangle);
  const float w0 = 1 - t.u - t.v;
  const auto& c0 = scene.colors[v[0]];
  const auto& c1 = scene.colors[v[1]];
  const auto& c2 = scene.colors[v[2]];
  const math::Rgb vertex{c0[0] * w0 + c1[0] * t.u + c2[0] * t.v,
                         c0[1] * w0 + c1[1] * t.u + c2[1] * t.v,
                         c0[2] * w0 + c1[2] * t.u + c2[2] * t.v};
  const math::Rgb a =
      m.base_color * vertex * sample(scene, m.base_texture, interpolate_uv(scene.base_uv, v, t));
  return {std::clamp(a.r, 0.f, 1.f), std::clamp(a.g, 0.f, 1.f), std::clamp(a.b, 0.f, 1.f)};
}

float alpha_at(const Scene& scene, std::uint32_t triangle, Bary t) {
  const auto& v = scene.triangles[triangle];
  const float vertex = scene.colors[v[0]][3] * (1 - t.u - t.v) + scene.colors[v[1]][3] * t.u +
                       scene.colors[v[2]][3] * t.v;
  const Texture& texture = scene.material_of(triangle).base_texture;
  const float a = vertex * sample(scene, texture, interpolate_uv(scene.base_uv, v, t), 1.f,
                                  [](const auto& texel) { return float(texel[3]) * (1.f / 255); });
  return std::clamp(a, 0.f, 1.f);
}

math::Rgb emission_at(const Scene& scene, std::uint32_t triangle, Bary t) {
  const Material& m = scene.material_of(triangle);
  if (is_black(m.emission)) return {};
  return m.emission * sample(scene, m.emission_texture,
                             interpolate_uv(scene.emission_uv, scene.triangles[triangle], t));
}

std::uint64_t memory_bytes(const Scene& s) {
  const auto bytes = [](const auto& v) { return std::uint64_t{v.size()} * sizeof(v[0]); };
  return bytes(s.positions) + bytes(s.normals) + bytes(s.base_uv) + bytes(s.emission_uv) +
         bytes(s.lightmap_uv) + bytes(s.colors) + bytes(s.source_vertex) + bytes(s.triangles) +
         bytes(s.triangle_part) + bytes(s.image_texels);
}

bool is_emissive(const Scene& scene, std::uint32_t triangle) {
  return !is_black(scene.material_of(triangle).emission);
}

}  // namespace kiln::scene
