#include "baker/upload_reader.h"

#include "baker/output/lit/lit_glb.h"

namespace kiln::baker {

proto::Expected<scene::Scene> InProcessReader::import(std::stop_token stop) {
  return import::import_files(files_, limits_, std::move(stop));
}

proto::Expected<void> InProcessReader::write_lit(const std::filesystem::path& path,
                                                 const scene::Scene& scene,
                                                 const atlas::Atlas& atlas,
                                                 const output::LitPages& pages,
                                                 std::stop_token /*stop*/) {
  return output::lit::write_lit_glb(path, files_, scene, atlas, pages, limits_);
}

}  // namespace kiln::baker
