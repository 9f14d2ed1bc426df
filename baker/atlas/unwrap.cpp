#include "baker/atlas/unwrap.h"

#include <algorithm>
#include <numeric>

#include "baker/atlas/flatten.h"
#include "baker/exec/stop.h"

namespace kiln::atlas {
namespace {

constexpr double kConeCosine = 0.766;    ///< cos 40 deg
constexpr double kNotchCosine = 0.5;     ///< cos 60 deg
constexpr double kSteepCosine = 0.4226;  ///< cos 65 deg
constexpr std::uint32_t kGridCells = 4096;
constexpr double kLeastFill = 0.35;    ///< a chart that fills less of its rectangle is halved ...
constexpr double kWasteTexels = 1024;  ///< ... if it leaves at least this many texels empty
constexpr int kMaxHalvings = 6;
constexpr std::uint32_t kNone = Surface::kNone;

}  // namespace

Unwrapped Unwrapper::unwrap(const scene::Scene& scene, const scene::Instance& instance,
                            std::stop_token stop) {
  stop_ = std::move(stop);
  if (!load(scene, instance)) return {};
  std::vector<std::uint32_t> seeds(surface_.triangles.size());
  std::iota(seeds.begin(), seeds.end(), 0u);
  const auto larger = [&](std::uint32_t a, std::uint32_t b) { return area_[a] > area_[b]; };
  if (!exec::sort_unless_stopped(seeds, larger, stop_)) return {};
  for (const std::uint32_t seed : seeds) {
    if (chart_[seed] != kNone) continue;
    make_chart(seed);
    if (stopped()) return {};
  }
  return {std::move(surface_.triangles), std::move(chart_), std::move(frames_)};
}

/// Prepares the surface of one instance. Returns false when stopped.
bool Unwrapper::load(const scene::Scene& scene, const scene::Instance& instance) {
  scene_ = &scene;
  surface_ = weld(scene, instance, WeldBy::kPosition, stop_);
  if (stopped()) return false;
  const std::size_t n = surface_.triangles.size();
  normal_.resize(n);
  area_.resize(n);
  for (std::size_t i = 0; i < n; ++i) {
    const auto& v = scene.triangles[surface_.triangles[i]];
    const math::Vec3d twice =
        normal_of(scene.positions[v[0]], scene.positions[v[1]], scene.positions[v[2]]);
    area_[i] = length(twice) / 2;
    normal_[i] = unit(twice);
  }
  chart_.assign(n, kNone);
  mark_.assign(n, 0);
  growth_ = 0;
  frames_.clear();
  limit_ = n;
  return true;
}

void Unwrapper::make_chart(std::uint32_t seed) {
  const math::Vec3d axis = collect(seed);
  ChartFrame frame = frame_for(axis);
  for (int i = 0; i < kMaxHalvings && !stopped() && is_wasteful(frame, axis); ++i) {
    halve(seed, frame);
    limit_growth();
    frame = frame_for(axis);
  }
  for (const std::uint32_t face : members_) chart_[face] = std::uint32_t(frames_.size());
  frames_.push_back(frame);
}

/// Fills members_ with as many faces as fit around the seed, in larger and larger steps while
/// growth is limited. Returns the chart's normal.
math::Vec3d Unwrapper::collect(std::uint32_t seed) {
  for (;;) {
    grow(seed, false, limit_);
    math::Vec3d axis = mean_normal(members_, normal_, area_);
    if (!within(axis, kSteepCosine)) {  // the mean has drifted away from the first faces
      grow(seed, true, limit_);
      axis = normal_[seed];
    }
    const bool limited = members_.size() >= limit_ && limit_ < chart_.size();
    if (members_.size() > 2 && covers_itself(axis)) {
      grow_flat(seed, axis);
      limit_growth();
      return axis;
    }
    if (!limited || stopped() || is_wasteful(frame_for(axis), axis)) return axis;
    limit_ *= 4;
  }
}

/// Limits the next growth after a cut. Without a limit each sheet of a spiral would grow all that
/// was cut off anew, at a cost of the square of their number.
void Unwrapper::limit_growth() {
  limit_ = std::max<std::size_t>(8 * members_.size(), 256);
}

/// Collects members_ from the seed by best fit. Fit is measured against the seed's normal when the
/// axis is fixed, and against the mean normal so far otherwise.
void Unwrapper::grow(std::uint32_t seed, bool fixed_axis, std::size_t limit) {
  ++growth_;
  members_.clear();
  queue_.assign(1, {0, seed});
  math::Vec3d sum{};
  math::Vec3d axis = normal_[seed];
  exec::StopPoll stop(stop_);
  while (!queue_.empty() && members_.size() < limit && !stop()) {
    std::pop_heap(queue_.begin(), queue_.end());
    const std::uint32_t face = queue_.back().face;
    queue_.pop_back();
    if (mark_[face] == growth_ || !fits(face, axis)) continue;
    mark_[face] = growth_;
    members_.push_back(face);
    if (!fixed_axis) {
      sum += normal_[face] * area_[face];
      axis = unit(sum);
    }
    for (const std::uint32_t next : surface_.neighbor[face]) {
      if (next == kNone || chart_[next] != kNone || mark_[next] == growth_) continue;
      const double cosine = dot(normal_[next], axis);
      if (cosine < kNotchCosine) continue;
      queue_.push_back({1 - cosine, next});
      std::push_heap(queue_.begin(), queue_.end());
    }
  }
}

/// Returns whether a face that touches the growing chart may join it.
bool Unwrapper::fits(std::uint32_t face, const math::Vec3d& axis) const {
  const double cosine = dot(normal_[face], axis);
  if (cosine >= kConeCosine) return true;
  if (cosine < kNotchCosine) return false;
  const auto& near = surface_.neighbor[face];
  return std::count_if(near.begin(), near.end(),
                       [&](std::uint32_t n) { return n != kNone && mark_[n] == growth_; }) >= 2;
}

bool Unwrapper::within(const math::Vec3d& axis, double least_cosine) const {
  return std::all_of(members_.begin(), members_.end(),
                     [&](std::uint32_t face) { return dot(normal_[face], axis) >= least_cosine; });
}

/// Sets the grid so that an average face spans some four cells, and a texel two.
void Unwrapper::open_grid(const math::Vec3d& axis) {
  grid_frame_ = frame_for(axis);
  double area = 0;
  for (const std::uint32_t face : members_) area += area_[face] * dot(normal_[face], axis);
  const double longest = std::max(grid_frame_.width, grid_frame_.height);
  const double cell = std::min(std::sqrt(area / double(members_.size())) / 4, texel_m_ / 2);
  const double cells =
      std::clamp(std::ceil(longest / std::max(cell, longest * 1e-6)), 16.0, double(kGridCells));
  cells_per_meter_ = longest > 0 ? cells / longest : 0;
  grid_.begin(std::uint32_t(cells));
}

OverlapGrid::Triangle Unwrapper::on_grid(std::uint32_t face) const {
  OverlapGrid::Triangle t;
  const auto& v = scene_->triangles[surface_.triangles[face]];
  for (std::size_t i = 0; i < 3; ++i) {
    const Point p = grid_frame_.project(scene_->positions[v[i]]);
    t[i] = {p.x * cells_per_meter_, p.y * cells_per_meter_};
  }
  return t;
}

bool Unwrapper::covers_itself(const math::Vec3d& axis) {
  open_grid(axis);
  exec::StopPoll stop(stop_);
  return std::any_of(members_.begin(), members_.end(), [&](std::uint32_t face) {
    if (stop()) return true;
    const auto triangle = on_grid(face);
    const auto found = grid_.probe(triangle);
    if (found.shallow > 0 || found.deep_with != OverlapGrid::kNone) return true;
    grid_.add(triangle);
    return false;
  });
}

/// Grows once more within members_, breadth first from the seed, and leaves out faces that would
/// cover faces already taken.
void Unwrapper::grow_flat(std::uint32_t seed, const math::Vec3d& axis) {
  open_grid(axis);
  const std::uint32_t allowed = growth_;
  const std::uint32_t taken = ++growth_;
  std::vector<std::uint32_t> kept{seed};
  mark_[seed] = taken;
  grid_.add(on_grid(seed));
  exec::StopPoll stop(stop_);
  for (std::size_t i = 0; i < kept.size() && !stop(); ++i) {
    for (const std::uint32_t next : surface_.neighbor[kept[i]]) {
      if (next == kNone || mark_[next] != allowed || chart_[next] != kNone) continue;
      const auto triangle = on_grid(next);
      const auto found = grid_.probe(triangle);
      if (found.shallow > 0 || found.deep_with != OverlapGrid::kNone) continue;
      mark_[next] = taken;
      grid_.add(triangle);
      kept.push_back(next);
    }
  }
  members_ = std::move(kept);
}

bool Unwrapper::is_wasteful(const ChartFrame& frame, const math::Vec3d& axis) const {
  double area = 0;
  for (const std::uint32_t face : members_) area += area_[face] * dot(normal_[face], axis);
  const double box = frame.width * frame.height;
  return area < kLeastFill * box && box - area > kWasteTexels * texel_m_ * texel_m_;
}

double Unwrapper::middle(std::uint32_t face, const ChartFrame& frame) const {
  double sum = 0;
  for (const std::uint32_t v : scene_->triangles[surface_.triangles[face]]) {
    sum += frame.project(scene_->positions[v]).x;
  }
  return sum / 3;
}

/// Keeps the faces that connect to the seed on its side of the rectangle's middle.
void Unwrapper::halve(std::uint32_t seed, const ChartFrame& frame) {
  const std::uint32_t allowed = growth_;
  const std::uint32_t taken = ++growth_;
  const bool side = middle(seed, frame) < frame.width / 2;
  std::vector<std::uint32_t> kept{seed};
  mark_[seed] = taken;
  exec::StopPoll stop(stop_);
  for (std::size_t i = 0; i < kept.size() && !stop(); ++i) {
    for (const std::uint32_t next : surface_.neighbor[kept[i]]) {
      if (next == kNone || mark_[next] != allowed || chart_[next] != kNone) continue;
      if ((middle(next, frame) < frame.width / 2) != side) continue;
      mark_[next] = taken;
      kept.push_back(next);
    }
  }
  members_ = std::move(kept);
}

ChartFrame Unwrapper::frame_for(const math::Vec3d& axis) const {
  std::vector<math::Vec3> corners;
  corners.reserve(members_.size() * 3);
  for (const std::uint32_t face : members_) {
    for (const std::uint32_t v : scene_->triangles[surface_.triangles[face]]) {
      corners.push_back(scene_->positions[v]);
    }
  }
  return smallest_frame(corners, axis, stop_);
}

}  // namespace kiln::atlas
