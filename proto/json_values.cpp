#include "proto/json_values.h"
#include "proto/json.h"

#include <array>
#include <charconv>
#include <cmath>
#include <nlohmann/json.hpp>

namespace kiln::proto {

double shortest_number(float v) {
  if (!std::isfinite(v)) return static_cast<double>(v);
  std::array<char, 32> text;
  const auto end = std::to_chars(text.data(), text.data() + text.size(), v).ptr;
  double result = 0;
  std::from_chars(text.data(), end, result);
  return result;
}

nlohmann::json or_null(const std::optional<double>& v) {
  return v ? nlohmann::json(*v) : nlohmann::json(nullptr);
}

std::string pointer_token(std::string_view key) {
  std::string out;
  for (const char c : key) {
    if (c == '~')
      out += "~0";
    else if (c == '/')
      out += "~1";
    else
      out += c;
  }
  return out;
}

std::string brief(std::string_view text, std::size_t bytes) {
  if (text.size() <= bytes) return std::string(text);
  const auto continues = [](char c) { return (static_cast<unsigned char>(c) & 0xC0u) == 0x80u; };
  while (bytes > 0 && continues(text[bytes])) --bytes;
  return std::string(text.substr(0, bytes)) + "...";
}

std::string brief_value(const nlohmann::json& value) {
  if (value.is_array()) {
    if (value.size() > 4) return "a list of " + std::to_string(value.size());
    std::string out;
    for (const auto& item : value) out += (out.empty() ? "" : ", ") + brief_value(item);
    return "[" + out + "]";
  }
  if (value.is_object()) return "an object";
  return brief(to_text(value));
}

}  // namespace kiln::proto
