#include "server/http/conditional.h"

#include <gtest/gtest.h>

namespace kiln::http {
namespace {

constexpr const char* kTag = "\"abc\"";

Selection select(std::vector<std::pair<std::string, std::string>> headers, std::uint64_t size = 100,
                 const char* method = "GET") {
  RequestHead head;
  head.method = method;
  head.headers = std::move(headers);
  return select_content(head, kTag, size);
}

void expect_range(const char* range, int status, std::uint64_t offset, std::uint64_t length,
                  std::uint64_t size = 100) {
  const Selection s = select({{"Range", range}}, size);
  EXPECT_EQ(s.status, status) << range;
  EXPECT_EQ(s.offset, offset) << range;
  EXPECT_EQ(s.length, length) << range;
}

TEST(Range, SelectsOneRange) {
  expect_range("bytes=0-9", 206, 0, 10);
  expect_range("bytes=90-", 206, 90, 10);
  expect_range("bytes=90-1000", 206, 90, 10);
  expect_range("bytes=-10", 206, 90, 10);
  expect_range("bytes=-1000", 206, 0, 100);
  expect_range("Bytes = 99-99", 206, 99, 1);
  expect_range("bytes=0-99999999999999999999999", 206, 0, 100);
}

TEST(Range, RefusesWhatCannotBeSatisfied) {
  expect_range("bytes=100-", 416, 0, 0);
  expect_range("bytes=99999999999999999999999-", 416, 0, 0);
  expect_range("bytes=-0", 416, 0, 0);
  expect_range("bytes=0-1,5-6", 416, 0, 0);
  expect_range("bytes=0-", 416, 0, 0, 0);
  expect_range("bytes=-5", 416, 0, 0, 0);
}

TEST(Range, IgnoresWhatIsMalformed) {
  for (const char* range : {"bytes=5-4", "bytes=a-b", "bytes=-", "bytes=", "lines=0-9", "0-9",
                            "bytes=--5", "bytes=1-2-3"})
    expect_range(range, 200, 0, 100);
}

TEST(Range, FollowsConditions) {
  EXPECT_EQ(select({{"If-None-Match", "\"abc\""}}).status, 304);
  EXPECT_EQ(select({{"If-None-Match", "\"x\", W/\"abc\""}}).status, 304);
  EXPECT_EQ(select({{"If-None-Match", "*"}}).status, 304);
  EXPECT_EQ(select({{"If-None-Match", "\"ab\""}}).status, 200);
  EXPECT_EQ(select({{"Range", "bytes=0-1"}, {"If-Range", "\"abc\""}}).status, 206);
  EXPECT_EQ(select({{"Range", "bytes=0-1"}, {"If-Range", "\"other\""}}).status, 200);
  EXPECT_EQ(select({{"Range", "bytes=0-1"}, {"If-Range", "W/\"abc\""}}).status, 200);
  EXPECT_EQ(select({{"Range", "bytes=0-1"}}, 100, "HEAD").status, 200);
}

}  // namespace
}  // namespace kiln::http
