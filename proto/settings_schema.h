#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "proto/bake_settings.h"
#include "proto/manifest.h"

/// The one table of settings. The parser, the echo, the published JSON Schema and the documentation
/// all come from it; a range is written down nowhere else.
namespace kiln::proto {

enum class ValueKind {
  kInteger,
  kNumber,
  kBoolean,
  kChoice,     ///< one word of `choices`
  kChoices,    ///< a list of at least `min` different words of `choices`
  kVector,     ///< three numbers, each in the range
  kDirection,  ///< a vector with at least one component beyond kShortest
  kText,       ///< text of 1 to `max` characters
};

/// Directions whose components are all within this distance of zero have no usable length in float.
inline constexpr double kShortest = 1e-6;

/// Upper limit on `lights`.
inline constexpr std::size_t kMaxLights = 10'000;

/// The specification of a setting's value.
struct SettingSpec {
  std::string_view path = {};  ///< "solver.bounces"; for lights the plain key
  ValueKind kind = ValueKind::kNumber;
  double min = 0, max = 0;  ///< inclusive limits of numbers, vector components and lengths
  bool nullable = false;    ///< null is allowed: the baker chooses
  std::vector<std::string_view> choices = {};
  std::string_view unit = {};  ///< "" for counts and ratios
  std::string_view description = {};
  std::uint32_t used_by = ~0u;  ///< for lights: bit 1 << LightType of each type that has the key
  std::uint32_t methods = ~0u;  ///< bit 1 << Method of each method that reads the setting
  std::vector<std::string_view> layers = {};  ///< layers that read it whatever the method
  bool reaches_reference = false;  ///< the method that report.against names reads it, too
};

/// A row of the table: the specification, and where the value lives in `Owner`.
template <class Owner>
struct SettingRow {
  SettingSpec spec;
  nlohmann::json (*read)(const Owner&, const SettingSpec&);
  /// Writes the value to its owner. Requires a value that check_value() accepts.
  void (*write)(Owner&, const nlohmann::json&, const SettingSpec&);
};

/// A group of settings ("solver") and its description.
struct SettingGroup {
  std::string_view name, description;
};

const std::vector<SettingGroup>& setting_groups();
const std::vector<SettingRow<BakeSettings>>& setting_rows();
const std::vector<SettingRow<LightSettings>>& light_rows();  ///< the first one is `type`

/// Returns the names of the methods that read a setting.
std::vector<std::string_view> methods_of(const SettingSpec&);
/// Returns a warning `setting_without_effect`, with its pointer, for each setting of `solver` that
/// differs from its default and that nothing of the bake reads: neither its method, nor a layer,
/// nor the reference of its report.
std::vector<Warning> settings_without_effect(const BakeSettings&);

/// Returns what is wrong with the value, in words for a person, or nothing when it is valid.
std::optional<std::string> check_value(const SettingSpec&, const nlohmann::json&);

/// Returns the valid values in words: "an integer from 0 to 64", "one of \"gather\", \"path\"", ...
std::string expectation(const SettingSpec&);

/// Returns the JSON Schema of one value, without its default.
nlohmann::json value_schema(const SettingSpec&);

}  // namespace kiln::proto
