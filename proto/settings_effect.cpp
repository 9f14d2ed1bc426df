#include <algorithm>
#include <nlohmann/json.hpp>

#include "proto/settings_schema.h"

namespace kiln::proto {
namespace {

bool reads(Method method, const SettingSpec& spec) {
  return (spec.methods >> static_cast<std::uint32_t>(method) & 1u) != 0;
}

bool has_effect(const BakeSettings& settings, const SettingSpec& spec) {
  if (reads(settings.solver.method, spec)) return true;
  const auto reference = settings.report.method();
  if (reference && spec.reaches_reference && reads(*reference, spec)) return true;
  return std::ranges::any_of(settings.output.layers, [&](const std::string& layer) {
    return std::ranges::find(spec.layers, layer) != spec.layers.end();
  });
}

/// Returns the words as "a", "a and b", "a, b and c".
std::string enumerated(const std::vector<std::string_view>& words) {
  std::string text;
  for (std::size_t i = 0; i < words.size(); ++i)
    text.append(i == 0 ? "" : i + 1 == words.size() ? " and " : ", ").append(words[i]);
  return text;
}

}  // namespace

std::vector<std::string_view> methods_of(const SettingSpec& spec) {
  std::vector<std::string_view> names;
  for (std::size_t i = 0; i < kMethodNames.size(); ++i)
    if (reads(static_cast<Method>(i), spec)) names.emplace_back(kMethodNames[i].name);
  return names;
}

std::vector<Warning> settings_without_effect(const BakeSettings& settings) {
  static const BakeSettings defaults;
  std::vector<Warning> warnings;
  for (const auto& row : setting_rows()) {
    const SettingSpec& spec = row.spec;
    if (has_effect(settings, spec) || row.read(settings, spec) == row.read(defaults, spec))
      continue;
    const std::string path(spec.path);
    std::string pointer = "/" + path;
    std::ranges::replace(pointer, '.', '/');
    const auto methods = methods_of(spec);
    warnings.push_back({"setting_without_effect", std::move(pointer),
                        path + " has no effect with solver.method " +
                            to_string(settings.solver.method) + "; " + enumerated(methods) +
                            (methods.size() == 1 ? " reads it." : " read it.")});
  }
  return warnings;
}

}  // namespace kiln::proto
