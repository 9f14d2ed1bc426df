#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/settings_schema.h"
#include "tests/proto/schema_check.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

constexpr double kInf = std::numeric_limits<double>::infinity();

json repeated(const json& v) {
  return json::array({v, v, v});
}

std::vector<json> numbers_at_the_edges(const SettingSpec& s) {
  std::vector<json> out;
  for (const double edge : {s.min, s.max})
    for (const double v : {edge, std::nextafter(edge, -kInf), std::nextafter(edge, kInf), edge - 1,
                           edge + 1, edge / 2, edge * 2, -edge})
      out.push_back(v);
  for (const double v : {0.0, -0.0, 1.0, 0.5, 1e-300, 5e-324, 1e300, -1e300}) out.push_back(v);
  out.push_back(static_cast<std::int64_t>(s.min));
  out.push_back(static_cast<std::int64_t>(s.max));
  out.push_back(static_cast<std::int64_t>(s.max) + 1);
  out.push_back(static_cast<std::int64_t>(s.min) - 1);
  out.push_back(std::numeric_limits<std::uint64_t>::max());
  out.push_back(std::numeric_limits<std::int64_t>::min());
  return out;
}

/// Values of every JSON type, and those where the row's own rules begin and end.
std::vector<json> candidates(const SettingSpec& s) {
  std::vector<json> out{nullptr,
                        true,
                        false,
                        0,
                        1,
                        -1,
                        "",
                        "x",
                        "1",
                        json::array(),
                        json::object(),
                        json::array({1}),
                        json::array({"x"})};
  for (const auto& v : numbers_at_the_edges(s)) {
    out.push_back(v);
    out.push_back(repeated(v));
    out.push_back(json::array({v, 0, 0}));
    out.push_back(json::array({0, 0, v}));
  }
  out.push_back(json::array({0, 1}));
  out.push_back(json::array({0, 1, 0, 0}));
  out.push_back(json::array({0, "1", 0}));
  out.push_back(json::array({kShortest, -kShortest, 0}));
  out.push_back(json::array({kShortest * 1.001, 0, 0}));
  if (s.kind == ValueKind::kText)
    for (const double length : {s.max, s.max + 1})
      out.emplace_back(std::string(static_cast<std::size_t>(length), 'x'));
  json words = json::array();
  for (const auto word : s.choices) {
    const std::string w(word);
    words.push_back(w);
    out.insert(out.end(),
               {w, w + "x", json::array({w}), json::array({w, w}), json::array({w, 1}), words});
  }
  words.push_back("another");
  out.push_back(words);
  return out;
}

TEST(SettingsSchema, AgreesWithTheParserOnEveryRow) {
  const json schema = settings_schema();
  std::size_t accepted = 0, refused = 0;
  for (const auto& row : setting_rows()) {
    for (const auto& value : candidates(row.spec)) {
      std::string pointer = "/" + std::string(row.spec.path);
      std::replace(pointer.begin(), pointer.end(), '.', '/');
      json doc;
      doc[json::json_pointer(pointer)] = value;
      // What a schema can't express: a gutter leaves room on the page, and a layer of errors needs
      // a reference.
      if (row.spec.path == "atlas.gutter") doc["atlas"]["page_size"] = 16384;
      if (row.spec.path == "output.layers") doc["report"]["against"] = "path";
      const bool parsed = settings_from_json(doc).has_value();
      EXPECT_EQ(accepts(schema, doc), parsed) << doc.dump();
      (parsed ? accepted : refused) += 1;
    }
  }
  EXPECT_GT(accepted, 2 * setting_rows().size());  // Both edges of each, at the least.
  EXPECT_GT(refused, 20 * setting_rows().size());
}

TEST(SettingsSchema, AgreesWithTheParserOnEveryLightKey) {
  const json schema = settings_schema();
  for (const char* type : {"directional", "point", "spot", "rect", "sun"}) {
    for (const auto& row : light_rows()) {
      for (const auto& value : candidates(row.spec)) {
        json light{{"type", type}};
        // The rule between two keys that a schema can't express: inner <= outer.
        if (row.spec.path == "inner_cone_angle") light["outer_cone_angle"] = 1.5707964;
        light[std::string(row.spec.path)] = value;
        const json doc{{"lights", {light}}};
        EXPECT_EQ(accepts(schema, doc), settings_from_json(doc).has_value()) << doc.dump();
      }
    }
  }
}

TEST(SettingsSchema, ItsDefaultsAreTheSettingsOfAnEmptyDocument) {
  const json schema = settings_schema(), defaults = to_json(BakeSettings{});
  EXPECT_TRUE(accepts(schema, defaults));
  EXPECT_EQ(schema["properties"]["lights"]["default"], defaults["lights"]);
  for (const auto& row : setting_rows()) {
    const auto dot = row.spec.path.find('.');
    const std::string group(row.spec.path.substr(0, dot));
    const json& node = schema["properties"][group];
    if (dot == std::string_view::npos) {
      EXPECT_EQ(node["default"], defaults[group]);
    } else {
      const std::string key(row.spec.path.substr(dot + 1));
      EXPECT_EQ(node["properties"][key]["default"], defaults[group][key]);
    }
  }
}

TEST(SettingsSchema, UnknownKeysAreRefusedByBoth) {
  const json schema = settings_schema();
  for (const char* text :
       {R"({"x": 1})", R"({"solver": {"x": 1}})", R"({"lights": [{"type": "point", "x": 1}]})",
        R"({"lights": [{}]})", R"({"lights": {}})", R"({"solver": []})", "[]"}) {
    const json doc = json::parse(text);
    EXPECT_FALSE(accepts(schema, doc)) << text;
    EXPECT_FALSE(settings_from_json(doc)) << text;
  }
}

TEST(SettingsSchema, EveryRowIsDescribed) {
  for (const auto& row : setting_rows()) EXPECT_FALSE(row.spec.description.empty());
  for (const auto& row : light_rows()) EXPECT_FALSE(row.spec.description.empty());
  EXPECT_EQ(settings_schema()["$schema"], "https://json-schema.org/draft/2020-12/schema");
  EXPECT_EQ(settings_schema()["properties"]["atlas"]["properties"]["texels_per_metre"]["type"],
            json({"number", "null"}));
}

// Whatever float a decimal rounds to, its echo is a settings document again.
TEST(Settings, TheEchoOfAnyNumberIsAccepted) {
  for (const auto& row : setting_rows()) {
    if (row.spec.kind != ValueKind::kNumber) continue;
    for (const auto& value : numbers_at_the_edges(row.spec)) {
      if (check_value(row.spec, value)) continue;
      BakeSettings settings;
      row.write(settings, value, row.spec);
      const json echo = row.read(settings, row.spec);
      EXPECT_FALSE(check_value(row.spec, echo)) << row.spec.path << " " << echo;
      BakeSettings again;
      row.write(again, echo, row.spec);
      EXPECT_EQ(row.read(again, row.spec), echo);
    }
  }
}

}  // namespace
}  // namespace kiln::proto
