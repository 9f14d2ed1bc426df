// Buffers, their files, accessors and what they hold: a stable code, and the place.
#include <gtest/gtest.h>

#include "tests/import/bad_input.h"

namespace kiln::import {
namespace {

TEST(BadInput, BuffersAndViews) {
  const auto refuse = [](const import::Edit& edit, const std::string& pointer) {
    import::expect_refused(edit, "invalid_scene", pointer);
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
    import::expect_refused(
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
  test::GltfBuilder b = test::triangle_builder();
  b.json["buffers"] = {{{"byteLength", 36}, {"uri", "x/a.bin"}}};
  const auto check = [&](const std::map<std::string, std::string>& side) {
    const import::Upload upload(b.document(false).dump(), side);
    const auto checked = import::check_scene(upload.files, import::dark());
    return checked ? std::string() : checked.error().code;
  };
  EXPECT_EQ(check({{"a.bin", b.binary}}), "");
  EXPECT_EQ(check({{"y/a.bin", b.binary}, {"z/a.bin", b.binary}}), "missing_file");
  EXPECT_EQ(check({{"x/a.bin", b.binary}, {"z/a.bin", b.binary}}), "");
  EXPECT_EQ(check({{"b.bin", b.binary}}), "missing_file");
  EXPECT_EQ(check({{"a.bin", b.binary.substr(1)}}), "invalid_scene");  // too short
}

TEST(BadInput, AccessorContents) {
  const auto refuse = [](const import::Edit& edit, const std::string& pointer) {
    import::expect_refused(edit, "invalid_scene", pointer);
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float inf = std::numeric_limits<float>::infinity();
  refuse([&](auto& b) { import::overwrite(b, 40, nan); }, "/accessors/0");
  refuse([&](auto& b) { import::overwrite(b, 40, -inf); }, "/accessors/0");
  refuse([&](auto& b) { import::overwrite(b, 48, nan); }, "/accessors/1");
  refuse([&](auto& b) { import::overwrite(b, 96, inf); }, "/accessors/2");
  refuse([&](auto& b) { import::overwrite(b, 40, 1e38f); },
         "/meshes/0/primitives/0/attributes/POSITION");
  refuse([](auto& b) { import::overwrite<std::uint16_t>(b, 128, 4); },
         "/meshes/0/primitives/0/indices");
  refuse([](auto& b) { import::overwrite<std::uint16_t>(b, 128, 0xffff); },
         "/meshes/0/primitives/0/indices");
  refuse([](auto& b) { import::primitive(b)["attributes"]["POSITION"] = 2; }, "/accessors/2/type");
  refuse([](auto& b) { import::primitive(b)["indices"] = 0; }, "/accessors/0/type");
  refuse([](auto& b) { b.json["accessors"][3]["normalized"] = true; },
         "/accessors/3/componentType");
  refuse([](auto& b) { b.json["accessors"][2]["count"] = 3; },
         "/meshes/0/primitives/0/attributes/TEXCOORD_0");
  refuse([](auto& b) { b.json["accessors"][3].erase("bufferView"); }, "/accessors/3");
}

TEST(BadInput, BoundsThatLieAreAWarning) {
  test::GltfBuilder b = import::specimen();
  b.json["accessors"][0]["max"] = {1, 0.5, 0};
  b.json["accessors"][0]["min"] = {0, 0, 0};
  EXPECT_EQ(import::warning_codes(import::imported(b)),
            std::vector<std::string>{"accessor_bounds_wrong"});
}

TEST(BadInput, SparseAccessors) {
  const auto with_sparse = [](std::vector<std::uint8_t> indices, int count, json extra) {
    return [=](test::GltfBuilder& b) {
      const int i = b.view(indices.data(), indices.size());
      const std::vector<float> values(3 * indices.size(), 0.5f);
      const int v = b.view(values.data(), values.size() * sizeof(float));
      b.json["accessors"][0]["sparse"] = {{"count", count},
                                          {"indices", {{"bufferView", i}, {"componentType", 5121}}},
                                          {"values", {{"bufferView", v}}}};
      b.json["accessors"][0]["sparse"].merge_patch(extra);
    };
  };
  const auto refuse = [](const import::Edit& edit, const std::string& pointer) {
    import::expect_refused(edit, "invalid_scene", pointer);
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

}  // namespace
}  // namespace kiln::import
