#include <gtest/gtest.h>

#include <ctime>

#include <nlohmann/json.hpp>

#include "tests/http/live.h"

/// Rates and the quotas of a day.
namespace kiln::test {
namespace {

using nlohmann::json;

class Limits : public testing::Test {
 protected:
  jobs::FakeBake fake_;

  static std::string authorize(const Live& live, const std::string& tenant) {
    return "Authorization: Bearer " +
           live.service->tokens().create(tenant, {"read", "write"}).value().secret;
  }
  static json usage(const Live& live, const std::string& authorization) {
    return json::parse(ask(live.port(), "GET", "/v1/capabilities", {authorization}).body)["usage"];
  }
  /// A bake of so many texels that takes this processor time.
  jobs::BakeFunction costly(std::uint64_t texels, std::chrono::milliseconds busy) {
    return [=, this](const jobs::JobInput& input, exec::ThreadPool& pool, std::stop_token stop,
                     baker::BakeObserver& observer) {
      const std::clock_t end = std::clock() + busy.count() * CLOCKS_PER_SEC / 1'000;
      while (std::clock() < end) {
      }
      auto manifest = fake_.instant()(input, pool, stop, observer);
      if (manifest) manifest->statistics.texels = texels;
      return manifest;
    };
  }
  static Answer post(const Live& live, const std::string& authorization) {
    return ask(live.port(), "POST", "/v1/jobs", {authorization, kForm},
               form({{"name=\"scene\"; filename=\"a.glb\"", "glTF"},
                     {"name=\"options\"", R"({"dedupe":false})"}}));
  }
};

TEST_F(Limits, RatesAreToldAndKept) {
  base::ServerConfig config;
  config.max_requests_per_minute_per_tenant = 4;
  config.max_requests_per_minute_per_token = 3;
  const Live live(fake_.instant(), config);
  const std::string one = authorize(live, "art"), two = authorize(live, "art");
  const std::string other = authorize(live, "game");
  const auto get = [&](const std::string& who) {
    return ask(live.port(), "GET", "/v1/jobs", {who});
  };
  const Answer first = get(one);
  EXPECT_EQ(first.status, 200);
  EXPECT_EQ(first.headers.at("ratelimit-policy"), R"("tenant";q=4;w=60, "token";q=3;w=60)");
  EXPECT_EQ(first.headers.at("ratelimit"), R"("tenant";r=3;t=15, "token";r=2;t=20)");
  EXPECT_EQ(get(one).status, 200);
  EXPECT_EQ(get(one).status, 200);
  const Answer refused = get(one);
  EXPECT_EQ(refused.status, 429);
  EXPECT_EQ(member(refused.body, "code"), "rate_limited");
  const int retry = std::stoi(refused.headers.at("retry-after"));
  EXPECT_GE(retry, 10);
  EXPECT_LE(retry, 20);
  EXPECT_EQ(get(two).status, 200) << "what was refused to one token costs the tenant nothing";
  EXPECT_EQ(get(two).status, 429) << "the tenant's four";
  EXPECT_EQ(get(other).status, 200);
  EXPECT_EQ(ask(live.port(), "GET", "/openapi.json").status, 200);
  const Answer unknown = ask(live.port(), "GET", "/v1/jobs");
  EXPECT_EQ(unknown.status, 401) << "nobody's requests count as nobody's";
}

TEST_F(Limits, WithoutRatesThereAreNoHeaders) {
  const Live live(fake_.instant());
  const Answer answer = ask(live.port(), "GET", "/v1/jobs");
  EXPECT_FALSE(answer.headers.contains("ratelimit"));
  EXPECT_FALSE(answer.headers.contains("ratelimit-policy"));
}

TEST_F(Limits, TexelsOfADay) {
  base::ServerConfig config;
  config.max_texels_per_tenant_per_day = 1'500;
  const TempFolder folder;
  config.data = folder.path() / "data";
  std::string art;
  {
    const Live live(costly(1'000, std::chrono::milliseconds(0)), config);
    art = authorize(live, "art");
    for (int texels = 1'000; texels <= 2'000; texels += 1'000) {
      EXPECT_EQ(post(live, art).status, 202) << "1,000 of 1,500 leave room for one more job";
      for (int i = 0; i < 500 && usage(live, art)["texels_today"] != texels; ++i)
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      EXPECT_EQ(usage(live, art)["texels_today"], texels);
    }
    const Answer refused = post(live, art);
    EXPECT_EQ(refused.status, 429);
    EXPECT_EQ(member(refused.body, "code"), "quota_exceeded");
    EXPECT_EQ(post(live, authorize(live, "game")).status, 202);
  }
  const Live live(fake_.instant(), config);
  EXPECT_EQ(post(live, art).status, 429) << "over a restart";
}

TEST_F(Limits, ProcessorSecondsOfADay) {
  base::ServerConfig config;
  config.max_cpu_seconds_per_tenant_per_day = 1;
  const Live live(costly(1, std::chrono::milliseconds(1'500)), config);
  const std::string art = authorize(live, "art"), game = authorize(live, "game");
  EXPECT_EQ(post(live, art).status, 202);
  for (int i = 0; i < 2'000 && usage(live, art)["cpu_seconds_today"] == 0.0; ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  const double used = usage(live, art)["cpu_seconds_today"];
  EXPECT_GE(used, 1.4);
  EXPECT_LT(used, 15);
  EXPECT_EQ(member(post(live, art).body, "code"), "quota_exceeded");
  EXPECT_EQ(usage(live, game)["cpu_seconds_today"], 0.0);
  EXPECT_GE(usage(live, art)["result_bytes"], 100'002) << "page, manifest and log";
}

}  // namespace
}  // namespace kiln::test
