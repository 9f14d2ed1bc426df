// A .glb or .gltf: check and import agree, and what they accept survives the scene file.
#include <array>
#include <cstdint>

#include "baker/import/import.h"
#include "tests/fuzz/scene_bytes.h"

using namespace kiln;

namespace {

/// Small, so that a run spends its time on many inputs instead of large ones.
files::ImportLimits small_limits() {
  files::ImportLimits limits;
  limits.file_bytes = 1 << 20;
  limits.json_depth = 64;
  limits.nodes = 2000;
  limits.vertices = 30'000;
  limits.triangles = 10'000;
  limits.image_pixels = 1 << 16;
  limits.all_image_pixels = 1 << 17;
  limits.lights = 100;
  return limits;
}

/// The input as an upload: the main file, and a side file of the same bytes.
files::SceneFiles upload(std::string_view bytes) {
  files::SceneFiles files;
  auto opened = std::make_shared<files::OpenedFiles>();
  opened->emplace("main", files::MappedFile::view(bytes));
  opened->emplace("side", files::MappedFile::view(bytes));
  files.main = "main";
  files.side["a.bin"] = "side";
  files.opened = std::move(opened);
  return files;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto files = ::upload({reinterpret_cast<const char*>(data), size});
  const auto limits = ::small_limits();
  proto::BakeSettings settings;
  settings.allow_dark = true;
  const auto checked = import::check_scene(files, settings, limits);
  const auto scene = import::import_files(files, limits);
  FUZZ_REQUIRE(checked || !checked.error().code.empty());
  if (!scene) {
    FUZZ_REQUIRE(!scene.error().message.empty());
    return 0;
  }
  // An import of nothing is refused by the check, and by whoever bakes it.
  if (scene->parts.empty()) return 0;
  FUZZ_REQUIRE(checked);
  const std::string bytes = fuzz::scene_bytes(*scene);
  const auto back = scene::read_scene_file(bytes, fuzz::scene_key());
  FUZZ_REQUIRE(back);
  FUZZ_REQUIRE(fuzz::scene_bytes(*back) == bytes);
  return 0;
}
