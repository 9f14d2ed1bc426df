#pragma once

#include <array>
#include <cstdint>
#include <stop_token>
#include <vector>

#include "baker/atlas/clip.h"
#include "baker/atlas/overlap_grid.h"
#include "baker/atlas/weld.h"
#include "baker/scene/scene.h"

namespace kiln::atlas {

/// A chart's plane: the projection that lays the chart flat, in meters, with its lower corner at
/// (0, 0).
struct ChartFrame {
  math::Vec3d origin, u, v;  ///< u and v are orthonormal; cross(u, v) is the chart's mean normal
  double width = 0, height = 0;

  Point project(math::Vec3 p) const {
    const math::Vec3d d = math::to_double(p) - origin;
    return {dot(d, u), dot(d, v)};
  }
};

/// One instance cut into charts.
struct Unwrapped {
  std::vector<std::uint32_t> triangles;  ///< indices into Scene::triangles, ascending
  std::vector<std::uint32_t> chart;      ///< per triangle
  std::vector<ChartFrame> frames;        ///< per chart
};

/// Cuts surfaces into charts and lays each flat. Charts grow face by face from large faces. The
/// face nearest to the chart's mean normal comes first, as long as it lies within a cone of 40
/// degrees around that normal, or of 60 degrees where it fills a notch or a hole (two neighbors in
/// the chart). A chart that would leave most of its rectangle empty, such as a ring, is halved. No
/// face is projected at more than 65 degrees, so none is flipped. A chart that would cover itself
/// (a spiral, an overhang) is cut where it does. The time is O(n log n).
class Unwrapper {
 public:
  /// `texel_m` is the least side of a texel that the charts may end up with, m. Overlaps of less
  /// than half of it go unseen.
  explicit Unwrapper(double texel_m) : texel_m_(texel_m) {}
  /// Cuts one instance into charts. The result is empty when stopped.
  Unwrapped unwrap(const scene::Scene&, const scene::Instance&, std::stop_token);

 private:
  struct Candidate {
    double deviation = 0;  ///< 1 - cosine to the chart's normal at the time of queueing
    std::uint32_t face = 0;

    /// Orders the heap: the least deviation is on top, then the lowest number.
    bool operator<(const Candidate& o) const {
      return deviation != o.deviation ? deviation > o.deviation : face > o.face;
    }
  };
  bool load(const scene::Scene&, const scene::Instance&);
  void make_chart(std::uint32_t seed);
  math::Vec3d collect(std::uint32_t seed);
  void grow(std::uint32_t seed, bool fixed_axis, std::size_t limit);
  bool within(const math::Vec3d& axis, double least_cosine) const;
  bool fits(std::uint32_t face, const math::Vec3d& axis) const;
  bool covers_itself(const math::Vec3d& axis);
  bool is_wasteful(const ChartFrame&, const math::Vec3d& axis) const;
  void halve(std::uint32_t seed, const ChartFrame&);
  double middle(std::uint32_t face, const ChartFrame&) const;
  void limit_growth();
  void grow_flat(std::uint32_t seed, const math::Vec3d& axis);
  ChartFrame frame_for(const math::Vec3d& axis) const;
  OverlapGrid::Triangle on_grid(std::uint32_t face) const;
  void open_grid(const math::Vec3d& axis);

  bool stopped() const { return stop_.stop_requested(); }

  double texel_m_ = 0;
  std::stop_token stop_;  ///< after a stop request, nothing that the steps leave is used
  const scene::Scene* scene_ = nullptr;
  Surface surface_;
  std::vector<math::Vec3d> normal_;   ///< per face, unit
  std::vector<double> area_;          ///< per face, m2
  std::vector<std::uint32_t> chart_;  ///< per face; kNone while it is in no chart
  std::vector<std::uint32_t> mark_;   ///< per face: the last growth that took it
  std::uint32_t growth_ = 0;
  std::vector<std::uint32_t> members_;  ///< faces of the growing chart, in order of growth
  std::vector<Candidate> queue_;
  std::vector<ChartFrame> frames_;
  std::size_t limit_ = 0;  ///< most faces of the next growth
  OverlapGrid grid_;
  ChartFrame grid_frame_;
  double cells_per_meter_ = 0;
};

}  // namespace kiln::atlas
