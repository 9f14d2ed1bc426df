#include "baker/scene/gltf_json.h"

#include <algorithm>
#include <nlohmann/json.hpp>

namespace kiln::baker {
namespace {

constexpr std::size_t kMaxDepth = 128, kMaxValues = 16'000'000;

struct JsonSize {
  std::size_t depth = 0, values = 0;
};

/// Deepest nesting and number of values, by brackets and commas outside strings.
JsonSize measure(std::string_view text) {
  JsonSize size;
  std::size_t depth = 0;
  bool in_string = false;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    if (in_string) {
      if (c == '\\') ++i;
      if (c == '"') in_string = false;
      continue;
    }
    if (c == '"') in_string = true;
    if (c == '{' || c == '[') size.depth = std::max(size.depth, ++depth);
    if ((c == '}' || c == ']') && depth > 0) --depth;
    if (c == '{' || c == '[' || c == ',') ++size.values;
  }
  return size;
}

std::string line_and_column(std::string_view text, std::size_t byte) {
  const auto before = text.substr(0, std::min(byte, text.size()));
  const auto line = 1 + std::count(before.begin(), before.end(), '\n');
  const auto newline = before.rfind('\n');
  const auto column =
      newline == std::string_view::npos ? before.size() : before.size() - newline - 1;
  return "line " + std::to_string(line) + ", column " + std::to_string(column);
}

}  // namespace

std::string pointer_to(const std::string& parent, std::size_t index) {
  return parent + "/" + std::to_string(index);
}

std::string pointer_to(const std::string& parent, std::string_view key) {
  std::string out = parent + "/";
  for (const char c : key) {
    if (c == '~') {
      out += "~0";
    } else if (c == '/') {
      out += "~1";
    } else {
      out += c;
    }
  }
  return out;
}

std::string shortened(std::string_view text, std::size_t max) {
  std::string out(text.substr(0, max));
  if (text.size() > max) {
    const auto is_continuation = [](char c) {
      return (static_cast<unsigned char>(c) & 0xc0) == 0x80;
    };
    std::size_t end = max;
    while (end > 0 && is_continuation(text[end])) --end;
    out.resize(end);
    out += "...";
  }
  for (char& c : out) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = ' ';
  }
  return out;
}

proto::Expected<nlohmann::json> parse_gltf_json(std::string_view text) {
  const JsonSize size = measure(text);
  if (size.depth > kMaxDepth) {
    return proto::fail("limit_exceeded", "the JSON is nested deeper than 128 levels", "scene", "");
  }
  if (size.values > kMaxValues) {
    return proto::fail("limit_exceeded", "the JSON holds more than 16 million values", "scene", "");
  }
  try {
    auto document = nlohmann::json::parse(text);
    if (document.is_object()) return document;
    return proto::fail("invalid_scene", "the glTF document is not a JSON object", "scene", "");
  } catch (const nlohmann::json::parse_error& e) {  // the library has no other way to tell where
    return proto::fail("invalid_scene", "not valid JSON at " + line_and_column(text, e.byte),
                       "scene", "");
  } catch (const nlohmann::json::out_of_range&) {
    return proto::fail("invalid_scene", "the JSON holds a number that is not finite", "scene", "");
  }
}

}  // namespace kiln::baker
