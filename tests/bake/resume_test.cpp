// A bake that was cut goes on from its checkpoints, and nobody can tell from the result.
#include <algorithm>
#include <chrono>
#include <fstream>
#include <functional>
#include <thread>

#include "baker/methods.h"
#include "tests/bake/recorder.h"
#include "tests/support/sky_files.h"

namespace kiln::baker {
namespace {

class Resume : public ::testing::Test {
 protected:
  TempFolder folder_;
  exec::ThreadPool pool_{2};
  BakeInput input_ = input_for(folder_, "cornell", 64);

  Resume() {
    input_.settings.quality.target_error = 0.04f;
    input_.settings.output.precision = proto::Precision::kFloat;
    input_.settings.output.layers = {"irradiance", "direct", "indirect", "standard_error",
                                     "samples"};
  }

  /// Bakes, and stops after so many passes.
  Told run(std::size_t passes = SIZE_MAX) {
    Recorder recorder;
    recorder.stop_after = passes;
    const auto manifest = bake(input_, pool_, recorder.stop.get_token(), recorder);
    EXPECT_EQ(manifest.has_value(), passes == SIZE_MAX);
    if (manifest) {
      EXPECT_EQ(manifest->statistics.passes.size(), recorder.resumed + recorder.passes.size());
      tail_scale_ = manifest->statistics.tail_scale;
    }
    return recorder;
  }
  /// Cuts the bake after each of its passes, and compares with what it has just written.
  void cut_after_every_pass(std::size_t passes) {
    const std::string undisturbed = exr();
    const double scale = tail_scale_;
    for (std::size_t cut = 1; cut <= passes; ++cut) {
      forget();
      EXPECT_EQ(run(cut).passes.size(), cut);
      const Told rest = run();
      EXPECT_EQ(rest.resumed, cut);
      EXPECT_EQ(rest.passes.size(), passes - cut);
      EXPECT_TRUE(rest.checkpoint_warnings.empty());
      if (cut < passes) {
        EXPECT_EQ(rest.passes.front().index, cut);
      }
      EXPECT_TRUE(exr() == undisturbed) << "cut after " << cut;
      EXPECT_EQ(tail_scale_, scale);
    }
  }
  void forget() {
    fs::remove_all(input_.checkpoint_dir);
    fs::create_directories(input_.checkpoint_dir);
  }
  std::string exr() const { return test::read_bytes(input_.output_dir / "page_00.exr"); }
  fs::path file(const char* name) const { return input_.checkpoint_dir / name; }

  /// One byte in the middle turned over.
  static void damage(const fs::path& file) {
    std::string bytes = test::read_bytes(file);
    bytes.at(bytes.size() / 2) = char(bytes[bytes.size() / 2] ^ 1);
    std::ofstream(file, std::ios::binary) << bytes;
  }

  double tail_scale_ = 0;
};

TEST_F(Resume, UnderASkyMapToo) {
  input_ = input_for(folder_, "courtyard", 64);
  input_.settings.quality.target_error = 0.04f;
  input_.settings.sky.map = "noon.hdr";
  input_.settings.sky.scale = 2000;
  const test::SkyPicture noon(64, [](math::Vec3 d) -> math::Rgb {
    return d.y > 0.98f ? math::Rgb{900, 800, 700} : math::Rgb{0.3f, 0.5f, 1};
  });
  input_.files.side["noon.hdr"] = folder_.write("noon.hdr", test::hdr_file(noon));
  const std::size_t passes = run().passes.size();
  ASSERT_GT(passes, 4u);
  const std::string undisturbed = exr();
  for (const std::size_t stop : {std::size_t{1}, std::size_t{2}, passes - 1}) {
    forget();
    run(stop);
    EXPECT_GT(run().resumed, 0u) << stop;
    EXPECT_TRUE(exr() == undisturbed) << stop;
  }
  // Another sky is another bake.
  forget();
  run(2);
  input_.settings.sky.rotation = 90;
  EXPECT_EQ(run().resumed, 0u);
}

TEST_F(Resume, AfterAnyPassNoPassIsMadeAgainAndNoBitDiffers) {
  for (const Method& method : methods()) {
    input_.settings.solver.method = method.id;
    if (!method.adaptive) input_.settings.solver.samples = 64;
    // Time goes with the fourth power of the size where a method takes all pairs of texels, and
    // links are no faster on small pages.
    const bool is_slow = method.cost != nullptr || method.id == proto::Method::kLinks;
    input_.settings.atlas.page_size = is_slow ? 32 : 64;
    forget();
    const std::size_t passes = run().passes.size();
    ASSERT_GE(passes, 2u);
    cut_after_every_pass(passes);
  }
}

TEST_F(Resume, WhereEmittersSendTheirLightToo) {
  input_.settings.atlas.page_size = 48;
  input_.settings.quality.target_error = 0.08f;
  input_.settings.solver.emitters = proto::Emitters::kTransport;
  input_.settings.solver.bounces = 3;
  for (const Method& method : methods()) {
    if (method.id != proto::Method::kGather && method.id != proto::Method::kRadiosityMap) continue;
    input_.settings.solver.method = method.id;
    if (!method.adaptive) input_.settings.solver.samples = 32;
    forget();
    const std::size_t passes = run().passes.size();
    ASSERT_GE(passes, 4u);
    cut_after_every_pass(passes);
  }
}

TEST_F(Resume, ManyTimesInOneBake) {
  const std::size_t passes = run().passes.size();
  const std::string undisturbed = exr();
  forget();
  for (std::size_t cut = 1; cut < passes; ++cut) {
    const Told part = run(1);
    EXPECT_EQ(part.resumed, cut - 1);
    EXPECT_EQ(part.passes.size(), 1u);
  }
  run();
  EXPECT_TRUE(exr() == undisturbed);
}

// With checkpoints that several passes share, and cuts at moments of their own.
TEST_F(Resume, WhateverWasToldIsNeverMadeAgain) {
  const std::size_t passes = run().passes.size();
  const std::string undisturbed = exr();
  input_.checkpoint_share = 0.05;
  for (const double seconds : {0.002, 0.01, 0.02, 0.04}) {
    forget();
    std::vector<std::uint32_t> told;
    bool whole = false;
    for (int attempt = 0; !whole; ++attempt) {
      Recorder recorder;
      std::jthread cut;
      if (attempt < 6)
        cut = std::jthread([&] {
          std::this_thread::sleep_for(std::chrono::duration<double>(seconds * (attempt + 1)));
          recorder.stop.request_stop();
        });
      whole = bake(input_, pool_, recorder.stop.get_token(), recorder).has_value();
      cut = {};
      EXPECT_GE(recorder.resumed, told.size()) << "what was told is there";
      for (const auto& pass : recorder.passes) told.push_back(pass.index);
    }
    EXPECT_TRUE(std::ranges::adjacent_find(told, std::ranges::greater_equal()) == told.end());
    EXPECT_LE(told.size(), passes);
    EXPECT_EQ(told.back(), passes - 1);
    EXPECT_TRUE(exr() == undisturbed);
  }
}

TEST_F(Resume, InTheMiddleOfAPass) {
  input_.settings.atlas.page_size = 128;
  run();
  const std::string undisturbed = exr();
  input_.part_time = std::chrono::milliseconds(0);  // after every batch
  forget();
  int within = 0;
  bool whole = false;
  for (int attempt = 0; !whole; ++attempt) {
    Recorder recorder;
    std::jthread cut;
    if (attempt < 20)
      recorder.when_solving = [&] {
        cut = std::jthread([&] {
          std::this_thread::sleep_for(std::chrono::milliseconds(20 + 2 * attempt));
          recorder.stop.request_stop();
        });
      };
    whole = bake(input_, pool_, recorder.stop.get_token(), recorder).has_value();
    cut = {};
    within += recorder.within > 0;
    EXPECT_TRUE(recorder.checkpoint_warnings.empty());
  }
  EXPECT_GT(within, 0);
  EXPECT_TRUE(exr() == undisturbed);
  for (const auto& left : fs::directory_iterator(input_.checkpoint_dir))
    EXPECT_FALSE(left.path().filename().string().starts_with("part_")) << left;
}

TEST_F(Resume, CheckpointsOfAnotherBakeAreLeftAlone) {
  run(3);
  const auto expect_fresh = [&](const char* what) {
    const Told fresh = run(3);
    EXPECT_EQ(fresh.resumed, 0u) << what;
    EXPECT_EQ(fresh.passes.size(), 3u) << what;
    EXPECT_EQ(fresh.checkpoint_warnings, std::vector<std::string>{"checkpoint_ignored"}) << what;
  };
  input_.settings.solver.seed = 2;
  expect_fresh("other settings");
  input_.scene_key = "dead";
  expect_fresh("another scene");
}

TEST_F(Resume, DamageIsNoticedAndTheBakeStartsAgain) {
  run();
  const std::string undisturbed = exr();
  struct Case {
    const char* what;
    std::function<void()> harm;
    std::uint32_t resumed;  ///< after 3 passes, whose light lies in pass_1.bin
  };
  for (const Case& c :
       std::vector<Case>{{"state damaged", [&] { damage(file("state.bin")); }, 0},
                         {"state gone", [&] { fs::remove(file("state.bin")); }, 0},
                         {"state cut", [&] { fs::resize_file(file("state.bin"), 100); }, 0},
                         {"newest damaged", [&] { damage(file("pass_1.bin")); }, 2},
                         {"newest empty", [&] { fs::resize_file(file("pass_1.bin"), 0); }, 2},
                         {"earlier damaged", [&] { damage(file("pass_0.bin")); }, 3},
                         {"both damaged",
                          [&] {
                            damage(file("pass_0.bin"));
                            damage(file("pass_1.bin"));
                          },
                          0}}) {
    forget();
    run(3);
    c.harm();
    const Told again = run();
    EXPECT_EQ(again.resumed, c.resumed) << c.what;
    EXPECT_EQ(again.checkpoint_warnings.empty(), c.resumed > 0) << c.what;
    EXPECT_TRUE(exr() == undisturbed) << c.what;
  }
}

TEST_F(Resume, TheLastPassNeedsNoOther) {
  const std::size_t passes = run().passes.size();
  const std::string undisturbed = exr();
  damage(file(passes % 2 ? "pass_0.bin" : "pass_1.bin"));
  const Told again = run();
  EXPECT_EQ(again.resumed, passes);
  EXPECT_TRUE(again.checkpoint_warnings.empty());
  EXPECT_TRUE(exr() == undisturbed);
}

TEST_F(Resume, ACheckpointThatCanNotBeWrittenDoesNotEndTheBake) {
  const std::size_t passes = run().passes.size();
  const std::string undisturbed = exr();
  fs::remove_all(input_.checkpoint_dir);
  const Told without = run();
  EXPECT_EQ(without.passes.size(), passes);
  EXPECT_EQ(without.checkpoint_warnings, std::vector<std::string>{"checkpoint_failed"})
      << "said once";
  EXPECT_TRUE(exr() == undisturbed);
}

}  // namespace
}  // namespace kiln::baker
