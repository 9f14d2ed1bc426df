// Every kind of bad input has a stable code and names its place; none of it may crash.
#include <gtest/gtest.h>

#include <chrono>
#include <functional>
#include <limits>
#include <random>
#include <thread>

#include "scene/import_helpers.h"
#include "support/png_builder.h"

namespace kiln::baker {
namespace {

using nlohmann::json;
using Edit = std::function<void(GltfBuilder&)>;

/// Both entry points must refuse the bytes, with the same error.
void expect_refused(const std::string& bytes, const std::string& code, const std::string& pointer,
                    const ImportLimits& limits = {}) {
  const Upload upload(bytes);
  const auto checked = check_scene(upload.files, dark(), limits);
  const auto scene = import_scene(upload.files, dark(), limits);
  ASSERT_FALSE(checked);
  ASSERT_FALSE(scene);
  EXPECT_EQ(checked.error().code, code) << checked.error().message;
  EXPECT_EQ(scene.error().code, code);
  EXPECT_EQ(scene.error().message, checked.error().message);
  ASSERT_EQ(checked.error().details.size(), 1u);
  EXPECT_EQ(checked.error().details[0].source, "scene");
  EXPECT_EQ(checked.error().details[0].pointer, pointer) << checked.error().message;
}

/// A quad with normals, indices, a texture and two nodes: something to break anywhere.
GltfBuilder specimen() {
  GltfBuilder b;
  const int positions = b.accessor(std::vector<float>{0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0}, 3);
  const int normals = b.accessor(std::vector<float>{0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, 3);
  const int uv = b.accessor(std::vector<float>{0, 0, 1, 0, 1, 1, 0, 1}, 2);
  const int indices = b.accessor(std::vector<std::uint16_t>{0, 1, 2, 0, 2, 3}, 1);
  b.add("textures", {{"source", b.image(test::PngBuilder::encode(1, 1, 8, 2, "abc"), "image/png")},
                     {"sampler", b.add("samplers", {{"wrapS", 33071}})}});
  b.material({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
  const int mesh =
      b.mesh({{"attributes", {{"POSITION", positions}, {"NORMAL", normals}, {"TEXCOORD_0", uv}}},
              {"indices", indices},
              {"material", 0}});
  b.node({{"mesh", mesh}});
  b.node({{"children", {0}}, {"scale", {1, 2, 1}}});
  return b;
}

void expect_refused(const Edit& edit, const std::string& code, const std::string& pointer,
                    const ImportLimits& limits = {}) {
  GltfBuilder b = specimen();
  edit(b);
  expect_refused(b.glb(), code, pointer, limits);
}

json& primitive(GltfBuilder& b) {
  return b.json["meshes"][0]["primitives"][0];
}

template <class T>
void overwrite(GltfBuilder& b, std::size_t at, T value) {
  std::memcpy(&b.binary.at(at), &value, sizeof value);
}

TEST(BadInput, SpecimenItselfIsFine) {
  EXPECT_EQ(imported(specimen()).triangles.size(), 2u);
}

TEST(BadInput, Container) {
  const std::string glb = specimen().glb();
  for (const char* nothing : {"", " ", "glT", "PK\3\4", "[1]", "<gltf/>"}) {
    expect_refused(nothing, "invalid_scene", "");
  }
  std::string other_version = glb;
  other_version[4] = 1;
  expect_refused(other_version, "invalid_scene", "");
  expect_refused(glb + "more", "invalid_scene", "");
  expect_refused(GltfBuilder::glb("", "data"), "invalid_scene", "");
}

TEST(BadInput, Json) {
  expect_refused("{\"asset\": {\"version\": \"2.0\"},}", "invalid_scene", "");
  expect_refused("{\"asset\": \"\xff\"}", "invalid_scene", "");
  expect_refused("{\"asset\": 1e999}", "invalid_scene", "");
  const Upload upload("{\n \"asset\":\n  oops}");
  const auto checked = check_scene(upload.files, dark());
  EXPECT_NE(checked.error().message.find("line 3, column 3"), std::string::npos)
      << checked.error().message;
  std::string deep = "{\"asset\":" + std::string(200, '[') + std::string(200, ']') + "}";
  expect_refused(deep, "limit_exceeded", "");
}

TEST(BadInput, Asset) {
  expect_refused([](auto& b) { b.json.erase("asset"); }, "invalid_scene", "");
  expect_refused([](auto& b) { b.json["asset"].erase("version"); }, "invalid_scene", "/asset");
  expect_refused([](auto& b) { b.json["asset"]["version"] = "1.0"; }, "invalid_scene",
                 "/asset/version");
  expect_refused([](auto& b) { b.json["asset"]["version"] = 2; }, "invalid_scene",
                 "/asset/version");
  expect_refused([](auto& b) { b.json["asset"]["minVersion"] = "2.1"; }, "invalid_scene",
                 "/asset/minVersion");
}

TEST(BadInput, RequiredExtension) {
  const auto require = [](GltfBuilder& b) {
    b.json["extensionsRequired"] = {"KHR_texture_transform", "VENDOR_magic"};
  };
  expect_refused(require, "unsupported_extension", "/extensionsRequired/1");
}

TEST(BadInput, CompressedDataOnly) {
  GltfBuilder b = triangle_builder();
  b.json["accessors"][0].erase("bufferView");
  primitive(b)["extensions"]["KHR_draco_mesh_compression"] = {{"bufferView", 0}};
  expect_refused(b.glb(), "unsupported_extension",
                 "/meshes/0/primitives/0/extensions/KHR_draco_mesh_compression");
}

TEST(BadInput, WrongTypesAndMissingProperties) {
  const auto refuse = [](const Edit& edit, const std::string& pointer) {
    expect_refused(edit, "invalid_scene", pointer);
  };
  refuse([](auto& b) { b.json["nodes"] = json::object(); }, "/nodes");
  refuse([](auto& b) { b.json["nodes"][0] = 7; }, "/nodes/0");
  refuse([](auto& b) { b.json["nodes"][0]["mesh"] = "0"; }, "/nodes/0/mesh");
  refuse([](auto& b) { b.json["nodes"][0]["mesh"] = 0.5; }, "/nodes/0/mesh");
  refuse([](auto& b) { b.json["nodes"][0]["mesh"] = -1; }, "/nodes/0/mesh");
  refuse([](auto& b) { b.json["nodes"][1]["scale"] = {1, 2}; }, "/nodes/1/scale");
  refuse([](auto& b) { b.json["nodes"][1]["scale"] = {1, "2", 3}; }, "/nodes/1/scale/1");
  refuse([](auto& b) { b.json["nodes"][1]["scale"] = {1, 1e39, 3}; }, "/nodes/1/scale/1");
  refuse([](auto& b) { b.json["nodes"][0]["name"] = 42; }, "/nodes/0/name");
  refuse([](auto& b) { primitive(b).erase("attributes"); }, "/meshes/0/primitives/0");
  refuse([](auto& b) { primitive(b)["mode"] = 7; }, "/meshes/0/primitives/0/mode");
  refuse([](auto& b) { b.json["accessors"][1].erase("count"); }, "/accessors/1");
  refuse([](auto& b) { b.json["accessors"][1]["count"] = 0; }, "/accessors/1/count");
  refuse([](auto& b) { b.json["accessors"][1]["count"] = 1e300; }, "/accessors/1/count");
  refuse([](auto& b) { b.json["accessors"][1]["normalized"] = 1; }, "/accessors/1/normalized");
  refuse([](auto& b) { b.json["accessors"][1]["componentType"] = 5124; },
         "/accessors/1/componentType");
  refuse([](auto& b) { b.json["accessors"][1]["min"] = {0}; }, "/accessors/1");
  refuse([](auto& b) { b.json["accessors"][1]["type"] = "VEC5"; }, "/accessors/1/type");
  refuse(
      [](auto& b) {
        b.json["materials"][0]["emissiveFactor"] = {1, 1, -1};
      },
      "/materials/0/emissiveFactor/2");
}

TEST(BadInput, IndicesWithoutATarget) {
  const auto refuse = [](const Edit& edit, const std::string& pointer) {
    expect_refused(edit, "invalid_scene", pointer);
  };
  refuse([](auto& b) { b.json["scene"] = 1; }, "/scene");
  refuse([](auto& b) { b.json["scenes"] = {{{"nodes", {2}}}}; }, "/scenes/0/nodes/0");
  refuse([](auto& b) { b.json["nodes"][1]["children"] = {0, 9}; }, "/nodes/1/children/1");
  refuse([](auto& b) { b.json["nodes"][0]["mesh"] = 1; }, "/nodes/0/mesh");
  refuse([](auto& b) { b.json["nodes"][0]["skin"] = 0; }, "/nodes/0/skin");
  refuse([](auto& b) { primitive(b)["material"] = 1; }, "/meshes/0/primitives/0/material");
  refuse([](auto& b) { primitive(b)["indices"] = 4; }, "/meshes/0/primitives/0/indices");
  refuse([](auto& b) { primitive(b)["attributes"]["A/B~"] = 99; },
         "/meshes/0/primitives/0/attributes/A~1B~0");
  refuse([](auto& b) { b.json["accessors"][0]["bufferView"] = 99; }, "/accessors/0/bufferView");
  refuse([](auto& b) { b.json["bufferViews"][0]["buffer"] = 1; }, "/bufferViews/0/buffer");
  refuse([](auto& b) { b.json["textures"][0]["source"] = 1; }, "/textures/0/source");
  refuse([](auto& b) { b.json["textures"][0]["sampler"] = 1; }, "/textures/0/sampler");
  refuse(
      [](auto& b) {
        b.json["materials"][0]["pbrMetallicRoughness"]["baseColorTexture"]["index"] = 1;
      },
      "/materials/0/pbrMetallicRoughness/baseColorTexture/index");
}

TEST(BadInput, BuffersAndViews) {
  const auto refuse = [](const Edit& edit, const std::string& pointer) {
    expect_refused(edit, "invalid_scene", pointer);
  };
  refuse(
      [](auto& b) {
        b.json["buffers"] = {{{"byteLength", b.binary.size() + 4}}};
      },
      "/buffers/0/byteLength");
  refuse([](auto& b) { b.json["bufferViews"][0]["byteLength"] = 1000000; }, "/bufferViews/0");
  refuse([](auto& b) { b.json["bufferViews"][0]["byteOffset"] = 9007199254740991; },
         "/bufferViews/0");
  refuse([](auto& b) { b.json["bufferViews"][0]["byteStride"] = 256; },
         "/bufferViews/0/byteStride");
  refuse([](auto& b) { b.json["bufferViews"][0]["byteStride"] = 8; }, "/accessors/0");
  refuse([](auto& b) { b.json["bufferViews"][0]["byteStride"] = 16; }, "/accessors/0");
  refuse([](auto& b) { b.json["accessors"][0]["count"] = 5; }, "/accessors/0");
  refuse([](auto& b) { b.json["accessors"][0]["count"] = 9007199254740991; }, "/accessors/0");
  refuse([](auto& b) { b.json["accessors"][0]["byteOffset"] = 4; }, "/accessors/0");
  refuse([](auto& b) { b.json["accessors"][3]["byteOffset"] = 1; }, "/accessors/3/byteOffset");
  // A .glb whose second buffer has no URI: there is nothing to read.
  refuse(
      [](auto& b) {
        b.json["buffers"] = {{{"byteLength", b.binary.size()}}, {{"byteLength", 48}}};
        b.json["bufferViews"][0] = {{"buffer", 1}, {"byteLength", 48}};
      },
      "/accessors/0");
}

TEST(BadInput, BufferUris) {
  const auto refuse = [](const std::string& uri, const std::string& code) {
    SCOPED_TRACE(uri);
    expect_refused(
        [&](auto& b) {
          b.json["buffers"] = {{{"byteLength", 4}, {"uri", uri}}};
        },
        code, "/buffers/0/uri");
  };
  for (const char* uri : {"/etc/passwd",
                          "../secret.bin",
                          "a/../../secret.bin",
                          "%2e%2e/secret.bin",
                          "..%2fsecret.bin",
                          "file:///etc/passwd",
                          "http://example.org/a.bin",
                          "HTTPS://example.org/a.bin",
                          "C:\\a.bin",
                          "C:/a.bin",
                          "\\\\host\\share",
                          "a\\..\\b",
                          "a%00b",
                          "%",
                          "%zz",
                          "",
                          "data:",
                          "data:;base64",
                          "data:;base64,A",
                          "data:;base64,AAAA*AAA",
                          "data:;base64,AAAA\nAAAA"}) {
    refuse(uri, "invalid_scene");
  }
  refuse("missing.bin", "missing_file");
  refuse("folder/missing.bin", "missing_file");
}

TEST(BadInput, SideFileMustBeUnambiguous) {
  GltfBuilder b = triangle_builder();
  b.json["buffers"] = {{{"byteLength", 36}, {"uri", "x/a.bin"}}};
  const auto check = [&](const std::map<std::string, std::string>& side) {
    const Upload upload(b.document(false).dump(), side);
    const auto checked = check_scene(upload.files, dark());
    return checked ? std::string() : checked.error().code;
  };
  EXPECT_EQ(check({{"a.bin", b.binary}}), "");
  EXPECT_EQ(check({{"y/a.bin", b.binary}, {"z/a.bin", b.binary}}), "missing_file");
  EXPECT_EQ(check({{"x/a.bin", b.binary}, {"z/a.bin", b.binary}}), "");
  EXPECT_EQ(check({{"b.bin", b.binary}}), "missing_file");
  EXPECT_EQ(check({{"a.bin", b.binary.substr(1)}}), "invalid_scene");  // too short
}

TEST(BadInput, AccessorContents) {
  const auto refuse = [](const Edit& edit, const std::string& pointer) {
    expect_refused(edit, "invalid_scene", pointer);
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  refuse([&](auto& b) { overwrite(b, 40, nan); }, "/accessors/0");
  refuse([&](auto& b) { overwrite(b, 40, -inf); }, "/accessors/0");
  refuse([&](auto& b) { overwrite(b, 48, nan); }, "/accessors/1");
  refuse([&](auto& b) { overwrite(b, 96, inf); }, "/accessors/2");
  refuse([&](auto& b) { overwrite(b, 40, 1e38f); }, "/meshes/0/primitives/0/attributes/POSITION");
  refuse([](auto& b) { overwrite<std::uint16_t>(b, 128, 4); }, "/meshes/0/primitives/0/indices");
  refuse([](auto& b) { overwrite<std::uint16_t>(b, 128, 0xffff); },
         "/meshes/0/primitives/0/indices");
  refuse([](auto& b) { primitive(b)["attributes"]["POSITION"] = 2; }, "/accessors/2/type");
  refuse([](auto& b) { primitive(b)["indices"] = 0; }, "/accessors/0/type");
  refuse([](auto& b) { b.json["accessors"][3]["normalized"] = true; },
         "/accessors/3/componentType");
  refuse([](auto& b) { b.json["accessors"][2]["count"] = 3; },
         "/meshes/0/primitives/0/attributes/TEXCOORD_0");
  refuse([](auto& b) { b.json["accessors"][3].erase("bufferView"); }, "/accessors/3");
}

TEST(BadInput, BoundsThatLieAreAWarning) {
  GltfBuilder b = specimen();
  b.json["accessors"][0]["max"] = {1, 0.5, 0};
  b.json["accessors"][0]["min"] = {0, 0, 0};
  EXPECT_EQ(warning_codes(imported(b)), std::vector<std::string>{"accessor_bounds_wrong"});
}

TEST(BadInput, SparseAccessors) {
  const auto with_sparse = [](std::vector<std::uint8_t> indices, int count, json extra) {
    return [=](GltfBuilder& b) {
      const int i = b.view(indices.data(), indices.size());
      const std::vector<float> values(3 * indices.size(), 0.5f);
      const int v = b.view(values.data(), values.size() * sizeof(float));
      b.json["accessors"][0]["sparse"] = {{"count", count},
                                          {"indices", {{"bufferView", i}, {"componentType", 5121}}},
                                          {"values", {{"bufferView", v}}}};
      b.json["accessors"][0]["sparse"].merge_patch(extra);
    };
  };
  const auto refuse = [](const Edit& edit, const std::string& pointer) {
    expect_refused(edit, "invalid_scene", pointer);
  };
  refuse(with_sparse({1, 1}, 2, json::object()), "/accessors/0/sparse/indices");
  refuse(with_sparse({2, 1}, 2, json::object()), "/accessors/0/sparse/indices");
  refuse(with_sparse({1, 4}, 2, json::object()), "/accessors/0/sparse/indices");
  refuse(with_sparse({1, 2}, 3, json::object()), "/accessors/0/sparse/indices");
  refuse(with_sparse({1, 2}, 5, json::object()), "/accessors/0/sparse/count");
  refuse(with_sparse({1, 2}, 0, json::object()), "/accessors/0/sparse/count");
  refuse(with_sparse({1, 2}, 2, {{"values", {{"byteOffset", 4}}}}), "/accessors/0/sparse/values");
  refuse(with_sparse({1, 2}, 2, {{"indices", {{"componentType", 5122}}}}),
         "/accessors/0/sparse/indices/componentType");
  refuse(with_sparse({1, 2}, 2, {{"indices", nullptr}}), "/accessors/0/sparse");
}

TEST(BadInput, Nodes) {
  const auto refuse = [](const Edit& edit, const std::string& pointer) {
    expect_refused(edit, "invalid_scene", pointer);
  };
  const auto scenes = [](GltfBuilder& b, json nodes) { b.json["scenes"] = {{{"nodes", nodes}}}; };
  refuse(
      [&](auto& b) {
        b.json["nodes"][0]["children"] = {1};
        scenes(b, {0});
      },
      "/nodes/0/children");
  refuse(
      [&](auto& b) {
        b.json["nodes"][0]["children"] = {0};
        b.json["nodes"][1].erase("children");
        scenes(b, {0});
      },
      "/nodes/0/children");
  refuse([&](auto& b) { b.node({{"children", {0}}}); }, "/nodes/2/children/0");
  refuse([&](auto& b) { b.json["nodes"][1]["children"] = {0, 0}; }, "/nodes/1/children/1");
  refuse([&](auto& b) { scenes(b, {1, 0}); }, "/scenes/0/nodes/1");
  refuse([&](auto& b) { scenes(b, {1, 1}); }, "/scenes/0/nodes/1");
  refuse([&](auto& b) { b.json["nodes"][0]["rotation"] = {0, 0, 0, 0}; }, "/nodes/0/rotation");
  refuse(
      [&](auto& b) {
        b.json["nodes"][0]["matrix"] = {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1};
      },
      "/nodes/0/matrix");
}

TEST(BadInput, NothingToBake) {
  expect_refused([](auto& b) { b.json["nodes"][0].erase("mesh"); }, "nothing_to_bake", "");
  expect_refused([](auto& b) { primitive(b)["mode"] = 1; }, "nothing_to_bake", "");
  expect_refused([](auto& b) { primitive(b)["attributes"].erase("POSITION"); }, "nothing_to_bake",
                 "");
  expect_refused([](auto& b) { b.json["nodes"][1]["scale"] = {0, 0, 0}; }, "nothing_to_bake", "");
  expect_refused("{\"asset\":{\"version\":\"2.0\"}}", "nothing_to_bake", "");
}

TEST(BadInput, Limits) {
  const auto refuse = [](const std::function<void(ImportLimits&)>& set,
                         const std::string& pointer) {
    ImportLimits limits;
    set(limits);
    expect_refused([](auto&) {}, "limit_exceeded", pointer, limits);
  };
  refuse([](auto& l) { l.file_bytes = 100; }, "");
  refuse([](auto& l) { l.json_bytes = 100; }, "");
  refuse([](auto& l) { l.nodes = 1; }, "/nodes");
  refuse([](auto& l) { l.node_depth = 1; }, "/nodes/0");
  refuse([](auto& l) { l.vertices = 3; }, "/meshes/0/primitives/0");
  refuse([](auto& l) { l.triangles = 1; }, "/meshes/0/primitives/0");
}

TEST(BadInput, EveryUseOfAMeshCountsAgainstTheLimits) {
  ImportLimits limits;
  limits.triangles = 5;
  GltfBuilder b = specimen();
  b.node({{"mesh", 0}});
  const Upload two(b.glb());
  EXPECT_TRUE(check_scene(two.files, dark(), limits));
  b.node({{"mesh", 0}});
  const Upload three(b.glb());
  EXPECT_EQ(check_scene(three.files, dark(), limits).error().code, "limit_exceeded");
  EXPECT_EQ(import_scene(three.files, dark(), limits).error().code, "limit_exceeded");
}

// A file of a few hundred bytes may claim any number of zeros.
TEST(BadInput, ClaimedElementsTakeNoMemoryAndNoTime) {
  GltfBuilder b;
  b.binary = "1234";
  b.add("accessors", {{"componentType", 5126}, {"count", 4'000'000'000}, {"type", "VEC3"}});
  b.node({{"mesh", b.mesh({{"attributes", {{"POSITION", 0}}}})}});
  expect_refused(b.glb(), "limit_exceeded", "/meshes/0/primitives/0");
  // With indices, only what they name is read: three zeros are no triangle.
  primitive(b)["indices"] = b.accessor(std::vector<std::uint32_t>{0, 1, 3'999'999'999}, 1);
  expect_refused(b.glb(), "nothing_to_bake", "");
}

TEST(BadInput, StopRequestCancels) {
  const Upload upload(specimen().glb());
  std::stop_source stop;
  stop.request_stop();
  EXPECT_EQ(check_scene(upload.files, dark(), {}, stop.get_token()).error().code, "canceled");
  EXPECT_EQ(import_scene(upload.files, dark(), {}, stop.get_token()).error().code, "canceled");
}

// Whatever happens to the bytes, the answer is a scene or an error
// -----------------------------------

TEST(BadInput, EveryPrefixOfAGlbIsAnError) {
  const std::string glb = specimen().glb();
  const test::TempFolder folder;
  for (std::size_t length = 0; length < glb.size(); ++length) {
    SceneFiles files;
    files.main = folder.write("scene", glb.substr(0, length));
    const auto scene = import_scene(files, dark());
    ASSERT_FALSE(scene) << length;
    EXPECT_EQ(scene.error().code, "invalid_scene") << length;
  }
}

/// A scene that came out of damaged bytes must still keep Scene's promises.
void expect_consistent(const Scene& scene) {
  ASSERT_EQ(scene.normals.size(), scene.positions.size());
  ASSERT_EQ(scene.base_uv.size(), scene.positions.size());
  ASSERT_EQ(scene.lightmap_uv.size(), scene.positions.size());
  ASSERT_EQ(scene.source_vertex.size(), scene.positions.size());
  for (std::uint32_t t = 0; t < scene.triangles.size(); ++t) {
    for (const auto v : scene.triangles[t]) ASSERT_LT(v, scene.positions.size());
    ASSERT_GT(triangle_area(scene, t), 0);
    const Rgb albedo = albedo_at(scene, t, {0.3f, 0.3f});
    ASSERT_TRUE(albedo.r >= 0 && albedo.r <= 1 && albedo.g >= 0 && albedo.b <= 1);
    ASSERT_TRUE(std::isfinite(max_channel(emission_at(scene, t, {0.3f, 0.3f}))));
  }
  for (const Vec3 n : scene.normals) ASSERT_NEAR(length(n), 1, 1e-4f);
}

void flip_and_import(const std::string& original, unsigned seed, int rounds) {
  std::mt19937 random(seed);
  const test::TempFolder folder;
  int survived = 0;
  for (int round = 0; round < rounds; ++round) {
    std::string bytes = original;
    for (unsigned flips = 1 + random() % 4; flips > 0; --flips) {
      bytes[random() % bytes.size()] ^= static_cast<char>(1u << random() % 8);
    }
    SceneFiles files;
    files.main = folder.write("scene", bytes);
    const auto checked = check_scene(files, dark());
    const auto scene = import_scene(files, dark());
    if (!checked) {
      EXPECT_FALSE(scene) << seed << " " << round;
    }
    if (scene) expect_consistent(*scene);
    survived += scene ? 1 : 0;
  }
  EXPECT_GT(survived, 0);  // else nothing behind the container was reached
  EXPECT_LT(survived, rounds);
}

TEST(BadInput, RandomBitFlipsNeverCrash) {
  GltfBuilder b = specimen();
  const std::uint8_t at = 1;
  const int indices = b.view(&at, 1);
  const std::vector<float> moved{1, 0.5f, 0};
  b.json["accessors"][0]["sparse"] = {
      {"count", 1},
      {"indices", {{"bufferView", indices}, {"componentType", 5121}}},
      {"values", {{"bufferView", b.view(moved.data(), 12)}}}};
  b.json["extensions"]["KHR_lights_punctual"]["lights"] = {
      {{"type", "spot"}, {"spot", json::object()}}};
  b.json["nodes"][1]["extensions"]["KHR_lights_punctual"]["light"] = 0;
  flip_and_import(b.glb(), 1, 1500);
  flip_and_import(b.gltf(), 2, 500);
}

// JSON values of all kinds at every place of the document.
TEST(BadInput, AnyValueAnywhereNeverCrashes) {
  const GltfBuilder b = specimen();
  const json document = b.document(true);
  const json flat = document.flatten();
  const std::vector<json> values{nullptr, -1, 3, 9007199254740991, 1e38, "x", json::array(), {0}};
  const test::TempFolder folder;
  for (const auto& [place, old] : flat.items()) {
    for (json::json_pointer at(place); !at.empty(); at.pop_back()) {
      for (const json& value : values) {
        json changed = document;
        changed[at] = value;
        SceneFiles files;
        files.main = folder.write("scene", changed.dump());
        const auto checked = check_scene(files, dark());
        const auto scene = import_scene(files, dark());
        if (!checked) {
          EXPECT_FALSE(scene) << place << " " << value;
        }
        if (scene) expect_consistent(*scene);
      }
    }
  }
}

}  // namespace
}  // namespace kiln::baker
