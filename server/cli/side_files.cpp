#include "server/cli/side_files.h"

#include <algorithm>
#include <fstream>
#include <optional>

#include "baker/files/mapped_file.h"
#include "baker/gltf/document.h"
#include "baker/reference.h"

namespace kiln::cli {
namespace {

namespace fs = std::filesystem;

/// Returns the file that a relative URI names, if it lies in the folder after links are followed.
std::optional<fs::path> inside(const fs::path& folder, const std::string& name) {
  if (name.empty() || name.find('\0') != name.npos || fs::path(name).is_absolute()) return {};
  std::error_code error;
  const fs::path root = fs::canonical(folder, error);
  if (error) return {};
  const fs::path file = fs::canonical(root / name, error);
  if (error || !fs::is_regular_file(file, error)) return {};
  const auto [end, rest] = std::mismatch(root.begin(), root.end(), file.begin(), file.end());
  return end == root.end() ? std::optional(file) : std::nullopt;
}

fs::path folder_of(const fs::path& scene) {
  return scene.has_parent_path() ? scene.parent_path() : fs::path(".");
}

}  // namespace

SideFiles find_side_files(const fs::path& scene) {
  SideFiles out;
  const auto file = files::MappedFile::open(scene, files::MappedFile::kAnyLength);
  if (!file) return out;
  const gltf::Needs needs = gltf::find_needs(file->bytes(), {});
  out.images = needs.images;
  for (const std::string& name : needs.side_files)
    if (auto path = inside(folder_of(scene), name)) out.files.emplace(name, std::move(*path));
  return out;
}

proto::Expected<SideFiles> all_side_files(const fs::path& scene,
                                          const std::vector<std::string>& named,
                                          const std::optional<std::string>& sky_map,
                                          const proto::ReportSettings& report) {
  SideFiles out = find_side_files(scene);
  auto beside = std::move(out.files);
  out.files.clear();
  out.images = out.images || sky_map.has_value();
  for (const auto& text : named) {
    const fs::path path(text);
    std::error_code error;
    if (!fs::is_regular_file(path, error) || !std::ifstream(path))
      return proto::fail("missing_file", "can't read " + text);
    if (!out.files.emplace(path.filename().string(), path).second)
      return proto::fail("missing_file",
                         "two side files are named \"" + path.filename().string() + "\"");
  }
  if (sky_map)
    if (auto file = inside(folder_of(scene), *sky_map)) beside.emplace(*sky_map, std::move(*file));
  if (report.against && !report.method())
    for (std::uint32_t page = 0; page < proto::AtlasSettings::kMostPages; ++page) {
      const auto name = baker::page_file_name(*report.against, page);
      auto file = name ? inside(folder_of(scene), *name) : std::nullopt;
      if (!file) break;
      beside.emplace(*name, std::move(*file));
    }
  for (auto& [name, path] : beside) {
    const std::string last = fs::path(name).filename().string();
    if (!out.files.count(name) && !(out.files.count(last) && last != name))
      out.files.emplace(name, path);
  }
  return out;
}

}  // namespace kiln::cli
