#include "server/http/body.h"

#include <gtest/gtest.h>

#include <algorithm>

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
  std::size_t at = 0;
  BodyReader body(head, [&](char* out, std::size_t n) -> ssize_t {
    const std::size_t take = std::min({n, wire.size() - at, std::size_t(3)});
    std::copy_n(wire.data() + at, take, out);
    at += take;
    return static_cast<ssize_t>(take);
  });
  Outcome outcome;
  char piece[5];
  ssize_t got = 0;
  while ((got = body.read(piece, sizeof piece)) > 0)
    outcome.data.append(piece, static_cast<std::size_t>(got));
  outcome.ok = got == 0;
  outcome.done = body.done();
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

}  // namespace
}  // namespace kiln::http
