// The route of visibility: with a stand-in for what traces, and as the built program.
#include <gtest/gtest.h>

#include <unistd.h>
#include <atomic>

#include <cstring>
#include <future>
#include <limits>
#include <mutex>
#include <random>
#include <thread>

#include "baker/import/import.h"
#include "baker/visibility/pairs.h"
#include "tests/http/program.h"

namespace kiln::test {
namespace {

using namespace std::chrono_literals;

const std::string kNobody = std::string(64, '0');

void wait_until(const std::function<bool()>& there) {
  for (int i = 0; i < 20'000 && !there(); ++i) std::this_thread::sleep_for(1ms);
  ASSERT_TRUE(there());
}

/// Remembers what it was asked, and may hold until told to stop.
struct FakeSight {
  std::mutex mutex;
  std::vector<std::string> scenes;
  std::atomic<int> tracing{0}, stopped{0};
  std::atomic<bool> holds{false}, throws{false};
  double cpu_seconds = 0;

  api::VisibilityFunction function() {
    return [this](const api::VisibilityInput& input, exec::ThreadPool&,
                  const std::stop_token& stop) -> api::VisibilityResult {
      {
        const std::lock_guard lock(mutex);
        scenes.push_back(input.scene.key);
      }
      if (throws) throw std::runtime_error("secret");
      ++tracing;
      while (holds && !stop.stop_requested()) std::this_thread::sleep_for(1ms);
      --tracing;
      if (stop.stop_requested()) {
        ++stopped;
        return {proto::fail(proto::kCanceledCode, "Stopped."), cpu_seconds};
      }
      const auto size = std::uint64_t(::lseek(input.pairs, 0, SEEK_END));
      return {api::VisibilityAnswer{"bits", size / 24, 7, true, 0.0125, 0.5}, cpu_seconds};
    };
  }
};

struct VisibilityRoute : testing::Test {
  jobs::FakeBake fake;
  FakeSight sight;
  std::unique_ptr<Live> live;
  std::string scene;

  void begin(base::ServerConfig config = {}) {
    server::ServiceParts parts;
    parts.bake = fake.instant();
    parts.see = sight.function();
    live = std::make_unique<Live>(std::move(parts), std::move(config));
    scene = member(ask(live->port(), "POST", "/v1/scenes", {}, "glTF").body, "id");
  }
  Answer post(const std::string& query, const std::string& body = std::string(48, '\0'),
              const std::vector<std::string>& headers = {}) const {
    return ask(live->port(), "POST", "/v1/visibility" + query, headers, body);
  }
  std::string head() const {
    return "POST /v1/visibility?scene=" + scene +
           " HTTP/1.1\r\nHost: test\r\nContent-Length: 48\r\n";
  }
  static void expect_wrong(const Answer& answer, int status, const std::string& code,
                           const std::string& pointer = {}) {
    EXPECT_EQ(answer.status, status) << answer.body;
    EXPECT_EQ(answer.headers.at("content-type"), "application/problem+json");
    EXPECT_EQ(member(answer.body, "code"), code) << answer.body;
    const std::string named = pointer.empty() ? "" : "\"pointer\": \"" + pointer + "\"";
    EXPECT_NE(answer.body.find(named), std::string::npos) << answer.body;
  }
};

TEST_F(VisibilityRoute, AnswersWithBitsAndFigures) {
  begin();
  const Answer answer = post("?scene=" + scene);
  EXPECT_EQ(answer.status, 200) << answer.body;
  EXPECT_EQ(answer.body, "bits");
  EXPECT_EQ(answer.headers.at("content-type"), "application/octet-stream");
  EXPECT_EQ(answer.headers.at("lightkiln-pairs"), "2");
  EXPECT_EQ(answer.headers.at("lightkiln-visible"), "7");
  EXPECT_EQ(answer.headers.at("server-timing"), "scene;dur=12.500, trace;dur=500.000");
  EXPECT_EQ(post("?scene=" + scene, "", {"Content-Type: application/octet-stream"}).status, 200);
  ASSERT_EQ(sight.scenes.size(), 2u);
  EXPECT_EQ("sha256:" + sight.scenes[0], scene);
  const std::string text = ask(live->service->admin_port(), "GET", "/metrics").body;
  for (const char* line :
       {"\nvisibility_pairs_total 2\n", "\nvisibility_scenes_total{scene=\"kept\"} 2\n",
        "\nvisibility_kept_bytes 0\n"})
    EXPECT_NE(text.find(line), std::string::npos) << line << text;
}

TEST_F(VisibilityRoute, WrongRequestsAreNamed) {
  begin();
  for (const std::string& query :
       {std::string(), std::string("?scene="), "?scene=" + kNobody, "?scene=" + scene + "0",
        "?scene=sha256:" + std::string(64, 'G')})
    expect_wrong(post(query), 400, "bad_request", "/query/scene");
  expect_wrong(post("?scene=sha256:" + kNobody), 404, "not_found", "/query/scene");
  expect_wrong(post("?scene=" + scene + "&pairs=2"), 400, "bad_request", "/query/pairs");
  const std::string query = "?scene=" + scene;
  expect_wrong(post(query, "{}", {"Content-Type: application/json"}), 415,
               "unsupported_media_type");
  expect_wrong(post(query, "x", {"Content-Encoding: gzip"}), 415, "unsupported_media_type");
  expect_wrong(post(query, std::string(24'000'001, 'x')), 413, "payload_too_large");
  EXPECT_EQ(ask(live->port(), "GET", "/v1/visibility" + query).status, 405);
  EXPECT_TRUE(sight.scenes.empty()) << "nothing was traced";
  sight.throws = true;
  const Answer broken = post(query);
  expect_wrong(broken, 500, "internal");
  EXPECT_EQ(broken.body.find("secret"), std::string::npos);
}

TEST_F(VisibilityRoute, StopsWhenTheClientLeaves) {
  begin();
  sight.holds = true;
  auto left = std::chrono::steady_clock::now();
  {
    const Wire wire(live->port());
    wire.send(head() + "\r\n" + std::string(48, '\0'));
    wait_until([&] { return sight.tracing == 1; });
    left = std::chrono::steady_clock::now();
  }
  wait_until([&] { return sight.stopped == 1; });
  EXPECT_LT(std::chrono::steady_clock::now() - left, 1s);
  {
    const Wire wire(live->port());  // and before its pairs are there
    wire.send(head() + "\r\n" + std::string(30, '\0'));
  }
  sight.holds = false;
  EXPECT_EQ(post("?scene=" + scene).status, 200) << "and the next is answered";
  EXPECT_EQ(sight.scenes.size(), 2u);
}

TEST_F(VisibilityRoute, AFullLineIsRefused) {
  begin();
  sight.holds = true;
  std::vector<Wire> wires;
  std::string refused;
  // Four are traced and 32 wait; how soon they are counted is not known.
  while (refused.empty() && wires.size() < 60) {
    wires.emplace_back(live->port());
    wires.back().send(head() + "\r\n" + std::string(48, '\0'));
    if (wires.size() > 36) refused = wires.back().read("overloaded", 500ms);
  }
  EXPECT_TRUE(refused.starts_with("HTTP/1.1 503 ")) << refused;
  EXPECT_NE(refused.find("Retry-After: "), std::string::npos);
  EXPECT_EQ(sight.tracing, 4);
  wires.clear();  // all leave, those in line too
  sight.holds = false;
  wait_until([&] { return post("?scene=" + scene).status == 200; });
}

TEST_F(VisibilityRoute, CountsInTheTenantsDay) {
  base::ServerConfig config;
  config.max_cpu_seconds_per_tenant_per_day = 5;
  begin(config);
  sight.cpu_seconds = 3;
  EXPECT_EQ(post("?scene=" + scene).status, 200);
  EXPECT_NE(ask(live->port(), "GET", "/v1/capabilities").body.find("\"cpu_seconds_today\":3.0"),
            std::string::npos);
  EXPECT_EQ(post("?scene=" + scene).status, 200);
  expect_wrong(post("?scene=" + scene), 429, "quota_exceeded");
  EXPECT_EQ(sight.scenes.size(), 2u);
}

TEST_F(VisibilityRoute, KnowsOwnScenesOnly) {
  begin();
  const auto header = [&](const char* tenant, const std::vector<std::string>& scopes) {
    return "Authorization: Bearer " + live->service->tokens().create(tenant, scopes).value().secret;
  };
  const std::string art = header("art", {"read", "write"}), game = header("game", {"write"});
  const std::string guest = header("art", {"read"}), ops = header("ops", {"admin"});
  const Answer made = ask(live->port(), "POST", "/v1/scenes", {art}, "glTF of art");
  const std::string query = "?scene=" + member(made.body, "id");
  EXPECT_EQ(post(query, "", {art}).status, 200);
  EXPECT_EQ(post(query, "", {ops}).status, 200);
  expect_wrong(post(query, "", {game}), 404, "not_found", "/query/scene");
  expect_wrong(post(query, "", {guest}), 403, "forbidden_scope");
  expect_wrong(post(query, ""), 401, "unauthorized");
  EXPECT_EQ(post("?scene=" + scene, "", {art}).status, 404) << "nobody's";
}

/// The real thing.
class VisibilityProgram : public testing::Test {
 protected:
  TempFolder folder_;
  std::vector<std::string> headers_{"Content-Type: application/octet-stream"};

  static std::string upload(const Program& program, const std::filesystem::path& scene) {
    const Answer stored = ask(program.port(), "POST", "/v1/scenes",
                              {"Content-Type: model/gltf-binary"}, read_bytes(scene));
    EXPECT_EQ(stored.status, 201) << stored.body;
    return member(stored.body, "id");
  }
  Answer post(const Program& program, const std::string& scene, const std::string& pairs) const {
    return ask(program.port(), "POST", "/v1/visibility?scene=" + scene, headers_, pairs);
  }
  static std::string random_pairs(std::size_t count) {
    std::mt19937 random(3);
    std::uniform_real_distribution<float> within(-1, 1);
    std::vector<float> numbers(6 * count);
    for (float& number : numbers) number = within(random);
    return {reinterpret_cast<const char*>(numbers.data()), numbers.size() * sizeof(float)};
  }
  static double metric(const Program& program, const std::string& name) {
    const std::string text = ask(program.admin_port(), "GET", "/metrics").body;
    const auto at = text.find("\n" + name + " ");
    return at == std::string::npos ? 0 : std::stod(text.substr(at + name.size() + 2));
  }
};

TEST_F(VisibilityProgram, GivesTheBitsThatTheSceneHas) {
  const auto file = write_scene(folder_.path(), "cornell");
  const auto scene = import::import_files({file, {}, {}}).value();
  const auto rays = trace::RayScene::build(scene).value();
  exec::ThreadPool pool(1);
  const std::string pairs = random_pairs(100'001);
  const auto expected = visibility::see(rays, pairs, {pool, {}}).value();
  ASSERT_GT(expected.visible, 10'000u);

  const Program program(folder_.path() / "data");
  const std::string id = upload(program, file);
  std::vector<std::future<Answer>> answers;
  for (int i = 0; i < 6; ++i)
    answers.push_back(std::async(std::launch::async, [&] { return post(program, id, pairs); }));
  for (auto& one : answers) {
    const Answer answer = one.get();
    EXPECT_EQ(answer.status, 200) << answer.body.substr(0, 500);
    EXPECT_TRUE(answer.body == expected.bits);
    EXPECT_EQ(answer.headers.at("lightkiln-pairs"), "100001");
    EXPECT_EQ(answer.headers.at("lightkiln-visible"), std::to_string(expected.visible));
  }
  EXPECT_EQ(metric(program, "visibility_scenes_total{scene=\"made\"}"), 1);
  EXPECT_EQ(metric(program, "visibility_scenes_total{scene=\"kept\"}"), 5);
  EXPECT_EQ(metric(program, "visibility_pairs_total"), 6 * 100'001);
  EXPECT_EQ(metric(program, "visibility_kept_bytes"), double(rays.memory_bytes()));
  EXPECT_EQ(metric(program, "memory_reserved_bytes"), double(rays.memory_bytes()));
  const Answer most = post(program, id, random_pairs(visibility::kMostPairs));
  EXPECT_EQ(most.status, 200) << most.body.substr(0, 500);
  EXPECT_EQ(most.body.size(), 125'000u);
}

TEST_F(VisibilityProgram, RefusesWrongPairsAndDamagedScenes) {
  const Program program(folder_.path() / "data", {"--visibility-cache-bytes", "0"});
  const std::string id = upload(program, write_scene(folder_.path(), "cornell"));
  std::string pairs = random_pairs(5'000);
  const auto expect_wrong = [&](const std::string& body, const std::string& pointer) {
    const Answer answer = post(program, id, body);
    EXPECT_EQ(answer.status, 422);
    EXPECT_EQ(member(answer.body, "code"), "invalid_request") << answer.body;
    EXPECT_NE(answer.body.find("\"pointer\": \"" + pointer + "\""), std::string::npos)
        << answer.body;
  };
  expect_wrong(pairs.substr(0, 25), "/body");
  const float wrong = std::numeric_limits<float>::infinity();
  std::memcpy(pairs.data() + 24 * 4'321 + 12, &wrong, sizeof wrong);
  expect_wrong(pairs, "/body/4321/3");
  EXPECT_EQ(metric(program, "visibility_scenes_total{scene=\"made\"}"), 0);

  // The check of an upload decodes no images: what is wrong with them is found when it is read.
  std::string textured = read_bytes(write_scene(folder_.path(), "room_textured"));
  const auto png = textured.find("\x89PNG");
  ASSERT_NE(png, std::string::npos);
  std::fill_n(textured.begin() + std::ptrdiff_t(png) + 60, 200, '\0');
  const std::string damaged = upload(program, folder_.write("damaged.glb", textured));
  const Answer answer = post(program, damaged, random_pairs(3));
  EXPECT_EQ(answer.status, 422) << answer.body;
  EXPECT_EQ(member(answer.body, "code"), "invalid_image");
  for (int i = 0; i < 2; ++i) EXPECT_EQ(post(program, id, random_pairs(3)).status, 200);
  EXPECT_EQ(metric(program, "visibility_scenes_total{scene=\"made\"}"), 2) << "none is kept";
  EXPECT_EQ(metric(program, "memory_reserved_bytes"), 0);
}

}  // namespace
}  // namespace kiln::test
