#include <algorithm>
#include <cctype>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/json_values.h"
#include "proto/settings_schema.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

constexpr std::size_t kMaxTokens = 16;

Unexpected bad(std::string_view assignment, const std::string& why) {
  return fail("invalid_settings", "\"" + brief(assignment) + "\": " + why, "settings", "");
}

std::vector<std::string> split(std::string_view text, char at) {
  std::vector<std::string> parts;
  while (true) {
    const auto end = text.find(at);
    parts.emplace_back(text.substr(0, end));
    if (end == std::string_view::npos) return parts;
    text.remove_prefix(end + 1);
  }
}

/// Returns whether the text is a bare word or a list of them: a letter, then only characters of
/// names and lists.
bool is_bare(std::string_view text) {
  if (text.empty() || std::isalpha(static_cast<unsigned char>(text.front())) == 0) return false;
  return std::all_of(text.begin(), text.end(), [](unsigned char c) {
    return std::isalnum(c) != 0 || c == '_' || c == '-' || c == '.' || c == ',';
  });
}

bool is_of_kind(std::string_view path, ValueKind kind) {
  const auto& rows = setting_rows();
  return std::any_of(rows.begin(), rows.end(), [&](const auto& row) {
    return row.spec.path == path && row.spec.kind == kind;
  });
}

/// Reads a value: JSON or a bare word. A setting that is a list of words also takes "exr,png", and
/// a setting that is a text takes any other text.
Expected<json> value_of(std::string_view path, std::string_view text, std::string_view assignment) {
  auto value = parse_json(text, "settings");
  if (is_of_kind(path, ValueKind::kText)) {
    if (value && (value->is_string() || value->is_null())) return value;
    return json(std::string(text));
  }
  if (value) return value;
  if (!is_bare(text)) return bad(assignment, "the value is neither JSON nor a plain word");
  if (is_of_kind(path, ValueKind::kChoices)) return json(split(text, ','));
  return json(std::string(text));
}

bool is_index(const std::string& token) {
  return !token.empty() && token.size() <= 5 &&
         std::all_of(token.begin(), token.end(),
                     [](unsigned char c) { return std::isdigit(c) != 0; });
}

/// Returns the child that a token names. It is created when missing; the result is null when that
/// is impossible.
json* step(json& parent, const std::string& token) {
  if (parent.is_null()) parent = is_index(token) ? json::array() : json::object();
  if (parent.is_object()) return &parent[token];
  if (!parent.is_array() || !is_index(token)) return nullptr;
  const std::size_t index = std::stoul(token);
  if (index > parent.size()) return nullptr;
  if (index == parent.size()) parent.push_back(nullptr);
  return &parent[index];
}

}  // namespace

Expected<void> set_by_path(json& settings, std::string_view assignment) {
  const auto equals = assignment.find('=');
  if (equals == std::string_view::npos || equals == 0)
    return bad(assignment, "expected name=value, for instance solver.samples=64");
  const auto path = assignment.substr(0, equals);
  const auto tokens = split(path, '.');
  if (tokens.size() > kMaxTokens) return bad(assignment, "the name has too many parts");
  auto value = value_of(path, assignment.substr(equals + 1), assignment);
  if (!value) return Unexpected(std::move(value.error()));

  json changed = settings;  // so that a failed assignment changes nothing
  json* at = &changed;
  for (const auto& token : tokens) {
    if (token.empty()) return bad(assignment, "the name has an empty part");
    at = step(*at, token);
    if (at == nullptr)
      return bad(assignment, "\"" + brief(token) +
                                 "\" leads nowhere: the value before it is neither an object nor a "
                                 "list that reaches so far");
  }
  *at = std::move(*value);
  settings = std::move(changed);
  return {};
}

}  // namespace kiln::proto
