// The flat file of an import: what is written comes back, and no bytes are believed.
#include "baker/scene/scene_file.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <functional>

#include "baker/files/utf8.h"
#include "baker/generate/generate.h"
#include "tests/import/import_helpers.h"
#include "tests/support/temp_files.h"

namespace kiln::scene {
namespace {

using test::TempFolder;

const std::string kKey = import::import_key("a scene", {});

std::string bytes_of(const Scene& scene, const std::string& key = kKey) {
  const int fd = ::memfd_create("scene", MFD_CLOEXEC);
  EXPECT_TRUE(write_scene_file(fd, key, scene));
  std::string bytes(static_cast<std::size_t>(::lseek(fd, 0, SEEK_END)), '\0');
  EXPECT_EQ(::pread(fd, bytes.data(), bytes.size(), 0), ssize_t(bytes.size()));
  ::close(fd);
  return bytes;
}

Scene generated(const std::string& name) {
  const TempFolder folder;
  return import::import_files({folder.write("a.glb", generate::generate_glb(name).value()), {}})
      .value();
}

/// A small scene with something in every array.
Scene rich_scene() {
  Scene scene = generated("room_textured");
  PunctualLight spot;
  spot.type = PunctualType::kSpot;
  spot.intensity = {1, 2, 3};
  spot.cos_inner = 0.9f;
  scene.lights.push_back(spot);
  scene.cameras.push_back({"grün", {1, 2, 3}, {0, 0, 1}, {0, 1, 0}, true, 2.5f});
  scene.sky_map = {4, 2, std::vector<math::Rgb>(8, {1, 2, 3})};
  scene.warnings.push_back({"some_code", "/nodes/1", "grüße"});
  return scene;
}

std::string code_of(const std::string& bytes, const std::string& key = kKey) {
  // From memory of the exact length, so that AddressSanitizer sees the first byte beyond.
  const std::vector<char> exact(bytes.begin(), bytes.end());
  const auto scene = read_scene_file({exact.data(), exact.size()}, key);
  return scene ? "" : scene.error().code;
}

/// The scene with one thing changed, written and read.
std::string code_with(const std::function<void(Scene&)>& change) {
  Scene scene = rich_scene();
  change(scene);
  return code_of(bytes_of(scene));
}

TEST(SceneFile, GivesBackEveryArray) {
  for (const char* name : {"cornell", "room_textured", "courtyard", "many_lights"}) {
    Scene scene = generated(name);
    scene.warnings.push_back({"some_code", "/nodes/1", "words"});
    const std::string bytes = bytes_of(scene);
    const auto back = read_scene_file(bytes, kKey);
    ASSERT_TRUE(back) << name << back.error().message;
    EXPECT_TRUE(bytes_of(*back) == bytes) << name << ": the same scene has the same file";
    EXPECT_EQ(back->positions, scene.positions);
    EXPECT_EQ(back->triangles, scene.triangles);
    EXPECT_EQ(back->triangle_part, scene.triangle_part);
    EXPECT_EQ(back->image_texels, scene.image_texels);
    EXPECT_EQ(back->source_vertex, scene.source_vertex);
    ASSERT_EQ(back->parts.size(), scene.parts.size());
    for (std::size_t p = 0; p < scene.parts.size(); ++p) {
      EXPECT_EQ(back->parts[p].instance, scene.parts[p].instance);
      EXPECT_EQ(back->parts[p].first_vertex, scene.parts[p].first_vertex);
      EXPECT_EQ(back->parts[p].first_triangle, scene.parts[p].first_triangle);
    }
    ASSERT_EQ(back->instances.size(), scene.instances.size());
    for (std::size_t i = 0; i < scene.instances.size(); ++i) {
      EXPECT_EQ(back->instances[i].name, scene.instances[i].name);
      EXPECT_EQ(back->instances[i].first_part, scene.instances[i].first_part);
    }
    EXPECT_EQ(back->lights.size(), scene.lights.size());
    ASSERT_EQ(back->warnings.size(), scene.warnings.size());
    EXPECT_EQ(back->warnings.back().message, "words");
  }
}

TEST(SceneFile, EveryTruncationIsAnError) {
  const std::string bytes = bytes_of(generated("cornell"));
  for (std::size_t n = 0; n < bytes.size(); ++n)
    ASSERT_EQ(code_of(bytes.substr(0, n)), "bad_document") << n;
  EXPECT_EQ(code_of(bytes + '\0'), "bad_document");
}

TEST(SceneFile, GivesBackTheSkyMap) {
  const std::string bytes = bytes_of(rich_scene());
  const auto back = read_scene_file(bytes, kKey);
  ASSERT_TRUE(back);
  EXPECT_EQ(back->sky_map.width, 4u);
  EXPECT_EQ(back->sky_map.height, 2u);
  EXPECT_EQ(back->sky_map.texels, rich_scene().sky_map.texels);
  EXPECT_TRUE(bytes_of(*back) == bytes);
}

TEST(SceneFile, GivesBackTheCameras) {
  const std::string bytes = bytes_of(rich_scene());
  const auto back = read_scene_file(bytes, kKey);
  ASSERT_TRUE(back);
  ASSERT_EQ(back->cameras.size(), 1u);
  const Camera& camera = back->cameras[0];
  EXPECT_EQ(camera.name, "grün");
  EXPECT_EQ(camera.position, (math::Vec3{1, 2, 3}));
  EXPECT_EQ(camera.forward, (math::Vec3{0, 0, 1}));
  EXPECT_TRUE(camera.orthographic);
  EXPECT_EQ(camera.half_height, 2.5f);
  EXPECT_EQ(code_with([](Scene& s) { s.cameras[0].half_height = 0; }), "bad_document");
  EXPECT_EQ(code_with([](Scene& s) { s.cameras[0].half_height = NAN; }), "bad_document");
  EXPECT_EQ(code_with([](Scene& s) { s.cameras[0].forward = {}; }), "bad_document");
  EXPECT_EQ(code_with([](Scene& s) { s.cameras[0].up = {9, 9, 9}; }), "bad_document");
  EXPECT_EQ(code_with([](Scene& s) { s.cameras[0].position.y = INFINITY; }), "bad_document");
  EXPECT_EQ(code_with([](Scene& s) { s.cameras[0].name = "\xff"; }), "bad_document");
  EXPECT_EQ(code_with([](Scene& s) { s.cameras[0].name.assign(300, 'x'); }), "bad_document");
  EXPECT_EQ(code_with([](Scene& s) { s.cameras.resize(Camera::kMost + 1); }), "bad_document");
  EXPECT_EQ(code_with([](Scene& s) { s.cameras.resize(Camera::kMost); }), "");
}

TEST(SceneFile, FlippedBitsAreAnErrorOrAnotherValidScene) {
  const std::string good = bytes_of(generated("cornell"));
  std::size_t refused = 0;
  for (std::size_t at = 0; at < good.size(); ++at)
    for (const unsigned bit : {0u, 3u, 7u}) {
      std::string bytes = good;
      bytes[at] = static_cast<char>(static_cast<unsigned char>(bytes[at]) ^ (1u << bit));
      const auto scene = read_scene_file(bytes, kKey);
      refused += !scene;
      if (!scene) continue;
      // What is accepted is written back as it was read: nothing was overlooked.
      if (at % 97 == 0) {
        EXPECT_TRUE(bytes_of(*scene) == bytes) << at;
      }
    }
  EXPECT_GT(refused, 1000u);
}

TEST(SceneFile, LiesAboutSizesAndPlacesAreErrors) {
  const std::string good = bytes_of(generated("cornell"));
  const std::uint64_t values[] = {0,          1,     63,         64,        0xffffffffu,
                                  1ull << 40, ~0ull, ~0ull - 63, 1ull << 63};
  for (std::size_t at = 0; at + 8 <= 96 + 16 * 24; at += 4)  // header and table
    for (const std::uint64_t value : values) {
      std::string bytes = good;
      std::memcpy(bytes.data() + at, &value, 8);
      if (bytes != good) {
        EXPECT_EQ(code_of(bytes), "bad_document") << at << " " << value;
      }
    }
}

TEST(SceneFile, WhatNoImportMakesIsRefused) {
  EXPECT_EQ(code_with([](Scene&) {}), "");
  const std::vector<std::function<void(Scene&)>> lies{
      [](Scene& s) { s.triangles[0][1] = std::uint32_t(s.positions.size()); },
      [](Scene& s) { s.triangles[0][1] = s.triangles[0][0]; },
      [](Scene& s) { s.triangles[0][2] = 0xffffffffu; },
      [](Scene& s) { s.triangles.pop_back(); },
      [](Scene& s) { s.triangles.back()[0] = 0; },  // of another part
      [](Scene& s) { s.positions[0].x = std::nanf(""); },
      [](Scene& s) { s.positions[0].y = 2e9f; },
      [](Scene& s) { s.positions.pop_back(); },
      [](Scene& s) {
        s.normals[0] = {0, 0, 0};
      },
      [](Scene& s) {
        s.normals.push_back({0, 0, 1});
      },
      [](Scene& s) { s.lightmap_uv[0].x = std::nanf(""); },
      [](Scene& s) { s.colors[0][3] = std::numeric_limits<float>::infinity(); },
      [](Scene& s) { s.parts[0].material = std::uint32_t(s.materials.size()); },
      [](Scene& s) { s.parts[0].vertex_count += 1; },
      [](Scene& s) { s.parts[0].triangle_count = 0; },
      [](Scene& s) { s.parts.clear(); },
      [](Scene& s) { s.instances[0].part_count += 1; },
      [](Scene& s) { s.instances[0].part_count = 0; },
      [](Scene& s) { s.instances[0].name = "\xff"; },
      [](Scene& s) { s.instances.clear(); },
      [](Scene& s) { s.materials[0].base_texture.image = std::int32_t(s.images.size()); },
      [](Scene& s) { s.materials[0].base_texture.image = -2; },
      [](Scene& s) { s.materials[0].base_texture.wrap_u = Wrap(3); },
      [](Scene& s) { s.materials[0].alpha_mode = AlphaMode(3); },
      [](Scene& s) { s.materials[0].base_color.g = 1.5f; },
      [](Scene& s) { s.materials[0].emission.r = std::nanf(""); },
      [](Scene& s) { s.images[0].width += 1; },
      [](Scene& s) { s.images[0].height = 0; },
      [](Scene& s) {
        s.images[0] = {0xffffffffu, 0xffffffffu, 0};
      },
      [](Scene& s) { s.image_texels.pop_back(); },
      [](Scene& s) { s.lights[0].type = PunctualType(3); },
      [](Scene& s) {
        s.lights[0].direction = {0, 0, 0};
      },
      [](Scene& s) { s.lights[0].intensity.g = -1; },
      [](Scene& s) { s.lights[0].cos_outer = 2; },
      [](Scene& s) { s.lights[0].range = -1; },
      [](Scene& s) { s.sky_map.texels[7].b = -1; },
      [](Scene& s) { s.sky_map.texels[0].r = std::nanf(""); },
      [](Scene& s) { s.sky_map.texels[3].g = 2e12f; },
      [](Scene& s) { s.sky_map.texels.pop_back(); },
      [](Scene& s) { s.sky_map.height = 3; },
      [](Scene& s) { s.sky_map.width = 8, s.sky_map.height = 1; },
      [](Scene& s) { s.sky_map.width = 0, s.sky_map.height = 0; },
      [](Scene& s) { s.warnings[0].message = "\xc3"; },
  };
  for (std::size_t i = 0; i < lies.size(); ++i)
    EXPECT_EQ(code_with(lies[i]), "bad_document") << "lie " << i;
}

TEST(SceneFile, IsOfOneSceneAndItsLimits) {
  const std::string bytes = bytes_of(generated("cornell"));
  files::ImportLimits few;
  few.triangles = 10;
  EXPECT_EQ(code_of(bytes, import::import_key("another scene", {})), "bad_document");
  EXPECT_EQ(code_of(bytes, import::import_key("a scene", few)), "bad_document");
  EXPECT_EQ(code_of(bytes, import::import_key("a scene", {})), "");
  EXPECT_EQ(code_of(bytes, import::import_key("a scene", {}, "sky.exr")), "bad_document");
  EXPECT_NE(import::import_key("a scene", {}, "sky.exr"),
            import::import_key("a scene", {}, "night.exr"));
}

TEST(SceneFile, AStopRequestEndsTheReading) {
  std::stop_source stop;
  stop.request_stop();
  const auto scene = read_scene_file(bytes_of(generated("cornell")), kKey, stop.get_token());
  ASSERT_FALSE(scene);
  EXPECT_EQ(scene.error().code, proto::kCanceledCode);
}

TEST(Utf8, OneWayToWriteEachCharacter) {
  for (const char* good : {"", "plain", "gr\xc3\xbc\xc3\x9f", "\xe2\x82\xac", "\xf0\x9f\x98\x80",
                           "\xf4\x8f\xbf\xbf", "\xed\x9f\xbf", "\xee\x80\x80"})
    EXPECT_TRUE(kiln::files::is_utf8(good)) << good;
  for (const char* bad :
       {"\x80", "\xc3", "\xc0\x80", "\xc1\xbf", "\xe0\x80\x80", "\xe2\x82", "\xed\xa0\x80",
        "\xf0\x80\x80\x80", "\xf4\x90\x80\x80", "\xf5\x80\x80\x80", "\xff", "\xc3(", "\xe2(\xa1"})
    EXPECT_FALSE(kiln::files::is_utf8(bad)) << bad;
}

}  // namespace
}  // namespace kiln::scene
