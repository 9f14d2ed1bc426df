#include "server/cli/side_files.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <nlohmann/json.hpp>
#include <optional>

#include "proto/json.h"

namespace kiln::cli {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kMaxJsonBytes = 256ull << 20;

std::uint32_t little_endian(const char* p) {
  std::uint32_t v = 0;
  for (int i = 3; i >= 0; --i) v = v << 8 | static_cast<unsigned char>(p[i]);
  return v;
}

/// Returns the JSON of a .gltf, or the first chunk of a .glb, or "" when the file can't be read or
/// is too large.
std::string json_text(const fs::path& scene) {
  std::error_code error;
  std::uint64_t bytes = fs::file_size(scene, error);
  std::ifstream in(scene, std::ios::binary);
  if (error || !in) return {};
  std::array<char, 20> head{};
  in.read(head.data(), head.size());
  const bool binary = in.gcount() == 20 && std::string_view(head.data(), 4) == "glTF";
  if (binary) bytes = std::min<std::uint64_t>(little_endian(head.data() + 12), bytes - head.size());
  if (bytes > kMaxJsonBytes) return {};
  in.clear();
  in.seekg(binary ? 20 : 0);
  std::string text(bytes, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  return static_cast<std::uint64_t>(in.gcount()) == bytes ? text : std::string();
}

std::optional<std::string> percent_decoded(std::string_view uri) {
  const auto digit = [](char c) -> int {
    if (c >= '0' && c <= '9') return c - '0';
    if (c >= 'a' && c <= 'f') return c - 'a' + 10;
    if (c >= 'A' && c <= 'F') return c - 'A' + 10;
    return -1;
  };
  std::string out;
  for (std::size_t i = 0; i < uri.size(); ++i) {
    if (uri[i] != '%') {
      out += uri[i];
      continue;
    }
    const int high = i + 2 < uri.size() ? digit(uri[i + 1]) : -1;
    const int low = i + 2 < uri.size() ? digit(uri[i + 2]) : -1;
    if (high < 0 || low < 0) return {};
    out += static_cast<char>(high * 16 + low);
    i += 2;
  }
  return out;
}

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

bool has_scheme(std::string_view uri) {
  const auto colon = uri.find(':');
  return colon != uri.npos && uri.substr(0, colon).find('/') == uri.npos;
}

fs::path folder_of(const fs::path& scene) {
  return scene.has_parent_path() ? scene.parent_path() : fs::path(".");
}

}  // namespace

SideFiles find_side_files(const fs::path& scene) {
  SideFiles out;
  const fs::path folder = folder_of(scene);
  const auto doc = proto::parse_json(json_text(scene), "scene");
  if (!doc || !doc->is_object()) return out;
  for (const char* list : {"buffers", "images"}) {
    if (!doc->contains(list) || !doc->at(list).is_array()) continue;
    for (const auto& item : doc->at(list)) {
      if (!item.is_object() || !item.contains("uri") || !item["uri"].is_string()) continue;
      const auto& uri = item["uri"].get_ref<const std::string&>();
      if (has_scheme(uri)) continue;
      const auto name = percent_decoded(uri);
      if (!name) continue;
      if (auto file = inside(folder, *name)) out.emplace(*name, std::move(*file));
    }
  }
  return out;
}

proto::Expected<SideFiles> all_side_files(const fs::path& scene,
                                          const std::vector<std::string>& named,
                                          const std::optional<std::string>& sky_map) {
  SideFiles out;
  for (const auto& text : named) {
    const fs::path path(text);
    std::error_code error;
    if (!fs::is_regular_file(path, error) || !std::ifstream(path))
      return proto::fail("missing_file", "can't read " + text);
    if (!out.emplace(path.filename().string(), path).second)
      return proto::fail("missing_file",
                         "two side files are named \"" + path.filename().string() + "\"");
  }
  SideFiles beside = find_side_files(scene);
  if (sky_map)
    if (auto file = inside(folder_of(scene), *sky_map)) beside.emplace(*sky_map, std::move(*file));
  for (auto& [name, path] : beside) {
    const std::string last = fs::path(name).filename().string();
    if (!out.count(name) && !(out.count(last) && last != name)) out.emplace(name, path);
  }
  return out;
}

}  // namespace kiln::cli
