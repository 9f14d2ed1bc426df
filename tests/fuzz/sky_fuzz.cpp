// An OpenEXR, Radiance or TIFF file as a sky map: what is accepted can light a scene.
#include <cstdint>

#include "baker/import/import.h"
#include "tests/fuzz/require.h"

using namespace kiln;

namespace {

constexpr std::uint64_t kMaxPixels = 1 << 16;

files::SceneFiles upload(std::string_view bytes) {
  static const std::string scene = R"({"asset":{"version":"2.0"},"scene":0,"scenes":[{"nodes":[0]}],
      "nodes":[{"mesh":0}],"meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
      "accessors":[{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3",
                    "min":[0,0,0],"max":[1,1,0]}],
      "bufferViews":[{"buffer":0,"byteLength":36}],
      "buffers":[{"byteLength":36,"uri":"data:;base64,AAAAAAAAAAAAAAAAAACAPwAAAAAAAAAAAAAAAAAAgD8AAAAA"}]})";
  files::SceneFiles files;
  auto opened = std::make_shared<files::OpenedFiles>();
  opened->emplace("main", files::MappedFile::view(scene));
  opened->emplace("sky", files::MappedFile::view(bytes));
  files.main = "main";
  files.side["sky"] = "sky";
  files.opened = std::move(opened);
  return files;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const auto files = ::upload({reinterpret_cast<const char*>(data), size});
  files::ImportLimits limits;
  limits.image_pixels = ::kMaxPixels;
  proto::BakeSettings settings;
  settings.allow_dark = true;
  settings.sky.map = "sky";
  const auto checked = import::check_scene(files, settings, limits);
  const auto scene = import::import_scene(files, settings, limits);
  if (!scene) {
    const std::string& code = scene.error().code;
    FUZZ_REQUIRE(code == "invalid_image" || code == "limit_exceeded");
    FUZZ_REQUIRE(scene.error().details.size() == 1);
    FUZZ_REQUIRE(scene.error().details[0].pointer == "/sky/map");
    return 0;
  }
  FUZZ_REQUIRE(checked);
  const scene::SkyMap& map = scene->sky_map;
  FUZZ_REQUIRE(map.texels.size() == std::size_t(map.width) * map.height);
  FUZZ_REQUIRE(map.texels.size() <= ::kMaxPixels);
  FUZZ_REQUIRE(map.width == 2 * map.height);
  for (const math::Rgb c : map.texels)
    FUZZ_REQUIRE(c.r >= 0 && c.g >= 0 && c.b >= 0 && math::max_channel(c) <= scene::kMaxSkyValue);
  return 0;
}
