#include "tests/support/quad_scene.h"

#include <cstring>
#include <stdexcept>

#include "baker/methods.h"

namespace kiln::solver {

void QuadScene::add_room(math::Vec3 low, math::Vec3 high, math::Rgb albedo, math::Rgb emission) {
  const math::Vec3 d = high - low;
  const math::Vec3 x{d.x, 0, 0}, y{0, d.y, 0}, z{0, 0, d.z};
  add({low, y, z, albedo, emission});
  add({low + x, z, y, albedo, emission});
  add({low, z, x, albedo, emission});
  add({low + y, x, z, albedo, emission});
  add({low, x, y, albedo, emission});
  add({low + z, y, x, albedo, emission});
}

void QuadScene::add_block(math::Vec3 low, math::Vec3 high, math::Rgb albedo, bool with_bottom) {
  const math::Vec3 d = high - low;
  const math::Vec3 x{d.x, 0, 0}, y{0, d.y, 0}, z{0, 0, d.z};
  add({low, z, y, albedo});
  add({low + x, y, z, albedo});
  if (with_bottom) add({low, x, z, albedo});
  add({low + y, z, x, albedo});
  add({low, y, x, albedo});
  add({low + z, x, y, albedo});
}

void QuadScene::build() {
  const auto count = static_cast<std::uint32_t>(quads_.size());
  std::uint32_t grid = 1;
  while (grid * grid < count) ++grid;
  const float cell = std::floor(float(page_size_) / float(grid));
  const float margin = 2 - overhang_;
  scene_.instances.push_back({});
  scene_.instances[0].part_count = count;
  for (std::uint32_t q = 0; q < count; ++q) {
    const Quad& quad = quads_[q];
    scene::Part part;
    part.primitive = q;
    part.material = q;
    part.first_vertex = 4 * q;
    part.vertex_count = 4;
    part.first_triangle = 2 * q;
    part.triangle_count = 2;
    part.has_lightmap_uv = true;
    scene_.parts.push_back(part);
    scene::Material m;
    m.base_color = quad.albedo;
    m.emission = quad.emission;
    m.double_sided = quad.double_sided;
    scene_.materials.push_back(m);
    const float x0 = float(q % grid) * cell + margin, y0 = float(q / grid) * cell + margin;
    for (std::uint32_t k = 0; k < 4; ++k) {
      const bool u = k == 1 || k == 2, v = k >= 2;
      scene_.positions.push_back(quad.corner + quad.edge_u * float(u) + quad.edge_v * float(v));
      scene_.normals.push_back(normalize(cross(quad.edge_u, quad.edge_v)));
      scene_.base_uv.push_back({});
      scene_.emission_uv.push_back({});
      scene_.source_vertex.push_back(k);
      scene_.colors.push_back({1, 1, 1, 1});
      const float size = cell - 2 * margin;
      scene_.lightmap_uv.push_back(
          {(x0 + size * float(u)) / float(page_size_), (y0 + size * float(v)) / float(page_size_)});
    }
    const std::uint32_t a = 4 * q;
    scene_.triangles.push_back({a, a + 1, a + 2});
    scene_.triangles.push_back({a, a + 2, a + 3});
    scene_.triangle_part.insert(scene_.triangle_part.end(), 2, q);
  }
  proto::AtlasSettings settings;
  settings.page_size = page_size_;
  settings.unwrap = proto::Unwrap::kExisting;
  auto atlas = atlas::build_atlas(scene_, settings);
  if (!atlas) throw std::logic_error(atlas.error().message);
  atlas_ = std::make_unique<atlas::Atlas>(std::move(*atlas));
  auto texels = rasterize(scene_, *atlas_);
  if (!texels) throw std::logic_error(texels.error().message);
  texels_ = std::make_unique<atlas::TextureGroup>(std::move(*texels));
}

std::vector<std::uint32_t> QuadScene::texels_of(std::uint32_t quad) const {
  std::vector<std::uint32_t> found;
  for (std::uint32_t t = 0; t < texels_->front_count; ++t)
    if (texels_->triangle[t] / 2 == quad) found.push_back(t);
  return found;
}

Solution QuadScene::solve(const proto::SolverSettings& settings, unsigned threads,
                          const proto::QualitySettings& quality, bool filter) const {
  const auto rays = trace::RayScene::build(scene_);
  const light::LightSet lights(scene_, nullptr, settings.emitters == proto::Emitters::kExplicit);
  const trace::TexelLookup lookup(scene_, *atlas_, *texels_);
  const World world{scene_, *atlas_, *texels_, *rays,
                    lights, lookup,  settings, baker::sample_plan(settings, quality),
                    filter};
  const auto solver = baker::make_solver(world);
  exec::ThreadPool pool(threads);
  auto solution = baker::solve(world, *solver, pool, {});
  if (!solution) throw std::logic_error(solution.error().message);
  return std::move(*solution);
}

std::vector<Solution> bakes_of_seeds(const QuadScene& scene, proto::SolverSettings settings,
                                     int seeds) {
  std::vector<Solution> bakes;
  for (int s = 0; s < seeds; ++s) {
    settings.seed = 1000 + std::uint64_t(s);
    bakes.push_back(scene.solve(settings));
  }
  return bakes;
}

SeedStudy::SeedStudy(const QuadScene& scene, const proto::SolverSettings& settings, int seeds,
                     const std::vector<std::uint32_t>& texels)
    : SeedStudy(scene, bakes_of_seeds(scene, settings, seeds), texels) {}

SeedStudy::SeedStudy(const QuadScene& scene, const std::vector<Solution>& bakes,
                     const std::vector<std::uint32_t>& texels)
    : mean(texels.size()), standard_error(texels.size()) {
  const auto seeds = double(bakes.size());
  std::vector<double> square(texels.size()), totals;
  double area = 0;
  for (const std::uint32_t t : texels) area += scene.texels().area_m2[t];
  for (const Solution& solution : bakes) {
    double total = 0;
    for (std::size_t i = 0; i < texels.size(); ++i) {
      const double e = solution.light->irradiance(texels[i]).g;
      mean[i] += e / seeds;
      square[i] += e * e / seeds;
      total += e * scene.texels().area_m2[texels[i]] / area;
    }
    totals.push_back(total);
  }
  const auto error_of_mean = [&](double m, double m2) {
    return std::sqrt(std::max(0.0, m2 - m * m) / (seeds - 1));
  };
  double total_square = 0;
  for (const double t : totals) {
    area_mean += t / seeds;
    total_square += t * t / seeds;
  }
  area_standard_error = error_of_mean(area_mean, total_square);
  for (std::size_t i = 0; i < texels.size(); ++i)
    standard_error[i] = error_of_mean(mean[i], square[i]);
}

bool same_bits(const lightmap::Plane<math::Rgb>& a, const lightmap::Plane<math::Rgb>& b) {
  return a.size() == b.size() &&
         std::memcmp(a.values().data(), b.values().data(), a.size() * sizeof(math::Rgb)) == 0;
}

}  // namespace kiln::solver
