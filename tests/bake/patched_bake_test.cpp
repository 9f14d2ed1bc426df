// A bake whose batches are computed apart, as bytes, in any order, gives the same bits.
#include <gtest/gtest.h>

#include "baker/methods.h"
#include "tests/bake/recorder.h"
#include "tests/support/patch_queue.h"
#include "tests/support/sky_files.h"

namespace kiln::baker {
namespace {

struct QueueCase {
  const char* scene;
  std::uint32_t page_size;
  bool coarse;
  proto::ErrorMeasure measure;
  bool sky;
};

/// Time goes with the fourth power of this where a method takes all pairs of texels.
constexpr std::uint32_t kPairsPageSize = 32;

class PatchedBake : public testing::TestWithParam<QueueCase> {
 protected:
  TempFolder folder_;
  exec::ThreadPool pool_{2};

  BakeInput input(const Method& method) const {
    const QueueCase& c = GetParam();
    BakeInput in = input_for(folder_, c.scene, method.cost ? kPairsPageSize : c.page_size);
    in.checkpoint_dir.clear();
    in.settings.solver.method = method.id;
    in.settings.solver.coarse_indirect = c.coarse;
    if (!method.adaptive) in.settings.solver.samples = 32;
    in.settings.quality.target_error = 0.02f;
    in.settings.quality.measure = c.measure;
    in.settings.output.precision = proto::Precision::kFloat;
    in.settings.output.formats = {"exr"};
    in.settings.output.layers = {"irradiance", "direct",         "indirect",
                                 "raw",        "standard_error", "samples"};
    if (!c.sky) return in;
    in.settings.sky.map = "noon.hdr";
    in.settings.sky.scale = 2000;
    const test::SkyPicture noon(64, [](math::Vec3 d) -> math::Rgb {
      return d.y > 0.98f ? math::Rgb{900, 800, 700} : math::Rgb{0.3f, 0.5f, 1};
    });
    in.files.side["noon.hdr"] = folder_.write("noon.hdr", test::hdr_file(noon));
    return in;
  }
  proto::Manifest baked(const BakeInput& in) {
    BakeObserver quiet;
    auto manifest = bake(in, pool_, {}, quiet);
    if (!manifest) throw std::runtime_error(manifest.error().message);
    return std::move(*manifest);
  }
  static std::string exr(const BakeInput& in) {
    return test::read_bytes(in.output_dir / "page_00.exr");
  }
};

TEST_P(PatchedBake, GivesTheSameBits) {
  for (const Method& method : methods()) {
    BakeInput in = input(method);
    const proto::Manifest usual = baked(in);
    const std::string expected = exr(in);
    if (method.adaptive) {
      EXPECT_EQ(usual.statistics.passes.back().name, "round") << "the target is within reach";
    }
    for (const std::uint32_t seed : {1u, 2u, 3u}) {
      test::PatchQueue queue(pool_, seed);
      in.queue = &queue;
      const proto::Manifest patched = baked(in);
      EXPECT_TRUE(exr(in) == expected) << method.name() << ", order " << seed;
      EXPECT_EQ(patched.statistics.rays, usual.statistics.rays);
      EXPECT_GT(queue.patches, usual.statistics.passes.size()) << "several batches a pass";
      EXPECT_GT(queue.bytes, queue.patches * 56);
    }
  }
}

TEST_P(PatchedBake, GivesTheSameBitsWhereEmittersSendTheirLight) {
  for (const proto::Method id :
       {proto::Method::kGather, proto::Method::kPath, proto::Method::kRadiosityMap}) {
    BakeInput in = input(method_of(id));
    in.settings.solver.emitters = proto::Emitters::kTransport;
    in.settings.quality.target_error = 0.08f;
    in.settings.quality.max_samples = 256;
    baked(in);
    const std::string expected = exr(in);
    test::PatchQueue queue(pool_, 1);
    in.queue = &queue;
    baked(in);
    EXPECT_TRUE(exr(in) == expected) << method_of(id).name();
  }
}

INSTANTIATE_TEST_SUITE_P(
    Scenes, PatchedBake,
    testing::Values(QueueCase{"cornell", 64, true, proto::ErrorMeasure::kPercentile95, false},
                    QueueCase{"cornell_shelves", 48, false, proto::ErrorMeasure::kRms, false},
                    QueueCase{"many_lights", 48, true, proto::ErrorMeasure::kRms, false},
                    QueueCase{"courtyard", 48, true, proto::ErrorMeasure::kPercentile95, true}),
    [](const auto& c) { return c.param.scene; });

}  // namespace
}  // namespace kiln::baker
