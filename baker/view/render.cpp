#include "baker/view/render.h"

#include <algorithm>

#include "baker/exec/stop.h"

namespace kiln::view {
namespace {

using math::Rgb;
using math::Vec3;

constexpr std::uint32_t kTile = 64;  ///< pixels along a side
/// Points of a pixel, a rotated square: two edges that are nearly straight never pass all at once.
constexpr std::uint32_t kPoints = 4;
constexpr float kPlaces[kPoints][2] = {
    {0.375f, 0.125f}, {0.875f, 0.375f}, {0.125f, 0.625f}, {0.625f, 0.875f}};
/// A ray passes so many surfaces that are seen from behind, then it meets nothing.
constexpr int kMostPassed = 256;

class Renderer {
 public:
  Renderer(const Stage& stage, image::PageImage& picture) : stage_(stage), picture_(picture) {}

  /// Draws a tile, four pixels at a time: their sixteen rays go together.
  void draw_tile(std::uint32_t x0, std::uint32_t y0, const std::stop_token& stop) const {
    const std::uint32_t x1 = std::min(x0 + kTile, picture_.width);
    const std::uint32_t y1 = std::min(y0 + kTile, picture_.height);
    for (std::uint32_t y = y0; y < y1 && !stop.stop_requested(); y += 2)
      for (std::uint32_t x = x0; x < x1; x += 2) draw_block(x, y);
  }

 private:
  void draw_block(std::uint32_t x0, std::uint32_t y0) const {
    trace::RayPacket rays;
    for (std::uint32_t lane = 0; lane < 16; ++lane) {
      const std::uint32_t x = x0 + lane / kPoints % 2, y = y0 + lane / kPoints / 2;
      const float* place = kPlaces[lane % kPoints];
      const float px = 2 * (float(x) + place[0]) / float(picture_.width) - 1;
      const float py = 1 - 2 * (float(y) + place[1]) / float(picture_.height);
      const Lens::Ray ray = stage_.lens.through(px, py);
      rays.set(lane, ray.origin, ray.direction, INFINITY);
      if (x < picture_.width && y < picture_.height) rays.active |= 1u << lane;
    }
    trace::HitPacket seen;
    look(rays, seen);
    for (std::uint32_t pixel = 0; pixel < 4; ++pixel) {
      const std::uint32_t x = x0 + pixel % 2, y = y0 + pixel / 2;
      if (x >= picture_.width || y >= picture_.height) continue;
      Rgb sum;
      int hits = 0;
      for (std::uint32_t lane = pixel * kPoints; lane < (pixel + 1) * kPoints; ++lane) {
        if (seen.triangle[lane] == trace::kNoHit) continue;
        sum += value(seen.triangle[lane], {seen.u[lane], seen.v[lane]});
        ++hits;
      }
      const std::size_t at = std::size_t(y) * picture_.width + x;
      if (hits > 0) picture_.rgb[at] = sum * (1 / float(hits));
      picture_.coverage[at] = float(hits) / kPoints;
    }
  }

  /// Finds what the rays see: the first surface that is not one-sided and met from behind. Leaves
  /// the origins of rays that passed surfaces behind the last one.
  void look(trace::RayPacket& rays, trace::HitPacket& seen) const {
    std::fill(std::begin(seen.triangle), std::end(seen.triangle), trace::kNoHit);
    for (int passed = 0; rays.active != 0 && passed <= kMostPassed; ++passed) {
      trace::HitPacket hits;
      stage_.rays.closest(rays, hits, true);
      for (std::uint32_t lane = 0; lane < 16; ++lane) {
        const std::uint32_t bit = 1u << lane;
        if ((rays.active & bit) == 0) continue;
        const std::uint32_t triangle = hits.triangle[lane];
        const bool hidden = triangle != trace::kNoHit && hits.back[lane] != 0 &&
                            !stage_.scene.material_of(triangle).double_sided;
        if (hidden) {
          pass(rays, lane, hits.t[lane]);
          continue;
        }
        rays.active &= ~bit;
        seen.triangle[lane] = triangle;
        seen.u[lane] = hits.u[lane];
        seen.v[lane] = hits.v[lane];
      }
    }
  }

  /// Moves a ray's origin behind the surface at distance t.
  void pass(trace::RayPacket& rays, std::uint32_t lane, float t) const {
    const Vec3 origin{rays.org_x[lane], rays.org_y[lane], rays.org_z[lane]};
    const Vec3 direction{rays.dir_x[lane], rays.dir_y[lane], rays.dir_z[lane]};
    const Vec3 at = origin + direction * t;
    const Vec3 behind = at + direction * stage_.rays.offset(at);
    if (is_finite(behind))
      rays.set(lane, behind, direction, INFINITY);
    else
      rays.active &= ~(1u << lane);
  }

  Rgb value(std::uint32_t triangle, scene::Bary at) const {
    const scene::Scene& scene = stage_.scene;
    const auto& v = scene.triangles[triangle];
    const math::Vec2 uv = scene.lightmap_uv[v[0]] * (1 - at.u - at.v) +
                          scene.lightmap_uv[v[1]] * at.u + scene.lightmap_uv[v[2]] * at.v;
    const MeshPlace& place = stage_.places[scene.parts[scene.triangle_part[triangle]].instance];
    const math::Vec2 on_page{uv.x * place.scale.x + place.offset.x,
                             uv.y * place.scale.y + place.offset.y};
    const image::PageImage& page = stage_.pages.images[place.page];
    const Rgb found = stage_.request.nearest ? nearest(page, on_page) : bilinear(page, on_page);
    if (!stage_.request.shaded) return found;
    Rgb albedo = albedo_at(scene, triangle, at);
    albedo = {std::min(albedo.r, scene::kMaxAlbedo), std::min(albedo.g, scene::kMaxAlbedo),
              std::min(albedo.b, scene::kMaxAlbedo)};
    return emission_at(scene, triangle, at) + found * albedo * (1 / math::kPi);
  }

  const Stage& stage_;
  image::PageImage& picture_;
};

}  // namespace

proto::Expected<image::PageImage> render(const Stage& stage, exec::ThreadPool& pool,
                                         const std::stop_token& stop) {
  const Size size = stage.request.size;
  image::PageImage picture{size.width, size.height, {}, {}};
  picture.rgb.resize(std::size_t(size.width) * size.height);
  picture.coverage.resize(picture.rgb.size());
  const Renderer renderer(stage, picture);
  const std::uint32_t columns = (size.width + kTile - 1) / kTile;
  const std::uint32_t rows = (size.height + kTile - 1) / kTile;
  const bool whole = pool.for_batches(columns * rows, stop, [&](std::uint32_t tile) {
    renderer.draw_tile(tile % columns * kTile, tile / columns * kTile, stop);
  });
  if (!whole || stop.stop_requested()) return exec::canceled();
  return picture;
}

}  // namespace kiln::view
