#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

#include "proto/json_values.h"
#include "proto/problem_list.h"

/// Reads members of one JSON object, and collects those that are missing or of the wrong type. It
/// is for proto's own .cpp files.
namespace kiln::proto {

class JsonReader {
 public:
  JsonReader(const nlohmann::json& doc, std::string pointer, ProblemList& problems)
      : doc_(doc), pointer_(std::move(pointer)), problems_(problems) {
    if (!doc.is_object()) problems_.add(pointer_, "expected an object, found " + brief_value(doc));
  }

  void read(const char* key, std::string& out) { take<std::string>(key, out, "a string"); }
  void read(const char* key, double& out) { take<double>(key, out, "a number"); }
  void read(const char* key, float& out) { take<float>(key, out, "a number"); }
  void read(const char* key, std::uint32_t& out) { integer(key, out); }
  void read(const char* key, std::uint64_t& out) { integer(key, out); }

  /// Reads a member that documents of earlier versions lack.
  template <class T>
  void read_if_there(const char* key, T& out) {
    if (doc_.contains(key)) read(key, out);
  }

  /// Reads a string; null is read as "".
  void read_or_null(const char* key, std::string& out) {
    const auto* value = find(key);
    if (value != nullptr && value->is_null()) return out.clear();
    read(key, out);
  }

  void read(const char* key, std::optional<double>& out) {
    const auto* value = find(key);
    if (value == nullptr || value->is_null()) return out.reset();
    double number = 0;
    read(key, number);
    out = number;
  }

  void read(const char* key, std::array<float, 2>& out) {
    const auto* value = find(key);
    if (value == nullptr) return;
    if (!value->is_array() || value->size() != 2 || !(*value)[0].is_number() ||
        !(*value)[1].is_number())
      return wrong(key, "two numbers", *value);
    out = {(*value)[0].get<float>(), (*value)[1].get<float>()};
  }

  /// Calls `one(reader, item)` for each object of a list.
  template <class T, class One>
  void read_list(const char* key, std::vector<T>& out, const One& one) {
    const auto* value = find(key);
    if (value == nullptr) return;
    if (!value->is_array()) return wrong(key, "a list", *value);
    for (std::size_t i = 0; i < value->size(); ++i) {
      JsonReader item((*value)[i], pointer_of(key) + "/" + std::to_string(i), problems_);
      one(item, out.emplace_back());
    }
  }

  /// Returns a reader for a member that is an object.
  JsonReader child(const char* key) {
    static const nlohmann::json empty = nlohmann::json::object();
    const auto* value = find(key);
    return {value == nullptr ? empty : *value, pointer_of(key), problems_};
  }

  /// Returns the member. When it is missing, adds a problem and returns null.
  const nlohmann::json* find(const char* key) {
    if (!doc_.is_object()) return nullptr;
    const auto at = doc_.find(key);
    if (at != doc_.end()) return &*at;
    problems_.add(pointer_of(key), "missing");
    return nullptr;
  }

  void wrong(const char* key, const std::string& expected, const nlohmann::json& found) {
    problems_.add(pointer_of(key), "expected " + expected + ", found " + brief_value(found));
  }

 private:
  const nlohmann::json& doc_;
  std::string pointer_;
  ProblemList& problems_;

  std::string pointer_of(const char* key) const { return pointer_ + "/" + pointer_token(key); }

  template <class T>
  void take(const char* key, T& out, const char* expected) {
    const auto* value = find(key);
    if (value == nullptr) return;
    const bool fits = std::is_same_v<T, std::string> ? value->is_string() : value->is_number();
    if (!fits) return wrong(key, expected, *value);
    value->get_to(out);
  }

  template <class T>
  void integer(const char* key, T& out) {
    const auto* value = find(key);
    if (value == nullptr) return;
    if (!value->is_number_unsigned() || value->get<std::uint64_t>() > std::numeric_limits<T>::max())
      return wrong(key, "an integer from 0", *value);
    out = value->get<T>();
  }
};

}  // namespace kiln::proto
