#include <gtest/gtest.h>

#include "proto/text_codes.h"

namespace kiln::proto {
namespace {

TEST(UriEscape, DecodesBytes) {
  EXPECT_EQ(percent_decode("a%20b%C3%A9"), "a b\xC3\xA9");
  EXPECT_EQ(percent_decode("%2f%2F+"), "//+");
  EXPECT_EQ(percent_decode("a+%2B", true), "a +");
  EXPECT_EQ(percent_decode("%00"), std::string(1, '\0'));
  EXPECT_EQ(percent_decode(""), "");
}

TEST(UriEscape, RefusesBrokenEscapes) {
  for (const char* broken : {"%", "%4", "a%", "%g0", "%0g", "%-1", "%+1", "% 1", "%%41"})
    EXPECT_FALSE(percent_decode(broken)) << broken;
}

TEST(UriEscape, EncodesAllButUnreservedCharacters) {
  EXPECT_EQ(percent_encode("aZ09-._~"), "aZ09-._~");
  EXPECT_EQ(percent_encode("a b/%\xC3\xA9"), "a%20b%2F%25%C3%A9");
  std::string all;
  for (int c = 0; c < 256; ++c) all += static_cast<char>(c);
  EXPECT_EQ(percent_decode(percent_encode(all)), all);
}

// The vectors of RFC 4648, section 10.
TEST(Base64, KnowsTheStandardsExamples) {
  const char* const pairs[][2] = {{"", ""},
                                  {"f", "Zg=="},
                                  {"fo", "Zm8="},
                                  {"foo", "Zm9v"},
                                  {"foob", "Zm9vYg=="},
                                  {"fooba", "Zm9vYmE="},
                                  {"foobar", "Zm9vYmFy"}};
  for (const auto& [bytes, text] : pairs) {
    EXPECT_EQ(base64_encode(bytes), text);
    EXPECT_EQ(base64_decode(text), bytes);
  }
}

TEST(Base64, TakesWhatWritersOfGltfWrite) {
  EXPECT_EQ(base64_decode("Zg"), "f") << "without padding";
  EXPECT_EQ(base64_decode("-_8="), "\xFB\xFF") << "the alphabet for URLs";
  EXPECT_EQ(base64_decode("+/8="), "\xFB\xFF");
}

TEST(Base64, RefusesOtherLettersAndImpossibleLengths) {
  for (const char* bad :
       {"Z", "Z===", "====", "=Zm8", "Zm=8", "Zm9v\n", " m9v", "Zm9 ", "Zm9*", "Zg==Zm9v", "Zm9vY"})
    EXPECT_FALSE(base64_decode(bad)) << bad;
}

// Longer than the pieces that are handed to OpenSSL.
TEST(Base64, KeepsLargeContent) {
  std::string bytes((std::size_t{3} << 21) + 1, 'x');
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes[i] = static_cast<char>(i * 31 >> 3);
  const std::string text = base64_encode(bytes);
  EXPECT_EQ(text.size(), (std::size_t{1} << 23) + 4);
  EXPECT_EQ(base64_decode(text), bytes);
}

}  // namespace
}  // namespace kiln::proto
