#include "clients/sse_parser.h"

#include <gtest/gtest.h>

#include <vector>

namespace kiln::clients {
namespace {

struct Seen {
  std::vector<proto::Event> events;
  SseParser parser;

  bool feed(std::string_view bytes) {
    return parser.feed(bytes, [&](const proto::Event& e) {
      events.push_back(e);
      return e.type != "stop";
    });
  }
};

constexpr std::string_view kStream =
    "\xef\xbb\xbfretry: 2000\n\n"
    ": hb\n\n"
    "id: 1\nevent: job.state\ndata: {\"a\":1}\n\n"
    "data: two\r\ndata:lines\r\nid: 2\r\n\r\n"
    "event: nothing\n\n"
    "data\rdata:  x\r\r"
    "unknown: y\nid: z\nid:7\ndata: last\n\n";

void expect_the_stream(const Seen& seen) {
  ASSERT_EQ(seen.events.size(), 4u);
  EXPECT_EQ(seen.events[0].id, 1u);
  EXPECT_EQ(seen.events[0].type, "job.state");
  EXPECT_EQ(seen.events[0].data, "{\"a\":1}");
  EXPECT_EQ(seen.events[1].type, "message");
  EXPECT_EQ(seen.events[1].data, "two\nlines");
  EXPECT_EQ(seen.events[2].id, 0u);  // No id of its own.
  EXPECT_EQ(seen.events[2].data, "\n x");
  EXPECT_EQ(seen.events[3].id, 7u);
  EXPECT_EQ(seen.parser.last_id(), 7u);
  EXPECT_EQ(seen.parser.retry_ms(), 2000u);
}

TEST(SseParser, WholeStream) {
  Seen seen;
  EXPECT_TRUE(seen.feed(kStream));
  expect_the_stream(seen);
}

// Wherever the network cuts the stream, the events are the same.
TEST(SseParser, PiecesOfEverySize) {
  for (std::size_t size = 1; size < 12; ++size) {
    Seen seen;
    for (std::size_t at = 0; at < kStream.size(); at += size)
      EXPECT_TRUE(seen.feed(kStream.substr(at, size)));
    expect_the_stream(seen);
  }
}

TEST(SseParser, StopsWhenTheHandlerDoes) {
  Seen seen;
  EXPECT_FALSE(seen.feed("event: stop\ndata: 1\n\ndata: 2\n\n"));
  EXPECT_EQ(seen.events.size(), 1u);
}

TEST(SseParser, AHalfEventDoesNotSurviveAReconnect) {
  Seen seen;
  seen.feed("id: 4\ndata: a\n\nid: 5\nevent: half\ndata: b\ndata: c");
  seen.parser.reconnect();
  seen.feed("data: d\n\n");
  ASSERT_EQ(seen.events.size(), 2u);
  EXPECT_EQ(seen.events[1].data, "d");
  EXPECT_EQ(seen.events[1].type, "message");
  EXPECT_EQ(seen.events[1].id, 0u);
}

TEST(SseParser, EndlessLinesAndEventsAreCut) {
  const std::string piece(1u << 20, 'x');
  Seen line;
  bool going = true;
  for (int i = 0; i < 40 && going; ++i) going = line.feed(piece);
  EXPECT_FALSE(going);
  EXPECT_TRUE(line.parser.overflowed());
  Seen data;
  going = true;
  for (int i = 0; i < 40 && going; ++i) going = data.feed("data:" + piece + "\n");
  EXPECT_FALSE(going);
  EXPECT_TRUE(data.parser.overflowed());
}

TEST(SseParser, HostileNumbers) {
  Seen seen;
  seen.feed("id: 99999999999999999999999\nretry: -1\nretry: 1e3\nretry: 99999999999\ndata: x\n\n");
  ASSERT_EQ(seen.events.size(), 1u);
  EXPECT_EQ(seen.events[0].id, 0u);
  EXPECT_FALSE(seen.parser.retry_ms());
}

}  // namespace
}  // namespace kiln::clients
