#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <numeric>

#include "tests/http/event_stream.h"
#include "tests/http/program.h"

/// Event streams of live services: many at a time, resumed, and left behind.
namespace kiln::test {
namespace {

std::vector<std::uint64_t> range(std::uint64_t first, std::uint64_t last) {
  std::vector<std::uint64_t> ids(last + 1 - first);
  std::iota(ids.begin(), ids.end(), first);
  return ids;
}

TEST(Streams, AHundredLeaveRoomForShortRequests) {
  const TempFolder folder;
  Program program(folder.path() / "data", {"--http-threads", "4"});
  const std::string id = post_job(program, write_scene(folder.path(), "cornell"), kLongBake);
  std::vector<std::unique_ptr<EventStream>> streams;
  for (int i = 0; i < 100; ++i) {
    streams.push_back(std::make_unique<EventStream>(program.port(), id));
    ASSERT_TRUE(streams.back()->wait_first());
  }
  using Clock = std::chrono::steady_clock;
  std::vector<Clock::duration> times;
  for (int i = 0; i < 200; ++i) {
    const auto began = Clock::now();
    ASSERT_EQ(ask(program.port(), "GET", "/v1/jobs/" + id).status, 200);
    times.push_back(Clock::now() - began);
  }
  std::sort(times.begin(), times.end());
  // A stream that held a thread would let nothing through; the rest is the bake's share of two
  // processors.
  EXPECT_LT(times[197], std::chrono::milliseconds(500));
  EXPECT_EQ(ask(program.port(), "POST", "/v1/jobs/" + id + "/cancel").status, 202);
  for (auto& stream : streams) {
    ASSERT_TRUE(stream->wait_end());
    EXPECT_EQ(stream->events().back().type, "job.end");
    EXPECT_EQ(stream->ids(), range(1, stream->ids().back()));
  }
}

TEST(Streams, ResumeExactlyWhereTheyWereCut) {
  jobs::FakeBake fake;
  const Live live(fake.instant(5));
  const std::string id = post_job(live.port());
  EventStream all(live.port(), id);
  ASSERT_TRUE(all.wait_end());
  const std::uint64_t last = all.ids().back();
  EXPECT_EQ(all.ids(), range(1, last));
  for (std::uint64_t seen = 1; seen < last; ++seen) {
    EventStream rest(live.port(), id, std::to_string(seen));
    ASSERT_TRUE(rest.wait_end()) << seen;
    EXPECT_EQ(rest.ids(), range(seen + 1, last));
    for (std::size_t i = 0; i < rest.events().size(); ++i)
      EXPECT_EQ(rest.events()[i].data, all.events()[seen + i].data);
  }
  EXPECT_EQ(EventStream(live.port(), id, std::to_string(last)).status(), 204);
  EXPECT_EQ(EventStream(live.port(), id, "x").status(), 400);
  const auto by_query = ask(live.port(), "GET", "/v1/jobs/" + id + "/events?after=1");
  EXPECT_EQ(by_query.body.find("id: 1\n"), std::string::npos);
  EXPECT_NE(by_query.body.find("id: 2\n"), std::string::npos);
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs/" + id + "/events?after=x").status, 400);
}

TEST(Streams, ResumeWhileTheJobRuns) {
  jobs::FakeBake fake;
  const Live live(fake.holding());
  const std::string id = post_job(live.port());
  std::vector<std::uint64_t> seen;
  for (int i = 0; i < 4; ++i) {
    EventStream stream(live.port(), id, seen.empty() ? "" : std::to_string(seen.back()));
    ASSERT_TRUE(stream.wait_for("job.progress"));
    for (const auto number : stream.ids()) seen.push_back(number);
  }
  fake.go = true;
  EventStream rest(live.port(), id, std::to_string(seen.back()));
  ASSERT_TRUE(rest.wait_end());
  for (const auto number : rest.ids()) seen.push_back(number);
  EXPECT_EQ(seen, range(1, seen.back()));
  EXPECT_EQ(rest.events().back().type, "job.end");
}

TEST(Streams, WhoIsTooFarBehindGetsASnapshot) {
  jobs::FakeBake fake;
  const Live live(fake.instant(3000));  // more passes than events are kept
  const std::string id = post_job(live.port());
  ASSERT_EQ(wait_for_state(live.port(), id, "succeeded"), "succeeded");
  EventStream stream(live.port(), id, "1");
  ASSERT_TRUE(stream.wait_end());
  ASSERT_EQ(stream.count("snapshot"), 1u);
  EXPECT_EQ(stream.events().front().type, "snapshot");
  EXPECT_EQ(member(stream.events().front().data, "state"), "succeeded");
  EXPECT_EQ(stream.events().back().type, "job.end");
  // An id from the future is as unknown as one that is gone.
  EventStream ahead(live.port(), id, "999999");
  ASSERT_TRUE(ahead.wait_end());
  EXPECT_EQ(ahead.events().front().type, "snapshot");
}

TEST(Streams, AreToldWhenTheServiceGoes) {
  jobs::FakeBake fake;
  const Live live(fake.holding());
  const std::string id = post_job(live.port());
  EventStream early(live.port(), id);
  ASSERT_TRUE(early.wait_first());
  live.service->begin_drain();
  EXPECT_TRUE(early.wait_for("server.draining"));
  EventStream late(live.port(), id);  // and so is who comes later
  EXPECT_TRUE(late.wait_for("server.draining"));
  EXPECT_EQ(ask(live.port(), "POST", "/v1/jobs").status, 503);
  EXPECT_EQ(ask(live.service->admin_port(), "GET", "/readyz").status, 503);
  fake.go = true;
  EXPECT_TRUE(live.service->wait_idle(std::chrono::seconds(10)));
  EXPECT_TRUE(early.wait_for("job.end"));
  EXPECT_TRUE(late.wait_for("job.end"));
}

}  // namespace
}  // namespace kiln::test
