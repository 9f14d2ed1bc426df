// The registry of methods is what the settings offer, and each method keeps its own promises.
#include "baker/methods.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

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
                                                 id == lightmap::PlaneId::kHits);
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

}  // namespace
}  // namespace kiln::solver
