#pragma once

#include "tests/support/ready_scene.h"

namespace kiln::bench {

using test::must;
using test::ReadyScene;
using test::SceneFile;

/// Cornell box with a ball of 97,572 triangles on a page of 1024: the scene and the density that
/// tracing rates are quoted for. Made once, kept to the end.
const ReadyScene& ball_at_1024();

}  // namespace kiln::bench
