// A scene file: whatever is accepted can be used, and is written back as it was read.
#include <cmath>
#include <cstdint>

#include "tests/fuzz/scene_bytes.h"

using namespace kiln;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view bytes(reinterpret_cast<const char*>(data), size);
  const auto scene = scene::read_scene_file(bytes, fuzz::scene_key());
  if (!scene) {
    FUZZ_REQUIRE(scene.error().code == "bad_document");
    return 0;
  }
  FUZZ_REQUIRE(fuzz::scene_bytes(*scene) == bytes);
  for (const scene::Camera& camera : scene->cameras)
    FUZZ_REQUIRE(camera.half_height > 0 && math::is_finite(camera.position));
  for (std::uint32_t t = 0; t < scene->triangles.size(); ++t) {
    const math::Rgb albedo = scene::albedo_at(*scene, t, scene::kCentroid);
    FUZZ_REQUIRE(albedo.r >= 0 && albedo.g >= 0 && albedo.b >= 0);
    FUZZ_REQUIRE(math::max_channel(albedo) <= 1);
    FUZZ_REQUIRE(std::isfinite(math::max_channel(scene::emission_at(*scene, t, {0.2f, 0.7f}))));
    FUZZ_REQUIRE(math::is_finite(scene::shading_normal(*scene, t, {0.5f, 0.5f})));
    FUZZ_REQUIRE(scene::triangle_area(*scene, t) > 0);
    FUZZ_REQUIRE(scene->parts[scene->triangle_part[t]].instance < scene->instances.size());
  }
  return 0;
}
