// The light stays the same bit by bit. same_bits.txt lists a digest of the decoded values of every
// layer of every page for twelve scenes and three settings, per instruction set.
// LIGHTKILN_UPDATE_DIGESTS=1 test_bake --gtest_filter='*SameBits*' writes the list anew.
#include <gtest/gtest.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/sha256.h"
#include "tests/bake/guarded_scenes.h"
#include "tests/bake/recorder.h"
#include "tests/support/page_values.h"

namespace kiln::baker {
namespace {

using nlohmann::json;
using test::GuardedScene;

constexpr const char* kFile = LIGHTKILN_SOURCE_DIR "/tests/bake/same_bits.txt";
constexpr const char* kOutput = R"({"output": {"formats": ["exr"], "precision": "float",
  "layers": ["irradiance", "direct", "indirect", "raw", "standard_error", "samples"]}})";

/// One way in which each scene is baked. Any number of threads gives the same light.
struct Variant {
  const char* name;
  unsigned threads;
  const char* settings;
};
constexpr Variant kVariants[] = {
    {"quick", 2, R"({"atlas": {"page_size": 128}, "quality": {"preset": "preview"}})"},
    {"fine", 3, R"({"atlas": {"page_size": 96, "unwrap": "always"},
                 "quality": {"target_error": 0.02, "measure": "rms"}, "post": {"filter": false},
                 "solver": {"coarse_indirect": false, "seed": 7}})"},
    {"path", 1, R"({"atlas": {"page_size": 64},
                 "solver": {"method": "path", "samples": 16, "bounces": 4}})"}};

bool updating() {
  return std::getenv("LIGHTKILN_UPDATE_DIGESTS") != nullptr;
}

/// The list in the source tree. It maps instruction set, scene and variant to a digest.
class Digests {
 public:
  Digests() {
    std::ifstream in(kFile);
    std::string set, scene, variant, digest;
    while (in >> set >> scene >> variant >> digest)
      digests_[set + " " + scene + " " + variant] = digest;
  }
  bool know(const std::string& set) const {
    const auto first = digests_.lower_bound(set + " ");
    return first != digests_.end() && first->first.starts_with(set + " ");
  }
  std::string& operator[](const std::string& bake) { return digests_[bake]; }
  void write() const {
    std::ofstream out(kFile);
    for (const auto& [bake, digest] : digests_) out << bake << " " << digest << "\n";
  }

 private:
  std::map<std::string, std::string> digests_;
};

proto::BakeSettings settings_of(const test::GuardedScene& scene, const Variant& variant) {
  json all = json::parse(kOutput);
  all.merge_patch(json::parse(variant.settings));
  all.merge_patch(json::parse(scene.settings));
  if (std::string_view(variant.name) == "fine") all.merge_patch(json::parse(scene.fine));
  const auto settings = proto::parse_settings(all.dump());
  if (!settings) throw std::runtime_error(settings.error().message);
  return *settings;
}

/// Computes the SHA-256 of the pages in order: the size, then every channel in the order of names.
std::string digest_of(const fs::path& folder, std::size_t pages) {
  proto::Sha256 hash;
  for (std::size_t p = 0; p < pages; ++p) {
    const std::string digits = std::to_string(p);
    const auto page =
        test::read_page(folder / ("page_" + std::string(digits.size() < 2, '0') + digits + ".exr"));
    hash.update(std::to_string(page.width) + " " + std::to_string(page.height) + "\n");
    for (const auto& [name, values] : page.channels) {
      hash.update(name + "\n");
      hash.update({reinterpret_cast<const char*>(values.data()), values.size() * sizeof(float)});
    }
  }
  return hash.hex();
}

BakeInput input_of(const test::TempFolder& folder, const test::GuardedScene& scene,
                   const Variant& variant) {
  BakeInput in;
  in.files.main = folder.write("scene.glb", scene.glb());
  for (const auto& [name, bytes] : scene.side) in.files.side[name] = folder.write(name, bytes);
  in.settings = settings_of(scene, variant);
  in.output_dir = folder.path() / "out";
  fs::create_directories(in.output_dir);
  return in;
}

std::string baked(const BakeInput& in, unsigned threads) {
  exec::ThreadPool pool(threads);
  BakeObserver quiet;
  const auto manifest = bake(in, pool, {}, quiet);
  if (!manifest) throw std::runtime_error(manifest.error().message);
  return digest_of(in.output_dir, manifest->pages.size());
}

class SameBits : public ::testing::TestWithParam<test::GuardedScene> {
 protected:
  void SetUp() override {
    if (!updating() && !digests().know(instruction_set()))
      GTEST_SKIP() << "there are no digests for the instruction set " << instruction_set();
  }
  static void TearDownTestSuite() {
    if (updating()) digests().write();
  }
  static Digests& digests() {
    static Digests digests;
    return digests;
  }

  /// Returns the listed digest of a bake of the scene.
  static std::string& listed(const Variant& variant) {
    return digests()[std::string(instruction_set()) + " " + GetParam().name + " " + variant.name];
  }
};

TEST_P(SameBits, AsBefore) {
  for (const Variant& variant : kVariants) {
    const test::TempFolder folder;
    const std::string digest = baked(input_of(folder, GetParam(), variant), variant.threads);
    if (updating()) listed(variant) = digest;
    EXPECT_EQ(digest, listed(variant)) << variant.name;
  }
}

TEST_P(SameBits, AfterAStop) {
  const Variant& variant = kVariants[1];
  const test::TempFolder folder;
  BakeInput in = input_of(folder, GetParam(), variant);
  in.checkpoint_dir = folder.path() / "checkpoints";
  in.checkpoint_share = 1;
  in.part_time = std::chrono::milliseconds(0);
  fs::create_directories(in.checkpoint_dir);
  exec::ThreadPool pool(2);
  Recorder first, second;
  first.stop_after = 2;
  EXPECT_FALSE(bake(in, pool, first.stop.get_token(), first));
  const auto manifest = bake(in, pool, {}, second);
  ASSERT_TRUE(manifest) << manifest.error().message;
  EXPECT_GE(second.resumed, 2u);
  EXPECT_GT(second.passes.size(), 0u);
  EXPECT_EQ(digest_of(in.output_dir, manifest->pages.size()), listed(variant));
}

INSTANTIATE_TEST_SUITE_P(Scenes, SameBits, ::testing::ValuesIn(test::guarded_scenes()),
                         [](const auto& scene) { return scene.param.name; });

}  // namespace
}  // namespace kiln::baker
