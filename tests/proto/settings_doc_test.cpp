// docs/settings.md holds tables made from the settings' own table. This test keeps them true;
// LIGHTKILN_UPDATE_DOCS=1 test_proto --gtest_filter='SettingsDoc.*' writes them anew.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>

#include "proto/json.h"
#include "proto/settings_schema.h"

namespace kiln::proto {
namespace {

constexpr const char* kFile = LIGHTKILN_SOURCE_DIR "/docs/settings.md";
constexpr const char* kBegin = "<!-- made from the settings' table: do not edit by hand -->\n";
constexpr const char* kEnd = "<!-- end of what is made -->\n";

std::string escaped(std::string text) {
  for (std::size_t at = 0; (at = text.find('|', at)) != std::string::npos; at += 2)
    text.insert(at, "\\");
  return text;
}

std::string row_text(const SettingSpec& spec, const nlohmann::json& value, bool with_types) {
  std::string row = "| `" + std::string(spec.path) + "` | `" + value.dump() + "` | " +
                    escaped(expectation(spec)) + " | " + escaped(std::string(spec.unit)) + " | ";
  if (with_types) {
    const auto& types = light_rows().front().spec.choices;
    std::string used;
    for (std::size_t i = 0; i < types.size(); ++i)
      if ((spec.used_by >> i & 1) != 0) used += (used.empty() ? "" : ", ") + std::string(types[i]);
    row += used + " | ";
  }
  row += escaped(std::string(spec.description));
  const auto methods = methods_of(spec);
  if (methods.size() == kMethodNames.size()) return row + " |\n";
  row += " Methods: ";
  for (std::size_t i = 0; i < methods.size(); ++i)
    row += (i == 0 ? "" : ", ") + std::string(methods[i]);
  return row + ". |\n";
}

constexpr const char* kHead =
    "| setting | default | allowed values | unit | meaning |\n|---|---|---|---|---|\n";
constexpr const char* kLightHead =
    "| key | default | allowed values | unit | types | meaning |\n|---|---|---|---|---|---|\n";

std::string group_of(const SettingSpec& spec) {
  const std::size_t dot = spec.path.find('.');
  return dot == std::string_view::npos ? "" : std::string(spec.path.substr(0, dot));
}

std::string rows_of_group(const std::string& group) {
  const BakeSettings defaults;
  std::string text = kHead;
  for (const auto& row : setting_rows())
    if (group_of(row.spec) == group)
      text += row_text(row.spec, row.read(defaults, row.spec), false);
  return text;
}

std::string made() {
  std::string text = kBegin;
  for (const SettingGroup& group : setting_groups())
    text += "\n## " + std::string(group.name) + "\n\n" + std::string(group.description) + ".\n\n" +
            rows_of_group(std::string(group.name));
  text += "\n## Whole bake\n\n" + rows_of_group("");
  text += "\n## lights\n\nA list of at most " + std::to_string(kMaxLights) +
          " lights beside those of the glTF. Each is an object with these keys:\n\n" +
          std::string(kLightHead);
  const LightSettings defaults;
  for (const auto& row : light_rows())
    text += row_text(row.spec, row.read(defaults, row.spec), true);
  return text + "\n" + kEnd;
}

std::string read_file() {
  std::ifstream in(kFile);
  std::stringstream text;
  text << in.rdbuf();
  return text.str();
}

TEST(SettingsDoc, TablesAreThoseOfTheCode) {
  const std::string page = read_file();
  const std::size_t begin = page.find(kBegin), end = page.find(kEnd);
  ASSERT_NE(begin, std::string::npos) << kFile;
  ASSERT_NE(end, std::string::npos) << kFile;
  const std::size_t after = end + std::string_view(kEnd).size();
  if (std::getenv("LIGHTKILN_UPDATE_DOCS") != nullptr) {
    std::ofstream(kFile) << page.substr(0, begin) + made() + page.substr(after);
    return;
  }
  EXPECT_EQ(page.substr(begin, after - begin), made())
      << "docs/settings.md is out of date; LIGHTKILN_UPDATE_DOCS=1 writes it anew";
}

TEST(SettingsDoc, ExamplesAreAccepted) {
  const std::string page = read_file();
  constexpr std::string_view kOpen = "```json\n", kClose = "```";
  std::size_t examples = 0;
  for (std::size_t at = 0; (at = page.find(kOpen, at)) != std::string::npos; ++examples) {
    at += kOpen.size();
    const std::string example = page.substr(at, page.find(kClose, at) - at);
    const auto settings = parse_settings(example);
    EXPECT_TRUE(settings.has_value()) << example << settings.error().details.at(0).detail;
  }
  EXPECT_GE(examples, 3u);
}

}  // namespace
}  // namespace kiln::proto
