#include <gtest/gtest.h>

#include "tests/http/event_stream.h"

/// GET /v1/events: the events of all jobs of a tenant.
namespace kiln::test {
namespace {

constexpr const char* kAll = "/v1/events";

std::vector<std::string> headers_of(const std::string& authorization, std::uint64_t last = 0) {
  std::vector<std::string> headers;
  if (!authorization.empty()) headers.push_back(authorization);
  if (last > 0) headers.push_back("Last-Event-ID: " + std::to_string(last));
  return headers;
}

class AllEvents : public testing::Test {
 protected:
  jobs::FakeBake fake_;

  static std::string authorize(const Live& live, const std::string& tenant,
                               const std::string& scope) {
    return "Authorization: Bearer " +
           live.service->tokens().create(tenant, {"read", "write", scope}).value().secret;
  }
  static std::string post(const Live& live, const std::string& authorization) {
    const Answer made = ask(live.port(), "POST", "/v1/jobs",
                            {authorization, "Content-Type: application/octet-stream"}, "glTF");
    EXPECT_EQ(made.status, 202) << made.body;
    return member(made.body, "id");
  }
  /// Ends of the jobs that the stream told of, in order.
  static std::vector<std::string> ended(const EventStream& stream) {
    std::vector<std::string> jobs;
    for (const auto& event : stream.events())
      if (event.type == "job.end") jobs.push_back(member(event.data, "job"));
    return jobs;
  }
};

TEST_F(AllEvents, BeginWithASnapshotAndTellOfEveryJob) {
  const Live live(fake_.instant());
  const std::string before = post_job(live.port());
  EXPECT_EQ(wait_for_state(live.port(), before, "succeeded"), "succeeded");
  EventStream stream(live.port(), kAll, headers_of(""));
  ASSERT_EQ(stream.status(), 200);
  ASSERT_TRUE(stream.wait_for("snapshot"));
  EXPECT_EQ(member(stream.events().front().data, "jobs"), "[]") << "it is over";
  const std::string a = post_job(live.port());
  ASSERT_TRUE(stream.wait_for("job.end"));
  EXPECT_EQ(ended(stream), std::vector{a});
  for (std::size_t i = 1; i < stream.events().size(); ++i) {
    EXPECT_EQ(member(stream.events()[i].data, "job"), a);
    EXPECT_GT(stream.events()[i].id, stream.events()[i - 1].id);
  }
}

TEST_F(AllEvents, ListInTheSnapshotWhatIsNotOver) {
  const Live live(fake_.holding());
  const std::string id = post_job(live.port());
  EXPECT_EQ(wait_for_state(live.port(), id, "running"), "running");
  EventStream stream(live.port(), kAll, headers_of(""));
  ASSERT_TRUE(stream.wait_for("snapshot"));
  EXPECT_NE(stream.events().front().data.find(id), std::string::npos);
  EXPECT_NE(stream.events().front().data.find("running"), std::string::npos);
  fake_.go = true;
  EXPECT_TRUE(stream.wait_for("job.end"));
}

TEST_F(AllEvents, AreOfOnesOwnTenant) {
  const Live live(fake_.instant());
  const std::string art = authorize(live, "art", "read"), game = authorize(live, "game", "read");
  const std::string ops = authorize(live, "ops", "admin");
  EventStream of_art(live.port(), kAll, headers_of(art));
  EventStream of_game(live.port(), kAll, headers_of(game));
  EventStream of_all(live.port(), kAll, headers_of(ops));
  const std::string a = post(live, art);
  ASSERT_TRUE(of_art.wait_for("job.end"));
  const std::string g = post(live, game);
  ASSERT_TRUE(of_game.wait_for("job.end"));
  for (const auto& event : of_game.events()) EXPECT_EQ(event.data.find(a), std::string::npos);
  while (ended(of_all).size() < 2) ASSERT_TRUE(of_all.wait_next());
  EXPECT_EQ(ended(of_all), (std::vector{a, g}));
  EXPECT_EQ(ask(live.port(), "GET", kAll).status, 401);
}

TEST_F(AllEvents, GoOnAfterARestartWithWhatWasMissed) {
  const TempFolder folder;
  base::ServerConfig config;
  config.data = folder.path() / "data";
  std::uint64_t seen = 0;
  std::string a, b;
  {
    const Live live(fake_.instant(), config);
    a = post_job(live.port());
    EventStream stream(live.port(), "/v1/events?after=0", headers_of(""));
    ASSERT_TRUE(stream.wait_for("job.end"));
    EXPECT_EQ(stream.count("snapshot"), 0u) << "everything was kept";
    seen = stream.ids().back();
    b = post_job(live.port());
    EXPECT_EQ(wait_for_state(live.port(), b, "succeeded"), "succeeded");
  }
  const Live live(fake_.instant(), config);
  EventStream stream(live.port(), kAll, headers_of("", seen));
  ASSERT_TRUE(stream.wait_for("job.end"));
  EXPECT_EQ(stream.count("snapshot"), 0u);
  EXPECT_EQ(ended(stream), std::vector{b});
  EXPECT_GT(stream.ids().front(), seen);

  EventStream future(live.port(), kAll, headers_of("", seen + 1'000'000));
  ASSERT_TRUE(future.wait_for("snapshot")) << "an id that was never given";
  EXPECT_EQ(ask(live.port(), "GET", "/v1/events?after=x").status, 400);
}

}  // namespace
}  // namespace kiln::test
