// Writes the inputs that fuzzing starts from: fuzz_seeds FOLDER makes FOLDER/<target>/<number>.
#include <webp/encode.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "baker/generate/generate.h"
#include "baker/import/import.h"
#include "proto/json.h"
#include "tests/fuzz/scene_bytes.h"
#include "tests/support/gltf_builder.h"
#include "tests/support/packed_gltf.h"
#include "tests/support/png_builder.h"
#include "tests/support/sky_files.h"

using namespace kiln;
namespace fs = std::filesystem;

namespace {

class Seeds {
 public:
  Seeds(const fs::path& root, const char* target) : folder_(root / target) {
    fs::create_directories(folder_);
  }
  void add(const std::string& bytes) {
    std::ofstream out(folder_ / std::to_string(next_++), std::ios::binary);
    out.write(bytes.data(), static_cast<std::streamsize>(bytes.size()));
    FUZZ_REQUIRE(out.flush());
  }

 private:
  fs::path folder_;
  int next_ = 0;
};

/// A picture of 8 x 8 pixels with alpha.
std::string webp_file(bool lossless) {
  std::vector<std::uint8_t> rgba;
  for (int i = 0; i < 8 * 8 * 4; ++i) rgba.push_back(std::uint8_t(i * 37 / 5));
  std::uint8_t* bytes = nullptr;
  const std::size_t size = lossless ? WebPEncodeLosslessRGBA(rgba.data(), 8, 8, 32, &bytes)
                                    : WebPEncodeRGBA(rgba.data(), 8, 8, 32, 70, &bytes);
  std::string file(reinterpret_cast<const char*>(bytes), size);
  WebPFree(bytes);
  return file;
}

/// Documents with one of each thing that the importer knows.
std::vector<std::string> documents() {
  std::vector<std::string> out;
  test::GltfBuilder rich = test::triangle_builder();
  auto& primitive = rich.json["meshes"][0]["primitives"][0];
  primitive["attributes"]["NORMAL"] = rich.accessor<float>({0, 0, 1, 0, 0, 1, 0, 0, 1}, 3);
  primitive["attributes"]["TEXCOORD_0"] = rich.accessor<std::uint16_t>({0, 0, 9, 0, 0, 9}, 2, true);
  primitive["attributes"]["TEXCOORD_1"] = rich.accessor<float>({0, 0, 1, 0, 0, 1}, 2);
  primitive["attributes"]["COLOR_0"] =
      rich.accessor<std::uint8_t>({9, 9, 9, 255, 9, 9, 9, 255, 9, 9, 9, 255}, 4, true);
  primitive["indices"] = rich.accessor<std::uint16_t>({0, 1, 2}, 1);
  rich.add("samplers", {{"wrapS", 33648}, {"wrapT", 33071}, {"magFilter", 9728}});
  rich.add("textures",
           {{"source", rich.image(test::PngBuilder::encode(2, 2, 8, 6, std::string(16, '\x70')),
                                  "image/png")},
            {"sampler", 0}});
  rich.material(
      {{"pbrMetallicRoughness",
        {{"baseColorFactor", {0.5, 0.5, 0.5, 1}},
         {"baseColorTexture",
          {{"index", 0},
           {"extensions",
            {{"KHR_texture_transform",
              {{"offset", {0.1, 0.2}}, {"rotation", 1}, {"scale", {2, 2}}}}}}}}}},
       {"emissiveFactor", {1, 1, 1}},
       {"emissiveTexture", {{"index", 0}, {"texCoord", 1}}},
       {"alphaMode", "MASK"},
       {"doubleSided", true},
       {"extensions", {{"KHR_materials_emissive_strength", {{"emissiveStrength", 20}}}}}});
  primitive["material"] = 0;
  rich.json["extensions"]["KHR_lights_punctual"]["lights"] = {
      {{"type", "spot"}, {"intensity", 10}, {"range", 5}, {"spot", {{"outerConeAngle", 0.5}}}},
      {{"type", "directional"}, {"color", {1, 0.5, 0}}}};
  rich.json["extensionsUsed"] = {"KHR_lights_punctual", "KHR_texture_transform"};
  rich.node({{"children",
              {rich.node({{"translation", {0, 1, 0}},
                          {"rotation", {0, 0, 0, 1}},
                          {"extensions", {{"KHR_lights_punctual", {{"light", 0}}}}}})}},
             {"matrix", {2, 0, 0, 0, 0, 2, 0, 0, 0, 0, -2, 0, 1, 2, 3, 1}},
             {"mesh", 0}});
  out.push_back(rich.glb());
  out.push_back(rich.gltf());

  test::GltfBuilder sparse = test::triangle_builder();
  const std::vector<std::uint16_t> index{1};
  const std::vector<float> value{2, 0, 0};
  const int indices = sparse.view(index.data(), 2), values = sparse.view(value.data(), 12);
  sparse.json["accessors"][0]["sparse"] = {
      {"count", 1},
      {"indices", {{"bufferView", indices}, {"componentType", 5123}}},
      {"values", {{"bufferView", values}}}};
  sparse.json["meshes"][0]["primitives"][0]["mode"] = 5;
  out.push_back(sparse.glb());

  test::GltfBuilder side = test::triangle_builder();
  side.json["buffers"] = {{{"byteLength", side.binary.size()}, {"uri", "a.bin"}}};
  out.push_back(side.document(false).dump());
  for (const char* mode : {"TRIANGLES", "INDICES"}) {
    test::GltfBuilder indexed = test::triangle_builder();
    indexed.json["meshes"][0]["primitives"][0]["indices"] =
        indexed.accessor<std::uint16_t>({0, 1, 2, 0, 2, 1}, 1);
    out.push_back(packed_by_meshopt(indexed, {{.stride = 12}, {.mode = mode, .stride = 2}}).glb());
  }
  out.push_back(
      packed_by_meshopt(test::triangle_builder(), {{"ATTRIBUTES", "EXPONENTIAL", 12}}).glb());
  for (const bool edgebreaker : {false, true})
    out.push_back(test::packed_by_draco({0, 0, 0, 1, 0, 0, 1, 1, 0, 0, 1, 0},
                                        {0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1}, {0, 1, 2, 0, 2, 3},
                                        edgebreaker)
                      .glb());
  for (const bool lossless : {false, true}) {
    test::GltfBuilder image = test::triangle_builder();
    const std::string webp = ::webp_file(lossless);
    image.add(
        "textures",
        {{"extensions", {{"EXT_texture_webp", {{"source", image.image(webp, "image/webp")}}}}}});
    image.material({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
    image.json["meshes"][0]["primitives"][0]["material"] = 0;
    out.push_back(image.glb());
  }
  for (const int depth : {1, 2, 4, 16}) {
    test::GltfBuilder image = test::triangle_builder();
    image.add("textures",
              {{"source", image.image(test::PngBuilder::encode(
                                          2, 1, depth, 0, std::string(depth == 16 ? 4 : 2, '\x55')),
                                      "image/png")}});
    image.material({{"pbrMetallicRoughness", {{"baseColorTexture", {{"index", 0}}}}}});
    image.json["meshes"][0]["primitives"][0]["material"] = 0;
    out.push_back(image.glb());
  }
  return out;
}

void make_scenes(const fs::path& root) {
  constexpr std::size_t kMaxSeed = 64 << 10;
  ::Seeds gltf(root, "gltf"), scene_file(root, "scene_file");
  const auto add = [&](const std::string& bytes) {
    if (bytes.size() > kMaxSeed) return;
    gltf.add(bytes);
    files::SceneFiles files;
    auto opened = std::make_shared<files::OpenedFiles>();
    opened->emplace("main", files::MappedFile::view(bytes));
    files.main = "main";
    files.opened = opened;
    auto scene = import::import_files(files);
    if (!scene) return;
    scene->warnings.push_back({"code", "/nodes/0", "message"});
    scene_file.add(fuzz::scene_bytes(*scene));
  };
  for (const auto& generator : generate::generators())
    add(generate::generate_glb(generator.name, 1).value_or(""));
  for (const auto& document : ::documents()) add(document);
}

void make_skies(const fs::path& root) {
  ::Seeds seeds(root, "sky");
  const test::SkyPicture sky(16, [](math::Vec3 d) -> math::Rgb {
    return d.x > 0.8f ? math::Rgb{800, 400, 100} : math::Rgb{0.2f, 0.25f + d.z / 8, 0.5f};
  });
  for (const auto rows : {test::HdrRows::kPacked, test::HdrRows::kPlain, test::HdrRows::kRepeated})
    seeds.add(test::hdr_file(sky, rows, "EXPOSURE=2\n"));
  seeds.add(test::hdr_file(sky, test::HdrRows::kPacked, "PRIMARIES=.7 .3 .2 .8 .1 .1 .3 .3\n"));
  seeds.add(
      test::exr_file(sky, {.chromaticities = {0.7f, 0.3f, 0.2f, 0.8f, 0.1f, 0.1f, 0.32f, 0.34f}}));
  for (int compression = 0; compression <= 9; ++compression)
    for (const bool half : {false, true})
      seeds.add(test::exr_file(sky, {half, false, compression}));
  for (const int compression : {0, 3, 4, 7, 8})
    seeds.add(test::exr_file(sky, {true, true, compression, {"R", "G", "B", "A"}}));
}

void make_images(const fs::path& root) {
  ::Seeds seeds(root, "image");
  for (const int channels : {0, 2, 4, 6})  // gray, RGB, gray and alpha, RGBA
    seeds.add(test::PngBuilder::encode(2, 2, 8, channels, std::string(16, '\x70')));
  const test::SkyPicture sky(4, [](math::Vec3 d) { return math::Rgb{1, 2, 3 + d.x}; });
  for (const auto rows : {test::HdrRows::kPlain, test::HdrRows::kRepeated})
    seeds.add(test::hdr_file(sky, rows, ""));
  for (const bool tiled : {false, true}) seeds.add(test::exr_file(sky, {false, tiled, 3}));
  seeds.add("\xff\xd8\xff\xe0");
  seeds.add(std::string("RIFF\x10\0\0\0WEBPVP8L\4\0\0\0\x2f\0\0\0", 24));
  seeds.add(std::string("II\x2a\0\x08\0\0\0\1\0\0\1\4\0\1\0\0\0\2\0\0\0", 22));
}

void make_settings(const fs::path& root) {
  ::Seeds seeds(root, "settings");
  const auto all = proto::to_json(proto::BakeSettings{});
  seeds.add(proto::to_text(all));
  for (const auto& [name, value] : all.items()) seeds.add(proto::to_text({{name, value}}));
  seeds.add(
      R"({"lights":[{"type":"spot","position":[1,2,3],"direction":[0,-1,0],"intensity":5},{"type":"rect","width":2}]})");
  seeds.add(R"({"priority":10,"labels":{"level":"yard"},"ttl_seconds":60,"dedupe":false})");
  seeds.add(
      R"({"type":"t","title":"t","status":422,"code":"c","detail":"d","errors":[{"source":"scene","pointer":"/a","detail":"x"}]})");
}

void make_requests(const fs::path& root) {
  ::Seeds seeds(root, "http");
  const std::string form =
      "--B\r\nContent-Disposition: form-data; name=\"scene\"; filename=\"a.glb\"\r\n"
      "Content-Type: model/gltf-binary\r\n\r\nglTF\r\n"
      "--B\r\nContent-Disposition: form-data; name=settings\r\n\r\n{}\r\n--B--\r\n";
  const std::string post =
      "POST /v1/jobs?a=b%20c HTTP/1.1\r\nHost: x\r\nContent-Type: multipart/form-data; "
      "boundary=B\r\n";
  const auto hex = [](std::size_t n) {
    char text[20];
    std::snprintf(text, sizeof text, "%zx", n);
    return std::string(text);
  };
  for (const char piece : {'\0', '\5', '\xff'}) {
    const std::string first(1, piece);
    seeds.add(first +
              "GET /v1/jobs/job_x/events?after=7 HTTP/1.1\r\nHost: x\r\nLast-Event-ID: 7\r\n\r\n");
    seeds.add(first + post + "Content-Length: " + std::to_string(form.size()) + "\r\n\r\n" + form);
    seeds.add(first + post + "Transfer-Encoding: chunked\r\n\r\n" + hex(10) + "\r\n" +
              form.substr(0, 10) + "\r\n" + hex(form.size() - 10) + ";x=y\r\n" + form.substr(10) +
              "\r\n0\r\nA: b\r\n\r\n");
    seeds.add(
        first +
        "PATCH /v1/jobs/j HTTP/1.1\r\nHost: x\r\nIf-Match: \"3\"\r\nContent-Length: 2\r\n\r\n{}");
  }
}

}  // namespace

int main(int argc, char** argv) {
  if (argc != 2) {
    std::fputs("usage: fuzz_seeds FOLDER\n", stderr);
    return 2;
  }
  ::make_scenes(argv[1]);
  ::make_skies(argv[1]);
  ::make_settings(argv[1]);
  ::make_requests(argv[1]);
  return 0;
}
