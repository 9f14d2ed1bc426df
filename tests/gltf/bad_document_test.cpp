// Documents that are wrong before any byte of a buffer is read: a stable code, and the place.
#include <gtest/gtest.h>

#include "tests/import/bad_input.h"

namespace kiln::import {
namespace {

TEST(BadInput, SpecimenItselfIsFine) {
  EXPECT_EQ(import::imported(import::specimen()).triangles.size(), 2u);
}

TEST(BadInput, Container) {
  const std::string glb = import::specimen().glb();
  for (const char* nothing : {"", " ", "glT", "PK\3\4", "[1]", "<gltf/>"}) {
    import::expect_refused(nothing, "invalid_scene", "");
  }
  std::string other_version = glb;
  other_version[4] = 1;
  import::expect_refused(other_version, "invalid_scene", "");
  import::expect_refused(glb + "more", "invalid_scene", "");
  import::expect_refused(test::GltfBuilder::glb("", "data"), "invalid_scene", "");
}

TEST(BadInput, Json) {
  import::expect_refused("{\"asset\": {\"version\": \"2.0\"},}", "invalid_scene", "");
  import::expect_refused("{\"asset\": \"\xff\"}", "invalid_scene", "");
  import::expect_refused("{\"asset\": 1e999}", "invalid_scene", "");
  const import::Upload upload("{\n \"asset\":\n  oops}");
  const auto checked = import::check_scene(upload.files, import::dark());
  EXPECT_NE(checked.error().message.find("line 3, column 3"), std::string::npos)
      << checked.error().message;
  std::string deep = "{\"asset\":" + std::string(200, '[') + std::string(200, ']') + "}";
  import::expect_refused(deep, "limit_exceeded", "");
}

TEST(BadInput, Asset) {
  import::expect_refused([](auto& b) { b.json.erase("asset");
}, "invalid_scene", "");
  import::expect_refused([](auto& b) { b.json["asset"].erase("version");
  }  // namespace
, "invalid_scene", "/asset");
  import::expect_refused([](auto& b) { b.json["asset"]["version"] = "1.0";
  }  // namespace kiln::import
, "invalid_scene",
                 "/asset/version");
  import::expect_refused([](auto& b) { b.json["asset"]["version"] = 2;
  }, "invalid_scene",
                 "/asset/version");
  import::expect_refused([](auto& b) { b.json["asset"]["minVersion"] = "2.1";
  }, "invalid_scene",
                 "/asset/minVersion");
  }

  TEST(BadInput, RequiredExtension) {
    const auto require = [](test::GltfBuilder& b) {
      b.json["extensionsRequired"] = {"KHR_texture_transform", "VENDOR_magic"};
    };
    import::expect_refused(require, "unsupported_extension", "/extensionsRequired/1");
  }

  TEST(BadInput, WrongTypesAndMissingProperties) {
    const auto refuse = [](const import::Edit& edit, const std::string& pointer) {
      import::expect_refused(edit, "invalid_scene", pointer);
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
    refuse([](auto& b) { import::primitive(b).erase("attributes"); }, "/meshes/0/primitives/0");
    refuse([](auto& b) { import::primitive(b)["mode"] = 7; }, "/meshes/0/primitives/0/mode");
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
    const auto refuse = [](const import::Edit& edit, const std::string& pointer) {
      import::expect_refused(edit, "invalid_scene", pointer);
    };
    refuse([](auto& b) { b.json["scene"] = 1; }, "/scene");
    refuse([](auto& b) { b.json["scenes"] = {{{"nodes", {2}}}}; }, "/scenes/0/nodes/0");
    refuse([](auto& b) { b.json["nodes"][1]["children"] = {0, 9}; }, "/nodes/1/children/1");
    refuse([](auto& b) { b.json["nodes"][0]["mesh"] = 1; }, "/nodes/0/mesh");
    refuse([](auto& b) { b.json["nodes"][0]["skin"] = 0; }, "/nodes/0/skin");
    refuse([](auto& b) { import::primitive(b)["material"] = 1; },
           "/meshes/0/primitives/0/material");
    refuse([](auto& b) { import::primitive(b)["indices"] = 4; }, "/meshes/0/primitives/0/indices");
    refuse([](auto& b) { import::primitive(b)["attributes"]["A/B~"] = 99; },
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

  }  // namespace
  }  // namespace kiln::import
