#include "baker/solver/links/links.h"

#include <algorithm>
#include <utility>

#include "baker/solver/direct/lead_passes.h"
#include "baker/solver/links/link_gatherer.h"
#include "baker/solver/pairwise/pairwise.h"

namespace kiln::solver::links {
namespace {

using enum lightmap::PlaneId;

/// A Cornell box takes about so many rays a texel with the defaults (1,400 with 2,715 texels, 2,800
/// with 40,956), and most scenes so many bounces; for estimates of work only.
constexpr double kTypicalRays = 2000;
constexpr std::uint32_t kTypicalBounces = 10;
/// Texels of a batch. Receivers that two batches share have their links found twice.
constexpr std::uint32_t kBatchTexels = 1024;
/// Groups that a thread sums up at a time.
constexpr std::uint32_t kRunGroups = 64;

class LinkPass final : public Pass {
 public:
  LinkPass(const pairwise::Parts& parts, const LinkTree& tree, PassPlan plan)
      : Pass(std::move(plan)), parts_(parts), tree_(tree) {
    plan_.reads = lightmap::plane_set({kDirect, kSky, kIndirect});
    plan_.writes = lightmap::plane_set({kIndirect});
    plan_.work = Work::directions(kTypicalRays);
    plan_.batch_texels = parts.world.settings.batch_texels.value_or(kBatchTexels);
  }

  bool prepare(const lightmap::Lightmap& before, const exec::Workers& workers) override {
    const pairwise::TexelLight sent(parts_, before);
    light_.texels = sent.radiosity;
    light_.most_error = parts_.world.settings.link_error * sent.mean_direct;
    light_.groups.resize(tree_.groups());
    return workers.for_runs(tree_.groups(), kRunGroups, [&](auto begin, auto end) {
      for (std::uint32_t g = begin; g < end; ++g) light_.groups[g] = mean(g);
    });
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap&,
                    const lightmap::LightmapView& after) const override {
    LinkGatherer gatherer(parts_, tree_, light_, range);
    gatherer.gather();
    for (std::uint32_t t = range.begin; t < range.end; ++t) after.indirect[t] = gatherer.light(t);
    return gatherer.rays();
  }

 private:
  math::Rgb mean(std::uint32_t group) const {
    pairwise::Sum sum;
    double area = 0;
    for (const std::uint32_t t : tree_.texels(group)) {
      const float a = parts_.patches.area_m2(t);
      sum += light_.texels[t] * a;
      area += double(a);
    }
    return area > 0 ? sum.rgb() * float(1 / area) : math::Rgb{};
  }

  const pairwise::Parts& parts_;
  const LinkTree& tree_;
  LinkLight light_;
};

class LinksSolver final : public Solver {
 public:
  explicit LinksSolver(const World& world)
      : world_(world), passes_(world_), parts_(world_), tree_(world_.texels, parts_.patches) {}

  std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const override {
    return direct::next_pass(world_, passes_, done, [&](PassPlan plan) {
      return std::make_unique<LinkPass>(parts_, tree_, std::move(plan));
    });
  }

  Forecast forecast() const override {
    const std::uint32_t bounces = std::min(kTypicalBounces, passes_.bounces());
    return {passes_.most(), direct::lead_work(world_) + Work::directions(kTypicalRays) * bounces};
  }
  const SamplePlan& samples() const override { return world_.plan; }

 private:
  const World world_;
  const BouncePasses passes_;
  const pairwise::Parts parts_;
  const LinkTree tree_;
};

}  // namespace

double links_memory(const proto::SolverSettings& settings, double texels) {
  constexpr double kGroups = 0.6;  // of texels, see LinkTree::memory_per_texel()
  return texels * (LinkTree::memory_per_texel() + (1 + kGroups) * sizeof(math::Rgb) +
                   pairwise::pairwise_memory_per_texel(settings)) +
         pairwise::pairwise_extra_memory(settings, texels);
}

std::unique_ptr<Solver> make_links_solver(const World& world) {
  return std::make_unique<LinksSolver>(world);
}

}  // namespace kiln::solver::links
