#include "server/http/body.h"

#include <gtest/gtest.h>

namespace kiln::http {
namespace {

struct Outcome {
  std::string data;
  bool ok = false, done = false;
  std::string rest;  ///< what was left for the next request
};

Outcome read(const std::string& wire, bool chunked, std::uint64_t length = 0) {
  RequestHead head;
  head.chunked = chunked;
  if (!chunked) head.content_length = length;
  BodyDecoder body(head);
  Outcome outcome;
  const auto take = [&](std::string_view bytes) -> proto::Expected<void> {
    outcome.data += bytes;
    return {};
  };
  outcome.ok = true;
  std::size_t at = 0;
  while (outcome.ok && !body.done() && at < wire.size()) {
    const auto piece = std::string_view(wire).substr(at, 3);
    const auto used = body.feed(piece, take);
    outcome.ok = used.has_value();
    if (!used) break;
    EXPECT_TRUE(*used == piece.size() || body.done());
    at += *used;
  }
  outcome.done = body.done();
  outcome.ok = outcome.ok && outcome.done;
  outcome.rest = wire.substr(at);
  return outcome;
}

TEST(Body, StopsAtTheContentLength) {
  const Outcome o = read("helloGET /", false, 5);
  EXPECT_EQ(o.data, "hello");
  EXPECT_TRUE(o.ok && o.done);
  EXPECT_EQ(o.rest, "GET /");
  EXPECT_FALSE(read("hell", false, 5).ok) << "ended early";
  EXPECT_TRUE(read("", false, 0).done);
}

TEST(Body, DecodesChunks) {
  const Outcome o = read("5\r\nhello\r\nA;x=y\r\n0123456789\r\n0\r\nT: v\r\n\r\nGET", true);
  EXPECT_EQ(o.data, "hello0123456789");
  EXPECT_TRUE(o.ok && o.done);
  EXPECT_EQ(o.rest, "GET");
}

TEST(Body, RefusesMalformedChunks) {
  for (const std::string& wire :
       {std::string("zz\r\n"), std::string("\r\n"), std::string("-5\r\nhello"),
        std::string("5\nhello\r\n0\r\n\r\n"), std::string("5\r\nhelloX\r\n0\r\n\r\n"),
        std::string("5\r\nhello\r\n"), std::string("11111111111111111\r\nhello"),
        "5;" + std::string(300, 'x') + "\r\nhello\r\n0\r\n\r\n",
        "0\r\n" + std::string(1000, 'x') + "\r\n\r\n"})
    EXPECT_FALSE(read(wire, true).ok) << wire.substr(0, 40);
}

TEST(Body, HandsOnTheErrorOfWhoTakesIt) {
  RequestHead head;
  head.content_length = 10;
  BodyDecoder body(head);
  const auto full = [](std::string_view) -> proto::Expected<void> {
    return proto::fail("storage_full", "No room.");
  };
  const auto used = body.feed("01234", full);
  ASSERT_FALSE(used);
  EXPECT_EQ(used.error().code, "storage_full");
  EXPECT_FALSE(body.done());
}

TEST(Body, ChecksTheDigestThatWasAnnounced) {
  RequestHead head;
  head.headers = {{"Content-Digest", "sha-256=:LPJNul+wow4m6DsqxbninhsWHlwfp0JecwQzYpOLmCQ=:"}};
  DigestCheck same(head), other(head);
  same.update("hel");
  same.update("lo");
  EXPECT_TRUE(same.finish());
  other.update("hallo");
  EXPECT_EQ(other.finish().error().code, "digest_mismatch");
  EXPECT_TRUE(DigestCheck(RequestHead()).finish()) << "none was announced";
}

}  // namespace
}  // namespace kiln::http
