#include "baker/gltf/uri.h"

#include <algorithm>
#include <vector>

#include "baker/gltf/json.h"
#include "proto/text_codes.h"

namespace kiln::gltf {
namespace {

char lower(char c) {
  return c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
}

std::string to_lower(std::string_view s) {
  std::string out(s);
  std::transform(out.begin(), out.end(), out.begin(), lower);
  return out;
}

std::string_view last_component(std::string_view path) {
  const auto slash = path.find_last_of("/\\");
  return slash == std::string_view::npos ? path : path.substr(slash + 1);
}

/// Says why the decoded URI may not be followed; "" when it may.
std::string refusal(std::string_view name) {
  if (name.empty()) return "is empty";
  for (const char c : name) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) return "holds control characters";
  }
  if (name.front() == '/' || name.front() == '\\') return "is absolute";
  if (name.find('\\') != std::string_view::npos) return "holds a backslash";
  if (name.substr(0, name.find('/')).find(':') != std::string_view::npos) {
    return "names a scheme or a drive";
  }
  for (std::size_t begin = 0; begin <= name.size();) {
    const auto end = std::min(name.find('/', begin), name.size());
    if (name.substr(begin, end - begin) == "..") return "leaves its folder";
    begin = end + 1;
  }
  return "";
}

std::string quoted(std::string_view uri) {
  std::string out = "\"";
  out += shortened(uri);
  out += '"';
  return out;
}

}  // namespace

bool is_data_uri(std::string_view uri) {
  return to_lower(uri.substr(0, 5)) == "data:";
}

proto::Expected<DataUri> decode_data_uri(std::string_view uri, const std::string& pointer) {
  const auto fail = [&](const char* why) {
    return proto::fail("invalid_scene", std::string("the data URI ") + why, "scene", pointer);
  };
  const auto comma = uri.find(',');
  if (!is_data_uri(uri) || comma == std::string_view::npos)
    return fail("has no comma before its data");
  const std::string header = to_lower(uri.substr(5, comma - 5));
  DataUri out;
  out.mime_type = header.substr(0, header.find(';'));
  const bool base64 = header.ends_with(";base64");
  auto bytes = base64 ? proto::base64_decode(uri.substr(comma + 1))
                      : proto::percent_decode(uri.substr(comma + 1));
  if (!bytes) return fail(base64 ? "is not valid base64" : "has a broken percent escape");
  out.bytes = std::move(*bytes);
  return out;
}

proto::Expected<std::string> relative_file_name(std::string_view uri, const std::string& pointer) {
  auto name = proto::percent_decode(uri);
  std::string why = name ? refusal(*name) : "has a broken percent escape";
  if (!why.empty()) {
    return proto::fail(
        "invalid_scene",
        "the URI " + quoted(uri) + " " + why + "; expected a file of the same upload", "scene",
        pointer);
  }
  while (name->starts_with("./")) name->erase(0, 2);
  return *name;
}

proto::Expected<std::filesystem::path> find_side_file(const files::SceneFiles& files,
                                                      std::string_view uri,
                                                      const std::string& pointer) {
  const auto name = relative_file_name(uri, pointer);
  if (!name) return proto::Unexpected(name.error());
  return find_named_file(files, *name, "scene", pointer);
}

proto::Expected<std::filesystem::path> find_named_file(const files::SceneFiles& files,
                                                       std::string_view name, const char* where,
                                                       const std::string& pointer) {
  const auto exact = files.side.find(std::string(name));
  if (exact != files.side.end()) return exact->second;
  const std::string_view last = last_component(name);
  std::vector<const std::filesystem::path*> found;
  for (const auto& [key, path] : files.side) {
    if (!last.empty() && last_component(key) == last) found.push_back(&path);
  }
  if (found.size() == 1) return *found.front();
  return proto::fail("missing_file",
                     found.empty() ? "the scene needs " + quoted(name) + ", which was not uploaded"
                                   : quoted(name) + " fits several uploaded files",
                     where, pointer);
}

}  // namespace kiln::gltf
