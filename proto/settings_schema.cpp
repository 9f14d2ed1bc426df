#include "proto/settings_schema.h"

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <type_traits>

#include "proto/json_values.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

/// Returns a number of a range as text: 16384, 0.001, 9007199254740991.
std::string number_text(double v) {
  if (v == std::floor(v) && std::abs(v) < 1e16) return std::to_string(static_cast<std::int64_t>(v));
  return json(v).dump();
}

std::string range_text(const SettingSpec& s) {
  return "from " + number_text(s.min) + " to " + number_text(s.max);
}

std::string choices_text(const SettingSpec& s) {
  std::string out;
  for (const auto word : s.choices) out += (out.empty() ? "\"" : ", \"") + std::string(word) + "\"";
  return out;
}

bool is_integer(const json& v) {
  // 16.0 and 1e3 are integers to JSON Schema, so they are integers here.
  return v.is_number() && std::floor(v.get<double>()) == v.get<double>();
}

bool in_range(const SettingSpec& s, const json& v) {
  return v.is_number() && v.get<double>() >= s.min && v.get<double>() <= s.max;
}

bool is_choice(const SettingSpec& s, const json& v) {
  return v.is_string() && std::find(s.choices.begin(), s.choices.end(),
                                    v.get_ref<const std::string&>()) != s.choices.end();
}

bool is_vector(const SettingSpec& s, const json& v) {
  return v.is_array() && v.size() == 3 &&
         std::all_of(v.begin(), v.end(), [&](const json& x) { return in_range(s, x); });
}

bool has_length(const json& v) {
  return std::any_of(v.begin(), v.end(),
                     [](const json& x) { return std::abs(x.get<double>()) > kShortest; });
}

bool are_choices(const SettingSpec& s, const json& v) {
  if (!v.is_array() || double(v.size()) < s.min || v.size() > s.choices.size()) return false;
  std::set<std::string> seen;
  return std::all_of(v.begin(), v.end(), [&](const json& x) {
    return is_choice(s, x) && seen.insert(x.get<std::string>()).second;
  });
}

bool is_text(const SettingSpec& s, const json& v) {
  if (!v.is_string()) return false;
  const auto& text = v.get_ref<const std::string&>();
  const auto characters = std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xc0) != 0x80;  // not a continuation byte of UTF-8
  });
  return characters >= 1 && double(characters) <= s.max;
}

bool is_fine(const SettingSpec& s, const json& v) {
  if (v.is_null()) return s.nullable;
  switch (s.kind) {
    case ValueKind::kInteger:
      return is_integer(v) && in_range(s, v);
    case ValueKind::kNumber:
      return in_range(s, v);
    case ValueKind::kBoolean:
      return v.is_boolean();
    case ValueKind::kChoice:
      return is_choice(s, v);
    case ValueKind::kChoices:
      return are_choices(s, v);
    case ValueKind::kVector:
      return is_vector(s, v);
    case ValueKind::kDirection:
      return is_vector(s, v) && has_length(v);
    case ValueKind::kText:
      return is_text(s, v);
  }
  return false;
}

json vector_schema(const SettingSpec& s) {
  return {{"type", "array"},
          {"items", {{"type", "number"}, {"minimum", s.min}, {"maximum", s.max}}},
          {"minItems", 3},
          {"maxItems", 3}};
}

json bare_schema(const SettingSpec& s) {
  switch (s.kind) {
    case ValueKind::kInteger:
      return {{"type", "integer"},
              {"minimum", static_cast<std::int64_t>(s.min)},
              {"maximum", static_cast<std::int64_t>(s.max)}};
    case ValueKind::kNumber:
      return {{"type", "number"}, {"minimum", s.min}, {"maximum", s.max}};
    case ValueKind::kBoolean:
      return {{"type", "boolean"}};
    case ValueKind::kChoice:
      return {{"type", "string"}, {"enum", s.choices}};
    case ValueKind::kChoices:
      return {{"type", "array"},
              {"items", {{"type", "string"}, {"enum", s.choices}}},
              {"minItems", static_cast<std::int64_t>(s.min)},
              {"uniqueItems", true}};
    case ValueKind::kVector:
      return vector_schema(s);
    case ValueKind::kDirection: {
      json schema = vector_schema(s);
      schema["not"] = {{"items", {{"minimum", -kShortest}, {"maximum", kShortest}}}};
      return schema;
    }
    case ValueKind::kText:
      return {
          {"type", "string"}, {"minLength", 1}, {"maxLength", static_cast<std::int64_t>(s.max)}};
  }
  return {};
}

}  // namespace

std::string expectation(const SettingSpec& s) {
  const std::string or_null = s.nullable ? ", or null" : "";
  switch (s.kind) {
    case ValueKind::kInteger:
      return "an integer " + range_text(s) + or_null;
    case ValueKind::kNumber:
      return "a number " + range_text(s) + or_null;
    case ValueKind::kBoolean:
      return "true or false" + or_null;
    case ValueKind::kChoice:
      return "one of " + choices_text(s) + or_null;
    case ValueKind::kChoices:
      return (s.min > 0 ? "a list of at least one of " : "a list of any of ") + choices_text(s) +
             ", none of them twice" + or_null;
    case ValueKind::kVector:
      return "a list of three numbers " + range_text(s) + or_null;
    case ValueKind::kDirection:
      return "a list of three numbers " + range_text(s) + ", not all (nearly) zero" + or_null;
    case ValueKind::kText:
      return "a string of 1 to " + number_text(s.max) + " characters" + or_null;
  }
  return {};
}

std::optional<std::string> check_value(const SettingSpec& s, const json& value) {
  if (is_fine(s, value)) return std::nullopt;
  return "expected " + expectation(s) + (s.unit.empty() ? "" : " (" + std::string(s.unit) + ")") +
         ", found " + brief_value(value);
}

json value_schema(const SettingSpec& s) {
  json schema = bare_schema(s);
  if (s.nullable) schema["type"] = {schema["type"], "null"};
  schema["description"] = std::string(s.description);
  if (!s.unit.empty()) schema["x-unit"] = std::string(s.unit);
  return schema;
}

}  // namespace kiln::proto
