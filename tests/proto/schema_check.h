#pragma once

#include <regex.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <set>
#include <stdexcept>
#include <string>

namespace kiln::proto {

/// An independent, small validator for the parts of JSON Schema 2020-12 that our schemas are made
/// of, with their references resolved. Throws on a keyword it does not know, so that nothing is
/// taken for granted.
inline bool accepts(const nlohmann::json& schema, const nlohmann::json& v);

/// Our patterns mean the same to POSIX as to JSON Schema. (std::regex can't be used: once it is
/// instrumented by a sanitizer, GCC takes parts of it for uninitialized.)
inline bool matches(const std::string& text, const std::string& pattern) {
  regex_t compiled;
  if (::regcomp(&compiled, pattern.c_str(), REG_EXTENDED | REG_NOSUB) != 0)
    throw std::logic_error("no pattern: " + pattern);
  const bool found = ::regexec(&compiled, text.c_str(), 0, nullptr, 0) == 0;
  ::regfree(&compiled);
  return found;
}

inline bool has_type(const std::string& type, const nlohmann::json& v) {
  if (type == "object") return v.is_object();
  if (type == "array") return v.is_array();
  if (type == "string") return v.is_string();
  if (type == "boolean") return v.is_boolean();
  if (type == "null") return v.is_null();
  if (type == "number") return v.is_number();
  if (type == "integer") return v.is_number() && v.get<double>() == std::floor(v.get<double>());
  throw std::logic_error("unknown type " + type);
}

inline bool properties_fit(const nlohmann::json& schema, const nlohmann::json& v) {
  const nlohmann::json none = nlohmann::json::object(), any = true;
  const auto member = [&](const char* name, const nlohmann::json& otherwise) {
    const auto found = schema.find(name);
    return found == schema.end() ? otherwise : *found;
  };
  const nlohmann::json known = member("properties", none);
  const nlohmann::json others = member("additionalProperties", any);
  for (const auto& [key, value] : v.items()) {
    const auto own = known.find(key);
    const nlohmann::json& rule = own == known.end() ? others : *own;
    if (rule.is_boolean() ? !rule.get<bool>() : !accepts(rule, value)) return false;
  }
  return true;
}

inline bool keyword_fits(const nlohmann::json& schema, const std::string& keyword,
                         const nlohmann::json& rule, const nlohmann::json& v) {
  if (keyword == "type") {
    if (rule.is_string()) return has_type(rule, v);
    return std::any_of(rule.begin(), rule.end(),
                       [&](const nlohmann::json& t) { return has_type(t, v); });
  }
  if (keyword == "const") return v == rule;
  if (keyword == "enum") return std::find(rule.begin(), rule.end(), v) != rule.end();
  if (keyword == "minimum") return !v.is_number() || v.get<double>() >= rule.get<double>();
  if (keyword == "maximum") return !v.is_number() || v.get<double>() <= rule.get<double>();
  if (keyword == "maxLength")
    return !v.is_string() || v.get_ref<const std::string&>().size() <= rule.get<std::size_t>();
  if (keyword == "minLength")
    return !v.is_string() || v.get_ref<const std::string&>().size() >= rule.get<std::size_t>();
  if (keyword == "minItems") return !v.is_array() || v.size() >= rule.get<std::size_t>();
  if (keyword == "maxItems") return !v.is_array() || v.size() <= rule.get<std::size_t>();
  if (keyword == "uniqueItems")
    return !v.is_array() || std::set<nlohmann::json>(v.begin(), v.end()).size() == v.size();
  if (keyword == "items")
    return !v.is_array() || std::all_of(v.begin(), v.end(), [&](const nlohmann::json& item) {
      return accepts(rule, item);
    });
  if (keyword == "not") return !accepts(rule, v);
  if (keyword == "oneOf")
    return std::count_if(rule.begin(), rule.end(),
                         [&](const nlohmann::json& option) { return accepts(option, v); }) == 1;
  if (keyword == "properties" || keyword == "additionalProperties")
    return !v.is_object() || properties_fit(schema, v);
  if (keyword == "maxProperties") return !v.is_object() || v.size() <= rule.get<std::size_t>();
  if (keyword == "pattern")
    return !v.is_string() || matches(v.get<std::string>(), rule.get<std::string>());
  if (keyword == "required")
    return !v.is_object() || std::all_of(rule.begin(), rule.end(), [&](const nlohmann::json& key) {
      return v.contains(key.get<std::string>());
    });
  static const std::set<std::string> notes{"default", "description", "title",
                                           "x-unit",  "x-methods",   "$schema",
                                           "$id",     "format",      "contentMediaType"};
  if (notes.count(keyword) == 0) throw std::logic_error("unknown keyword " + keyword);
  return true;
}

inline bool accepts(const nlohmann::json& schema, const nlohmann::json& v) {
  for (const auto& [keyword, rule] : schema.items())
    if (!keyword_fits(schema, keyword, rule, v)) return false;
  return true;
}

}  // namespace kiln::proto
