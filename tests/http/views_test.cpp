// The route of views, with stand-ins for the bake and for what draws.
#include <gtest/gtest.h>

#include <atomic>
#include <mutex>
#include <thread>

#include "tests/http/live.h"

namespace kiln::test {
namespace {

using namespace std::chrono_literals;

/// A bake whose results have a lit.glb.
jobs::BakeFunction with_lit_scene(jobs::FakeBake& fake) {
  return [bake = fake.instant()](const jobs::JobInput& input, exec::ThreadPool& pool,
                                 std::stop_token stop, baker::BakeObserver& observer) {
    auto manifest = bake(input, pool, std::move(stop), observer);
    if (!manifest) return manifest;
    EXPECT_TRUE(proto::write_bytes(input.output_dir / "lit.glb", "glTF"));
    const auto digest = proto::digest_file(input.output_dir / "lit.glb").value();
    manifest->files.push_back({"lit.glb", "model/gltf-binary", digest.bytes, digest.sha256});
    return manifest;
  };
}

/// Remembers what it was asked to draw, and may hold until told to stop.
struct FakeView {
  std::mutex mutex;
  std::vector<api::ViewInput> inputs;
  std::atomic<int> drawing{0}, stopped{0};
  std::atomic<bool> holds{false};

  api::ViewFunction function() {
    return [this](const api::ViewInput& input, exec::ThreadPool&,
                  std::stop_token stop) -> proto::Expected<std::string> {
      {
        const std::lock_guard lock(mutex);
        inputs.push_back(input);
      }
      ++drawing;
      while (holds && !stop.stop_requested()) std::this_thread::sleep_for(1ms);
      --drawing;
      if (stop.stop_requested()) {
        ++stopped;
        return proto::fail(proto::kCanceledCode, "Stopped.");
      }
      if (input.request.camera == "door")
        return proto::fail("not_found", "There is no camera `door`.", "request", "/query/camera");
      if (input.request.camera == "hell") throw std::runtime_error("secret");
      return "\x89PNG picture";
    };
  }
};

struct ViewRoute : testing::Test {
  jobs::FakeBake fake;
  FakeView view;
  std::unique_ptr<Live> live;
  std::string path;

  void SetUp() override {
    server::ServiceParts parts;
    parts.bake = with_lit_scene(fake);
    parts.view = view.function();
    live = std::make_unique<Live>(std::move(parts), base::ServerConfig{});
    path = "/v1/jobs/" + post_job(live->port());
    ASSERT_EQ(member(ask(live->port(), "GET", path + "?wait=20").body, "state"), "succeeded");
  }
  Answer get(const std::string& query, const std::vector<std::string>& headers = {}) {
    return ask(live->port(), "GET", path + "/view" + query, headers);
  }
  static void wait_until(const std::function<bool()>& there) {
    for (int i = 0; i < 20'000 && !there(); ++i) std::this_thread::sleep_for(1ms);
    ASSERT_TRUE(there());
  }
};

TEST_F(ViewRoute, DrawsWhatTheQuerySays) {
  const Answer plain = get("");
  EXPECT_EQ(plain.status, 200) << plain.body;
  EXPECT_EQ(plain.headers.at("content-type"), "image/png");
  EXPECT_EQ(plain.body, "\x89PNG picture");
  EXPECT_EQ(
      get("?layer=direct&camera=1,2,3:4,5,6:50&size=64x48&exposure=0.5&ortho=true&filter=nearest"
          "&shaded=true")
          .status,
      200);
  ASSERT_EQ(view.inputs.size(), 2u);
  EXPECT_EQ(view.inputs[0].request.layer, "irradiance");
  EXPECT_EQ(view.inputs[0].request.size.width, 1024u);
  const view::Request& asked = view.inputs[1].request;
  EXPECT_EQ(asked.layer, "direct");
  EXPECT_EQ(asked.camera, "1,2,3:4,5,6:50");
  EXPECT_EQ(asked.size.width, 64u);
  EXPECT_EQ(asked.size.height, 48u);
  EXPECT_EQ(asked.exposure, 0.5f);
  EXPECT_TRUE(asked.orthographic && asked.nearest && asked.shaded);
  EXPECT_TRUE(std::filesystem::exists(view.inputs[1].folder / "lit.glb"));
}

TEST_F(ViewRoute, APictureThatTheClientHasIsNotDrawnAgain) {
  const Answer first = get("?size=64x48&exposure=1e-8");
  ASSERT_EQ(first.status, 200);
  const std::string tag = "If-None-Match: " + first.headers.at("etag");
  EXPECT_EQ(get("?size=64x48&exposure=1e-8", {tag}).status, 304);
  EXPECT_EQ(view.inputs.size(), 1u);
  for (const char* other : {"?size=64x49&exposure=1e-8", "?size=64x48", "?size=64x48&exposure=2e-8",
                            "?size=64x48&exposure=1e-8&layer=direct"})
    EXPECT_EQ(get(other, {tag}).status, 200) << other;
}

TEST_F(ViewRoute, WrongQueriesAreNamed) {
  for (const auto& [query, pointer] : std::vector<std::pair<std::string, std::string>>{
           {"?layer=normals", "/query/layer"},
           {"?size=4097x1", "/query/size"},
           {"?size=0x10", "/query/size"},
           {"?size=big", "/query/size"},
           {"?camera=", "/query/camera"},
           {"?camera=1,2,3:1,2,3", "/query/camera"},
           {"?exposure=0", "/query/exposure"},
           {"?exposure=1e30", "/query/exposure"},
           {"?ortho=yes", "/query/ortho"},
           {"?filter=cubic", "/query/filter"},
           {"?lyer=normal", "/query/lyer"},
           {"?layer=normal&shaded=true", "/query/shaded"}}) {
    const Answer answer = get(query);
    EXPECT_EQ(answer.status, 400) << query << answer.body;
    EXPECT_EQ(answer.headers.at("content-type"), "application/problem+json");
    EXPECT_NE(answer.body.find("\"" + pointer + "\""), std::string::npos) << answer.body;
  }
  EXPECT_TRUE(view.inputs.empty());
  const Answer unknown = get("?camera=door");
  EXPECT_EQ(unknown.status, 404);
  EXPECT_NE(unknown.body.find("/query/camera"), std::string::npos);
  const Answer broken = get("?camera=hell");
  EXPECT_EQ(broken.status, 500);
  EXPECT_EQ(broken.body.find("secret"), std::string::npos);
}

TEST_F(ViewRoute, StopsWhenTheClientLeaves) {
  view.holds = true;
  {
    const Wire wire(live->port());
    wire.send("GET " + path + "/view HTTP/1.1\r\nHost: test\r\n\r\n");
    wait_until([&] { return view.drawing == 1; });
  }
  wait_until([&] { return view.stopped == 1; });
  view.holds = false;
  EXPECT_EQ(get("").status, 200) << "and the next is drawn";
}

TEST_F(ViewRoute, AtMostTwoAreDrawnAtATimeAndTheOthersWait) {
  view.holds = true;
  std::vector<Wire> wires;
  for (int i = 0; i < 5; ++i) {
    wires.emplace_back(live->port());
    wires.back().send("GET " + path + "/view?size=9x" + std::to_string(i + 1) +
                      " HTTP/1.1\r\nHost: test\r\nConnection: close\r\n\r\n");
  }
  wait_until([&] { return view.drawing == 2; });
  std::this_thread::sleep_for(50ms);
  EXPECT_EQ(view.drawing, 2);
  view.holds = false;
  for (const Wire& wire : wires)
    EXPECT_TRUE(wire.read({}, 20s).starts_with("HTTP/1.1 200 ")) << view.inputs.size();
}

TEST_F(ViewRoute, AFullLineIsRefused) {
  view.holds = true;
  std::vector<Wire> wires;
  std::string refused;
  // Two are drawn and 32 wait; how soon they are counted is not known.
  while (refused.empty() && wires.size() < 60) {
    wires.emplace_back(live->port());
    wires.back().send("GET " + path + "/view?size=9x" + std::to_string(wires.size()) +
                      " HTTP/1.1\r\nHost: test\r\n\r\n");
    if (wires.size() > 34) refused = wires.back().read("overloaded", 500ms);
  }
  EXPECT_TRUE(refused.starts_with("HTTP/1.1 503 ")) << refused;
  EXPECT_NE(refused.find("overloaded"), std::string::npos);
  EXPECT_NE(refused.find("Retry-After: "), std::string::npos);
  wires.clear();  // all leave, those in line too
  view.holds = false;
  wait_until([&] { return get("").status == 200; });
}

TEST(ViewOfJobs, NeedsAFinishedJobWithALitScene) {
  jobs::FakeBake fake;
  FakeView view;
  server::ServiceParts parts;
  parts.bake = fake.holding();
  parts.view = view.function();
  const Live live(std::move(parts), {});
  const std::string id = post_job(live.port()), path = "/v1/jobs/" + id;
  EXPECT_EQ(wait_for_state(live.port(), id, "running"), "running");
  EXPECT_EQ(ask(live.port(), "GET", path + "/view").status, 425);
  fake.go = true;
  EXPECT_EQ(wait_for_state(live.port(), id, "succeeded"), "succeeded");
  const Answer bare = ask(live.port(), "GET", path + "/view");
  EXPECT_EQ(bare.status, 404);
  EXPECT_NE(bare.body.find("lit.glb"), std::string::npos);
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs/job_x/view").status, 404);
}

}  // namespace
}  // namespace kiln::test
