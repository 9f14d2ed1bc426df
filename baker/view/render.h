#pragma once

#include <span>
#include <stop_token>

#include "baker/exec/thread_pool.h"
#include "baker/image/page_image.h"
#include "baker/trace/ray_scene.h"
#include "baker/view/camera.h"
#include "baker/view/pages.h"

namespace kiln::view {

/// All that a picture is made of.
struct Stage {
  const scene::Scene& scene;
  const trace::RayScene& rays;
  const Pages& pages;
  std::span<const MeshPlace> places;  ///< one for each instance
  Lens lens;
  const Request& request;
};

/// Returns the layer's values, or the light where the request is shaded, as seen through the lens.
/// The coverage of a pixel is the share of it that shows the scene. Errors: `canceled`.
proto::Expected<image::PageImage> render(const Stage&, exec::ThreadPool&, const std::stop_token&);

}  // namespace kiln::view
