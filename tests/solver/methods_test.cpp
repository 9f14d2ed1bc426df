// The registry of methods is what the settings offer, and each method keeps its own promises.
#include "baker/methods.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <set>

#include "baker/solve.h"
#include "proto/json.h"
#include "tests/support/ready_scene.h"

namespace kiln::solver {
namespace {

TEST(Methods, AreThoseOfTheSettings) {
  const auto offered =
      proto::settings_schema().at("/properties/solver/properties/method/enum"_json_pointer);
  ASSERT_EQ(offered.size(), baker::methods().size());
  for (std::size_t i = 0; i < offered.size(); ++i) {
    EXPECT_EQ(offered[i], baker::methods()[i].name());
    EXPECT_EQ(&baker::method_of(baker::methods()[i].id), &baker::methods()[i]);
  }
}

// The refusal says what the bake would cost, and what would do instead.
TEST(Methods, WhatCantFinishIsRefusedWithItsCost) {
  proto::SolverSettings s;
  const auto refusal = [&](std::uint32_t texels) {
    const auto ok = baker::check_cost(s, texels);
    if (ok) return std::string();
    EXPECT_EQ(ok.error().code, "too_expensive");
    EXPECT_EQ(ok.error().details.at(0).pointer, "/solver/method");
    return ok.error().message;
  };
  constexpr std::uint32_t kPage2048 = 2048 * 2048, kPage128 = 128 * 128;
  EXPECT_EQ(refusal(kPage2048), "") << "gather takes any number";
  s.method = proto::Method::kPairwise;
  EXPECT_EQ(refusal(kPage128), "");
  EXPECT_EQ(refusal(kPage2048),
            "pairwise would trace about 4.4e+13 rays between 4194304 texels in 10 bounces: about "
            "1200 hours at 10 million rays a second, and 0.69 GiB of memory. Use solver.method "
            "\"gather\", or solver.undersampling with a solver.window of 7, or make the side of "
            "atlas.page_size 0.39 times as long, or less, or set solver.allow_expensive.");
  s.window = 7;
  EXPECT_NE(refusal(kPage2048), "") << "all texels send";
  s.undersampling = proto::Undersampling::kMonteCarlo;
  EXPECT_EQ(refusal(kPage2048), "") << "what the refusal advised";
  s.window = 6;
  EXPECT_NE(refusal(kPage2048).find("a solver.window of 7"), std::string::npos);
  s.undersampling = proto::Undersampling::kNone;
  s.pair_samples = 256;
  EXPECT_EQ(refusal(kPage128), "");
  EXPECT_NE(refusal(4 * kPage128), "") << "more rays for each pair";
  s.bounces = 1;
  EXPECT_EQ(refusal(4 * kPage128), "") << "fewer passes";
  EXPECT_NE(refusal(kPage2048).find(" in 1 bounce:"), std::string::npos);
  s.subdivision_threshold = 0.05f;
  EXPECT_EQ(refusal(kPage2048).find("undersampling"), std::string::npos)
      << "it does not go with a quadtree";
  s.subdivision_threshold.reset();
  s.bounces = 0;
  EXPECT_EQ(refusal(kPage2048), "") << "direct light alone";
  s.method = proto::Method::kMatrix;
  s.pair_samples = 1;
  EXPECT_EQ(refusal(8192), "");
  EXPECT_EQ(refusal(8193),
            "matrix would keep the view factors of all pairs of 8193 texels, which take 0.25 GiB "
            "of memory and about 1.7e+07 rays, 0.00047 hours at 10 million rays a second. It takes "
            "up to 8192 texels. Use solver.method \"gather\", or a smaller atlas.page_size, or set "
            "solver.allow_expensive.");
  s.allow_expensive = true;
  EXPECT_EQ(refusal(8193), "");
  s.method = proto::Method::kPairwise;
  s.bounces = 16;
  EXPECT_EQ(refusal(kPage2048), "");
}

// A pass writes what it declares, and nothing else: another process could send the rest.
TEST(Methods, PassesChangeOnlyThePlanesThatTheyDeclare) {
  const test::ReadyScene room("cornell", 0, 48);
  for (const baker::Method& method : baker::methods()) {
    proto::SolverSettings settings;
    settings.method = method.id;
    if (!method.adaptive) settings.samples = 32;
    const World world = room.world(settings, {.target_error = 0.02f});
    const auto solver = method.make(world);
    std::shared_ptr<const lightmap::Lightmap> before;
    std::uint32_t kept = 0;
    baker::SolveHooks hooks;
    hooks.on_pass = [&](const PassPlan& plan, const proto::PassReport&,
                        std::shared_ptr<const lightmap::Lightmap> after) -> proto::Expected<void> {
      if (before) {
        std::vector<const std::byte*> was;
        lightmap::Lightmap::for_planes(*before, [&](lightmap::PlaneId, const auto& plane) {
          was.push_back(plane.size() > 0 ? plane.bytes(0, plane.size()).data() : nullptr);
        });
        std::size_t i = 0;
        lightmap::Lightmap::for_planes(*after, [&](lightmap::PlaneId id, const auto& plane) {
          const auto* now = plane.size() > 0 ? plane.bytes(0, plane.size()).data() : nullptr;
          const bool declared = contains(plan.writes | plan.finishes, id);
          const bool judged = plan.completes && (id == lightmap::PlaneId::kDoublings ||
                                                 contains(lightmap::shared_planes(), id));
          if (!declared && !judged) {
            EXPECT_EQ(now, was[i]) << method.name() << " " << plan.name << " " << int(id);
            ++kept;
          }
          ++i;
        });
      }
      before = after;
      return {};
    };
    exec::ThreadPool pool(2);
    ASSERT_TRUE(baker::solve(world, *solver, pool, {}, hooks));
    EXPECT_GT(kept, 0u);
  }
}

/// The light with nonsense in the planes that are not in `kept`.
lightmap::Lightmap blinded(const lightmap::Lightmap& light, const lightmap::PlaneSet& kept) {
  lightmap::Lightmap blind = light;
  const auto others = light.planes() & ~kept & ~lightmap::shared_planes();
  blind.detach(others);
  lightmap::Lightmap::for_planes(blind, others, [](lightmap::PlaneId, auto& plane) {
    std::ranges::fill(plane.bytes(0, plane.size()), std::byte{0x7f});
  });
  if (!contains(kept, lightmap::PlaneId::kHits)) blind.hits.drop();
  if (!contains(kept, lightmap::PlaneId::kSeen)) blind.seen.drop();
  return blind;
}

/// Computes the first batch of the pass and returns its values as bytes.
std::string first_batch(std::unique_ptr<Pass> pass, const lightmap::Lightmap& before,
                        const exec::Workers& workers) {
  if (!pass->prepare(before, workers)) return "stopped";
  const std::uint32_t end = std::min(pass->plan().batch_texels, before.size());
  return compute_patch(*pass, {0, end}, before).values;
}

// A pass reads the planes that it declares, and no others: another process needs those alone.
TEST(Methods, PassesReadOnlyThePlanesThatTheyDeclare) {
  const test::ReadyScene room("cornell", 0, 48);
  for (const baker::Method& method : baker::methods()) {
    proto::SolverSettings settings;
    settings.method = method.id;
    if (!method.adaptive) settings.samples = 48;
    const World world = room.world(settings, {.target_error = 0.02f});
    const auto solver = method.make(world);
    std::vector<proto::PassReport> done;
    std::set<std::string> seen;
    exec::ThreadPool pool(2);
    baker::SolveHooks hooks;
    hooks.on_pass = [&](const PassPlan&, const proto::PassReport& report,
                        std::shared_ptr<const lightmap::Lightmap> light) -> proto::Expected<void> {
      done.push_back(report);
      auto pass = solver->next(done);
      if (!pass) return {};
      const auto kept = pass->plan().reads | pass->plan().writes;
      const std::string expected = first_batch(std::move(pass), *light, {pool, {}});
      EXPECT_EQ(first_batch(solver->next(done), blinded(*light, kept), {pool, {}}), expected)
          << method.name() << " after " << report.name;
      EXPECT_FALSE(expected.empty());
      seen.insert(report.name);
      return {};
    };
    ASSERT_TRUE(baker::solve(world, *solver, pool, {}, hooks));
    EXPECT_GE(seen.size(), method.adaptive ? 4u : 1u);
  }
}

}  // namespace
}  // namespace kiln::solver
