#include <algorithm>
#include <cmath>
#include <cstdint>
#include <nlohmann/json.hpp>
#include <span>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "baker/exec/stop.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/json.h"
#include "baker/gltf/schema.h"

namespace kiln::gltf {
namespace {

/// Walks document and tables together; stops at the first wrong place. Where it is in the document
/// is kept as a path, since a pointer's text is needed only when something is wrong.
class Checker {
 public:
  Checker(const Json& root, const std::stop_token& stop) : root_(root), stopped_(stop) {}

  proto::Expected<void> run() {
    if (!check_object(root_, gltf_fields())) return proto::Unexpected(error_);
    return {};
  }

 private:
  struct Step {
    std::string_view key;
    std::size_t index = 0;  ///< when key has no data
  };

  bool wrong(const std::string& what) {
    std::string pointer;
    for (const Step& step : path_) {
      pointer = step.key.data() ? pointer_to(pointer, step.key) : pointer_to(pointer, step.index);
    }
    error_ = invalid(what, pointer).value();
    return false;
  }

  template <class Check>
  bool within(Step step, Check check) {
    if (stopped_()) {
      error_ = exec::canceled().value();
      return false;
    }
    path_.push_back(step);
    const bool fine = check();
    path_.pop_back();
    return fine;
  }

  template <class Check>
  bool each(const Json& array, Check check) {
    if (!array.is_array()) return wrong("expected an array");
    for (std::size_t i = 0; i < array.size(); ++i) {
      if (!within({{}, i}, [&] { return check(array[i]); })) return false;
    }
    return true;
  }

  template <class Check>
  bool each_member(const Json& value, Check check) {
    if (!value.is_object()) return wrong("expected an object");
    for (auto& [key, member] : value.get_ref<const Json::object_t&>()) {
      if (!within({key}, [&, &m = member] { return check(m); })) return false;
    }
    return true;
  }

  bool check_object(const Json& value, std::span<const Field> fields) {
    if (!value.is_object()) return wrong("expected an object");
    const auto& members = value.get_ref<const Json::object_t&>();
    for (const Field& field : fields) {
      const auto member = std::find_if(members.begin(), members.end(),
                                       [&](const auto& m) { return m.first == field.name; });
      if (member != members.end()) {
        if (!within({field.name}, [&] { return check(member->second, field); })) return false;
      } else if (field.required) {
        return wrong("misses the required property \"" + std::string(field.name) + "\"");
      }
    }
    return true;
  }

  /// Ends that only stand for what a type can hold are left out of the message.
  bool out_of_range(double low, double high) {
    const auto number = [](double v) {
      return v == std::trunc(v) ? Json(static_cast<std::int64_t>(v)).dump() : Json(v).dump();
    };
    if (low <= -kMaxSize && high >= kMaxSize) return wrong("is too large a number");
    if (high >= kMaxOffset) return wrong("is out of range: expected at least " + number(low));
    return wrong("is out of range: expected " + number(low) + " to " + number(high));
  }

  bool check_integer(const Json& value, double low, double high) {
    if (!value.is_number()) return wrong("expected an integer");
    const double v = value.get<double>();
    if (std::abs(v) > kMaxSize) return out_of_range(low, high);
    if (std::trunc(v) != v) return wrong("expected an integer");
    return (v >= low && v <= high) || out_of_range(low, high);
  }

  bool check_number(const Json& value, const Field& f) {
    if (!value.is_number()) return wrong("expected a number");
    const double v = value.get<double>();
    return (v >= f.low && v <= f.high) || out_of_range(f.low, f.high);
  }

  bool check_numbers(const Json& value, const Field& f) {
    if (value.is_array() && f.length != 0 && value.size() != f.length) {
      return wrong("expected an array of " + std::to_string(f.length) + " numbers");
    }
    return each(value, [&](const Json& element) { return check_number(element, f); });
  }

  /// Returns the elements of a collection; a value that is no array has none.
  std::size_t size_of(const char* target) {
    if (target != size_target_) {  // runs of the same target are the rule
      const Json::json_pointer place{std::string(target)};
      const bool is_array = root_.contains(place) && root_.at(place).is_array();
      size_ = is_array ? root_.at(place).size() : 0;
      size_target_ = target;
    }
    return size_;
  }

  bool check_index(const Json& value, const char* target) {
    if (!check_integer(value, -kMaxSize, kMaxSize)) return false;
    const double size = static_cast<double>(size_of(target));
    const double v = value.get<double>();
    return (v >= 0 && v < size) || wrong("is the index " + value.dump() + ", but " + target +
                                         " has " + std::to_string(size_of(target)) + " elements");
  }

  bool check_word(const Json& value, const char* words) {
    if (!value.is_string()) return wrong("expected a string");
    std::istringstream list(words);
    for (std::string w; list >> w;) {
      if (value.get_ref<const std::string&>() == w) return true;
    }
    return wrong(std::string("expected one of ") + words);
  }

  bool check_index_map(const Json& value, const char* target) {
    return each_member(value, [&](const Json& member) { return check_index(member, target); });
  }

  bool check(const Json& value, const Field& f) {
    switch (f.kind) {
      case Kind::kBool:
        return value.is_boolean() || wrong("expected true or false");
      case Kind::kString:
        return value.is_string() || wrong("expected a string");
      case Kind::kWord:
        return check_word(value, f.target);
      case Kind::kInteger:
        return check_integer(value, f.low, f.high);
      case Kind::kNumber:
        return check_number(value, f);
      case Kind::kNumbers:
        return check_numbers(value, f);
      case Kind::kIndex:
        return check_index(value, f.target);
      case Kind::kIndexMap:
        return check_index_map(value, f.target);
      case Kind::kIntegerMap:
        return each_member(value, [&](const Json& m) { return check_integer(m, f.low, f.high); });
      case Kind::kObject:
        return check_object(value, f.fields);
      case Kind::kStrings:
        return each(value,
                    [&](const Json& e) { return e.is_string() || wrong("expected a string"); });
      case Kind::kIndices:
        return each(value, [&](const Json& e) { return check_index(e, f.target); });
      case Kind::kIndexMaps:
        return each(value, [&](const Json& e) { return check_index_map(e, f.target); });
      case Kind::kObjects:
        return each(value, [&](const Json& e) { return check_object(e, f.fields); });
    }
    return false;
  }

  const Json& root_;
  exec::StopPoll stopped_;
  proto::Error error_;
  std::vector<Step> path_;
  const char* size_target_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace

proto::Expected<void> check_gltf(const Json& document, const std::stop_token& stop) {
  return Checker(document, stop).run();
}

}  // namespace kiln::gltf
