#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "proto/json.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

json set(std::initializer_list<const char*> assignments) {
  json doc = json::object();
  for (const char* a : assignments) {
    const auto done = set_by_path(doc, a);
    EXPECT_TRUE(done.has_value()) << a << ": " << (done ? "" : done.error().message);
  }
  return doc;
}

std::string refused(const char* assignment, json doc = json::object()) {
  const json before = doc;
  const auto done = set_by_path(doc, assignment);
  EXPECT_FALSE(done.has_value()) << assignment << " gave " << doc;
  EXPECT_EQ(doc, before) << "a failed assignment left a trace";
  if (done) return {};
  EXPECT_EQ(done.error().code, "invalid_settings");
  return done.error().message;
}

TEST(SetByPath, JsonValuesAndBareWords) {
  EXPECT_EQ(set({"solver.samples=64", "solver.method=path", "sky.radiance=[1,2,3]",
                 "allow_dark=true", "output.exposure=null", "solver.tolerance=1e-4"}),
            json::parse(R"({"solver": {"samples": 64, "method": "path", "tolerance": 1e-4},
                            "sky": {"radiance": [1, 2, 3]}, "allow_dark": true,
                            "output": {"exposure": null}})"));
  EXPECT_EQ(set({"solver.samples=64", "solver.samples=65"})["solver"]["samples"], 65);
  EXPECT_EQ(set({R"(solver.method="path")"})["solver"]["method"], "path");
}

TEST(SetByPath, ListsOfWordsByCommas) {
  const json doc = set({"output.formats=exr,png", "output.layers=direct"});
  EXPECT_EQ(doc["output"]["formats"], json({"exr", "png"}));
  EXPECT_EQ(doc["output"]["layers"], json::array({"direct"}));
}

TEST(SetByPath, TextsNeedNoQuotes) {
  for (const auto& [text, value] : {std::pair<std::string, json>{"noon.exr", "noon.exr"},
                                    {"4k noon=1.hdr", "4k noon=1.hdr"},
                                    {"12", "12"},
                                    {"[1]", "[1]"},
                                    {"\"null\"", "null"},
                                    {"null", nullptr}}) {
    const json doc = set({("sky.map=" + text).c_str()});
    EXPECT_EQ(doc["sky"]["map"], value);
    EXPECT_TRUE(settings_from_json(doc)) << text;
  }
  EXPECT_FALSE(settings_from_json(set({"sky.map="})));
}

TEST(SetByPath, Lights) {
  const json doc = set({"lights.0.type=point", "lights.0.intensity=5", "lights.1.type=rect"});
  EXPECT_EQ(doc, json::parse(R"({"lights": [{"type": "point", "intensity": 5},
                                            {"type": "rect"}]})"));
  EXPECT_TRUE(settings_from_json(doc));
}

TEST(SetByPath, RefusesWhatLeadsNowhere) {
  EXPECT_NE(refused("solver.samples").find("expected name=value"), std::string::npos);
  refused("");
  refused("=4");
  refused(".=4");
  refused("solver.=4");
  refused(".solver=4");
  refused("a..b=1");
  refused("lights.1.type=point");  // There is no light 0.
  refused("lights.99999999999999999999=1", json::parse(R"({"lights": []})"));
  refused("solver.samples.x=1", json::parse(R"({"solver": {"samples": 3}})"));
  refused("lights.x=1", json::parse(R"({"lights": []})"));
  refused("a.b.c.d.e.f.g.h.i.j.k.l.m.n.o.p.q=1");
}

TEST(SetByPath, RefusesValuesThatAreNoValues) {
  for (const char* a :
       {"solver.samples=", "solver.samples=6 4", "solver.samples=64x", "sky.radiance=1,2,3",
        "sky.radiance=[1,2", "solver.method={", "a=\xff", "solver.samples=0x10"})
    EXPECT_NO_THROW(to_text(refused(a)));
}

TEST(SetByPath, UnknownNamesAreTheParsersAffair) {
  const auto e = settings_from_json(set({"solver.bouncs=4"}));
  ASSERT_FALSE(e);
  EXPECT_EQ(e.error().details[0].pointer, "/solver/bouncs");
}

}  // namespace
}  // namespace kiln::proto
