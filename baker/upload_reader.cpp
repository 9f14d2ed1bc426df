#include "baker/upload_reader.h"

namespace kiln::baker {

proto::Expected<Scene> InProcessReader::import(std::stop_token stop) {
  return import_files(files_, limits_, std::move(stop));
}

proto::Expected<void> InProcessReader::write_lit(const std::filesystem::path& path,
                                                const Scene& scene, const Atlas& atlas,
                                                std::span<const LitPage> pages,
                                                std::stop_token /*stop*/) {
  return write_lit_glb(path, files_, scene, atlas, pages);
}

}  // namespace kiln::baker
