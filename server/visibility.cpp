#include "server/visibility.h"

#include <chrono>
#include <utility>

#include "baker/exec/cpu_time.h"
#include "baker/files/mapped_file.h"
#include "baker/visibility/pairs.h"
#include "server/ready_scenes.h"

namespace kiln::server {
namespace {

using proto::Expected;
using proto::Unexpected;
using Clock = std::chrono::steady_clock;

double seconds_since(Clock::time_point began) {
  return std::chrono::duration<double>(Clock::now() - began).count();
}

/// Reads a scene and builds its tree. The scene's own memory is taken until the tree is there.
Expected<trace::RayScene> make_ready(const sandbox::Importer& importer,
                                     const data::StoredScene& stored,
                                     const ReadyScenes::Reserve& reserve,
                                     const std::stop_token& stop) {
  const auto scene =
      importer.open(stored.files, stored.key, stored.files.main.parent_path())->import(stop);
  if (!scene) return Unexpected(scene.error());
  if (!reserve(scene::memory_bytes(*scene) + trace::RayScene::build_bytes(*scene)))
    return proto::fail("overloaded",
                       "The scene needs more memory than the jobs that run have left: ask again "
                       "later.");
  return trace::RayScene::build(*scene, stop);
}

Expected<api::VisibilityAnswer> answer(const sandbox::Importer& importer, ReadyScenes& scenes,
                                       const api::VisibilityInput& input,
                                       const exec::Workers& workers, double& cpu_seconds) {
  const auto pairs = files::MappedFile::map(
      input.pairs, "pairs", std::uint64_t{visibility::kMostPairs} * visibility::kPairBytes);
  if (!pairs) return Unexpected(pairs.error());
  if (auto ok = visibility::check_pairs(pairs->bytes(), workers); !ok)
    return Unexpected(ok.error());
  const auto began = Clock::now();
  const double cpu_before = exec::thread_seconds();
  const auto scene = scenes.get(
      input.scene.key,
      [&](const ReadyScenes::Reserve& reserve, const std::stop_token& stop) {
        return make_ready(importer, input.scene, reserve, stop);
      },
      workers.stop);
  cpu_seconds += exec::thread_seconds() - cpu_before;
  if (!scene) return Unexpected(scene.error());
  const auto ready = Clock::now();
  auto seen = visibility::see(*scene->rays, pairs->bytes(), workers);
  if (!seen) return Unexpected(seen.error());
  cpu_seconds += seen->cpu_seconds;
  return api::VisibilityAnswer{std::move(seen->bits),
                               pairs->bytes().size() / visibility::kPairBytes,
                               seen->visible,
                               scene->was_ready,
                               std::chrono::duration<double>(ready - began).count(),
                               seconds_since(ready)};
}

}  // namespace

api::VisibilityFunction make_visibility(std::shared_ptr<const sandbox::Importer> importer,
                                        std::shared_ptr<base::MemoryBudget> memory,
                                        std::uint64_t most_kept) {
  return
      [importer = std::move(importer), scenes = ReadyScenes::create(std::move(memory), most_kept)](
          const api::VisibilityInput& input, exec::ThreadPool& pool, const std::stop_token& stop) {
        double cpu_seconds = 0;
        auto result = answer(*importer, *scenes, input, {pool, stop}, cpu_seconds);
        return api::VisibilityResult{std::move(result), cpu_seconds};
      };
}

}  // namespace kiln::server
