#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "proto/json.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

Error error_of(std::string_view text) {
  auto doc = parse_json(text, "settings");
  EXPECT_FALSE(doc.has_value()) << text.substr(0, 80);
  return doc ? Error{} : doc.error();
}

TEST(ParseJson, ReadsWhatJsonAllows) {
  const auto doc =
      parse_json(R"({"a":[1,-2,3.5e1,"x\u0000y",true,null],"b":{"a":{}}})", "settings");
  ASSERT_TRUE(doc) << doc.error().message;
  EXPECT_EQ((*doc)["a"][3].get<std::string>(), std::string("x\0y", 3));
  EXPECT_EQ((*doc)["a"][2], 35.0);
  EXPECT_TRUE((*doc)["b"]["a"].is_object());
  EXPECT_EQ(*parse_json(" 7 ", "s"), 7);
}

TEST(ParseJson, NestingUpTo64AndNoFurther) {
  const auto nested = [](std::size_t n) { return std::string(n, '[') + std::string(n, ']'); };
  EXPECT_TRUE(parse_json(nested(64), "settings"));
  EXPECT_EQ(error_of(nested(65)).message,
            "settings: nested deeper than 64 levels at line 1, column 65");
  EXPECT_EQ(error_of(std::string(4'000'000, '[')).code, "invalid_json");
  EXPECT_EQ(error_of(std::string(100'000, '{')).code, "invalid_json");
  // Brackets in strings are text, also behind an escaped quote.
  EXPECT_TRUE(parse_json("\"" + std::string(500, '[') + "\"", "settings"));
  EXPECT_TRUE(parse_json("\"\\\"" + std::string(500, '[') + "\"", "settings"));
}

TEST(ParseJson, DuplicateKeysAreNamedWithTheirPointer) {
  const auto e = error_of(R"({"lights":[{},{"a/b":{"x":1},"c":[[{"k":1}]],"a/b":2}]})");
  ASSERT_EQ(e.details.size(), 1u);
  EXPECT_EQ(e.details[0].pointer, "/lights/1/a~1b");
  EXPECT_TRUE(parse_json(R"([{"a":1},{"a":2}])", "s"));  // Different objects.
  EXPECT_EQ(error_of(R"({"a":1,"\u0061":2})").details[0].pointer, "/a");
  const std::string key(100'000, 'k');
  EXPECT_LT(error_of("{\"" + key + "\":1,\"" + key + "\":2}").message.size(), 500u);
}

TEST(ParseJson, SaysWhereTheTextGoesWrong) {
  EXPECT_NE(error_of("{\n  \"a\": 1,\n  }").message.find("line 3, column 3"), std::string::npos);
  for (const char* text :
       {"",          " ",       "{",      "[1,",         "{\"a\"}",  "{'a':1}", "nul",
        "[1] x",     "01",      "+1",     ".5",          "1.",       "NaN",     "Infinity",
        "-Infinity", "[1e400]", "-1e999", "\"\\ud800\"", "\"a\nb\"", "// c\n1"})
    EXPECT_EQ(error_of(text).code, "invalid_json") << text;
}

TEST(ParseJson, InvalidUtf8NeverReachesTheMessage) {
  for (const char* text : {"\"\xff\"", "\"\xc3(\"", "\"\xe2\x82\"", "\"\xed\xa0\x80\"", "\xff",
                           "{\"\x80\":1}", "\"\xf4\x90\x80\x80\"", "\"\xc0\xaf\""}) {
    const auto e = error_of(text);
    EXPECT_NO_THROW(to_json(e).dump()) << e.message;
    EXPECT_NE(e.message.find("column"), std::string::npos);
  }
  EXPECT_TRUE(parse_json("\"\xf0\x9f\x94\xa5\"", "s"));
}

TEST(ParseJson, LongTokensAreNotRepeated) {
  EXPECT_LT(error_of("\"" + std::string(1'000'000, 'a')).message.size(), 300u);
}

TEST(ToText, ReplacesWhatIsNotUtf8) {
  EXPECT_EQ(to_text(json("a\xff")), "\"a\xef\xbf\xbd\"");
}

}  // namespace
}  // namespace kiln::proto
