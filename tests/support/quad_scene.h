#pragma once

#include <cstdint>
#include <memory>
#include <vector>

#include "baker/atlas/atlas.h"
#include "baker/atlas/texture_group.h"
#include "baker/scene/scene.h"
#include "baker/solve.h"
#include "proto/bake_settings.h"

namespace kiln::solver {

using baker::Solution;

/// A one-sided rectangle that faces cross(edge_u, edge_v).
struct Quad {
  math::Vec3 corner, edge_u, edge_v;
  math::Rgb albedo{0, 0, 0};
  math::Rgb emission{0, 0, 0};  ///< cd/m2
  bool double_sided = false;
};

/// A scene of rectangles, each with a square chart of its own in a grid on one page.
class QuadScene {
 public:
  /// @param overhang texels by which each chart reaches beyond its outermost whole texels
  explicit QuadScene(std::uint32_t page_size, float overhang = 0)
      : page_size_(page_size), overhang_(overhang) {}

  std::uint32_t add(const Quad& q) {
    quads_.push_back(q);
    return static_cast<std::uint32_t>(quads_.size() - 1);
  }
  /// The six inner faces of an axis-parallel box, in the order -x +x -y +y -z +z.
  void add_room(math::Vec3 low, math::Vec3 high, math::Rgb albedo, math::Rgb emission = {});
  /// The same seen from outside; a block that stands on a floor has no bottom.
  void add_block(math::Vec3 low, math::Vec3 high, math::Rgb albedo, bool with_bottom = false);

  scene::Scene& scene() { return scene_; }  ///< lights and sky may be set after build()
  void build();

  /// Texels of one rectangle.
  std::vector<std::uint32_t> texels_of(std::uint32_t quad) const;
  const atlas::TextureGroup& texels() const { return *texels_; }
  const atlas::Atlas& atlas() const { return *atlas_; }
  const scene::Scene& scene() const { return scene_; }

  Solution solve(const proto::SolverSettings&, unsigned threads = 2,
                 const proto::QualitySettings& = {}, bool filter = true) const;

 private:
  std::uint32_t page_size_;
  float overhang_;
  std::vector<Quad> quads_;
  scene::Scene scene_;
  std::unique_ptr<atlas::Atlas> atlas_;
  std::unique_ptr<atlas::TextureGroup> texels_;
};

/// Irradiance of several bakes that differ in their seed alone, with what they say of their own
/// error. All figures are of one channel, green.
struct SeedStudy {
  std::vector<double> mean;            ///< per texel, over the seeds
  std::vector<double> standard_error;  ///< per texel, of that mean
  double area_mean = 0;                ///< area-weighted over texels and seeds
  double area_standard_error = 0;      ///< of area_mean, from the scatter between seeds

  SeedStudy(const QuadScene&, const proto::SolverSettings&, int seeds,
            const std::vector<std::uint32_t>& texels);
  /// The same of bakes that are made already: see bakes_of_seeds().
  SeedStudy(const QuadScene&, const std::vector<Solution>& bakes,
            const std::vector<std::uint32_t>& texels);
};
std::vector<Solution> bakes_of_seeds(const QuadScene&, proto::SolverSettings, int seeds);

bool same_bits(const lightmap::Plane<math::Rgb>&, const lightmap::Plane<math::Rgb>&);

}  // namespace kiln::solver
