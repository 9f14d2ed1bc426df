#pragma once

#include <cstdint>
#include <string>

#include "baker/math/vec.h"
#include "baker/scene/scene.h"
#include "proto/expected.h"

namespace kiln::view {

/// A camera with the shape of its picture.
struct Lens {
  math::Vec3 position;            ///< m
  math::Vec3 forward, right, up;  ///< unit, perpendicular
  bool orthographic = false;
  float half_width = 1, half_height = 1;  ///< of the picture: m, or at a distance of 1 m

  struct Ray {
    math::Vec3 origin, direction;  ///< direction: unit
  };
  /// Returns the ray through a point of the picture: (-1, -1) is its lower left corner, (1, 1) its
  /// upper right one.
  Ray through(float x, float y) const;
};

/// Makes the camera that a text names, for a picture of `aspect` = width / height:
/// - `fit`: sees the whole scene from its upper right front;
/// - `x,y,z:tx,ty,tz` or `x,y,z:tx,ty,tz:size`: stands at the first point and looks at the second.
///   `size` is the vertical angle in degrees, or the height of an orthographic picture in m;
/// - any other text: the first camera of the scene with that name.
/// A named camera is orthographic where the scene says so; `orthographic` makes all others so.
/// Errors, with the pointer /query/camera: `bad_request`, `not_found` (the message lists names).
proto::Expected<Lens> choose_camera(const std::string& text, const scene::Scene&, float aspect,
                                    bool orthographic);

/// Checks all that choose_camera() does without a scene. Errors: `bad_request`.
proto::Expected<void> check_camera(const std::string& text);

}  // namespace kiln::view
