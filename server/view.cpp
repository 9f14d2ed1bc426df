#include "server/view.h"

#include <string>
#include <utility>

#include "baker/image/page_image.h"
#include "baker/view/view.h"

namespace kiln::server {
namespace {

using proto::Unexpected;

proto::Expected<std::string> draw(const sandbox::Importer& importer, base::MemoryBudget& memory,
                                  const api::ViewInput& input, exec::ThreadPool& pool,
                                  const std::stop_token& stop) {
  const auto manifest = view::read_manifest(input.folder);
  if (!manifest) return Unexpected(manifest.error());
  const auto scene =
      importer.open({input.folder / "lit.glb", {}, {}}, input.lit_sha256, {})->import(stop);
  if (!scene) return Unexpected(scene.error());
  const auto loan = memory.borrow(view::memory_bytes(*scene, *manifest, input.request));
  if (!loan)
    return proto::fail("overloaded",
                       "The view needs more memory than the jobs that run have left: ask again "
                       "later, or for a smaller picture.");
  const auto picture =
      view::draw(input.folder, *manifest, *scene, view::SceneKind::kLit, input.request, pool, stop);
  if (!picture) return Unexpected(picture.error());
  return image::encode_png(picture->pixels, picture->width, picture->height);
}

}  // namespace

api::ViewFunction make_view(std::shared_ptr<const sandbox::Importer> importer,
                            std::shared_ptr<base::MemoryBudget> memory) {
  return [importer = std::move(importer), memory = std::move(memory)](
             const api::ViewInput& input, exec::ThreadPool& pool, const std::stop_token& stop) {
    return draw(*importer, *memory, input, pool, stop);
  };
}

}  // namespace kiln::server
