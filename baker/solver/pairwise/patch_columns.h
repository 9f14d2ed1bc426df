#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "baker/math/vec.h"
#include "baker/simd/kernels.h"

namespace kiln::solver::pairwise {

/// A point of a patch. The receiver's cosine is that of the shading normal, and zero below the
/// surface; the sender's is that of the surface itself, whose area counts.
struct Point {
  math::Vec3 position, origin;                  ///< on the surface, and moved off it; m
  math::Vec3 geometric_normal, shading_normal;  ///< unit
};

/// A patch that is one point.
struct Patch {
  Point point;
  float area_m2 = 0;
  float visible = 1;                     ///< share of it that is not inside other geometry
  std::int32_t chart = 0, x = 0, y = 0;  ///< of its texel
};

/// Patches that are one point each, structure of arrays, so that kernels read sixteen at a time.
class PatchColumns {
 public:
  static constexpr double kBytes = sizeof(Patch);  ///< of one patch

  explicit PatchColumns(std::size_t size = 0) { resize(size); }
  /// Makes room for so many patches, all of which are to be set.
  void resize(std::size_t size) {
    stride_ = size + kPadding;
    floats_.resize(kFloats * stride_), places_.resize(kPlaces * stride_);
  }

  void set(std::size_t i, const Patch& p) {
    put(kPosition, i, p.point.position), put(kOrigin, i, p.point.origin);
    put(kGeometric, i, p.point.geometric_normal), put(kShading, i, p.point.shading_normal);
    floats_[kArea * stride_ + i] = p.area_m2, floats_[kVisible * stride_ + i] = p.visible;
    places_[i] = p.chart, places_[stride_ + i] = p.x, places_[2 * stride_ + i] = p.y;
  }
  Patch operator[](std::size_t i) const {
    return {{get(kPosition, i), origin(i), get(kGeometric, i), get(kShading, i)},
            area_m2(i),
            visible(i),
            places_[i],
            places_[stride_ + i],
            places_[2 * stride_ + i]};
  }
  math::Vec3 origin(std::size_t i) const { return get(kOrigin, i); }
  float area_m2(std::size_t i) const { return column(kArea)[i]; }
  float visible(std::size_t i) const { return column(kVisible)[i]; }
  /// Returns what kernels read. They may read up to fifteen patches beyond the last one.
  simd::PatchColumns view() const {
    return {{column(kPosition), column(kPosition + 1), column(kPosition + 2)},
            {column(kGeometric), column(kGeometric + 1), column(kGeometric + 2)},
            {column(kShading), column(kShading + 1), column(kShading + 2)},
            column(kArea),
            column(kVisible),
            places_.data(),
            places_.data() + stride_,
            places_.data() + 2 * stride_};
  }

 private:
  static constexpr std::size_t kPosition = 0, kOrigin = 3, kGeometric = 6, kShading = 9, kArea = 12,
                               kVisible = 13, kFloats = 14, kPlaces = 3, kPadding = 15;

  const float* column(std::size_t c) const { return floats_.data() + c * stride_; }
  void put(std::size_t c, std::size_t i, math::Vec3 v) {
    float* first = floats_.data() + c * stride_ + i;
    first[0] = v.x, first[stride_] = v.y, first[2 * stride_] = v.z;
  }
  math::Vec3 get(std::size_t c, std::size_t i) const {
    const float* first = column(c) + i;
    return {first[0], first[stride_], first[2 * stride_]};
  }

  std::size_t stride_ = 0;
  std::vector<float> floats_;
  std::vector<std::int32_t> places_;
};

}  // namespace kiln::solver::pairwise
