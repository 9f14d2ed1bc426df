#include "clients/client.h"

#include <gtest/gtest.h>
#include <httplib.h>

#include <atomic>
#include <nlohmann/json.hpp>
#include <thread>

#include "proto/json.h"
#include "tests/support/temp_files.h"

namespace kiln::clients {
namespace {

using nlohmann::json;

constexpr const char* kId = "job_0123456789abcdefghijklmnop";
// SHA-256 of "abc".
constexpr const char* kAbc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";

/// A service that answers what the test wants it to.
class FakeService {
 public:
  httplib::Server http;

  void start() {
    port_ = http.bind_to_any_port("127.0.0.1");
    thread_ = std::thread([this] { http.listen_after_bind(); });
    while (!http.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  ~FakeService() {
    http.stop();
    if (thread_.joinable()) thread_.join();
  }
  ServerUrl url() const { return {"http://127.0.0.1:" + std::to_string(port_), ""}; }

 private:
  int port_ = 0;
  std::thread thread_;
};

std::string job_text(proto::JobState state = proto::JobState::kQueued) {
  proto::Job job;
  job.id = kId;
  job.state = state;
  return proto::to_text(proto::to_json(job));
}

std::string job_path(const std::string& below = "") {
  return "/v1/jobs/" + std::string(kId) + below;
}

TEST(Client, SubmitSendsEveryPartAsItIs) {
  const test::TempFolder dir;
  const std::string bytes = std::string(700'000, 'x') + std::string("\r\n--\0", 5);
  FakeService service;
  httplib::MultipartFormDataMap parts;
  service.http.Post("/v1/jobs", [&](const httplib::Request& req, httplib::Response& res) {
    parts = req.files;
    EXPECT_TRUE(req.has_header("Content-Length"));
    res.status = 202;
    res.set_content(job_text(), "application/json");
  });
  service.start();
  Client client(service.url());
  const auto job = client.submit({dir.write("room.gltf", bytes),
                                  {{"tex/wood.png", dir.write("w", "wood")}},
                                  R"({"solver":{"samples":4}})",
                                  {7, {{"a", "b"}}, std::nullopt, false, std::nullopt}});
  ASSERT_TRUE(job) << job.error().message;
  EXPECT_EQ(job->id, kId);
  ASSERT_EQ(parts.count("scene"), 1u);
  EXPECT_EQ(parts.find("scene")->second.content, bytes);
  EXPECT_EQ(parts.find("scene")->second.filename, "room.gltf");
  EXPECT_EQ(parts.find("file")->second.filename, "tex/wood.png");
  EXPECT_EQ(parts.find("settings")->second.content, R"({"solver":{"samples":4}})");
  EXPECT_EQ(parts.find("options")->second.content,
            R"({"dedupe":false,"labels":{"a":"b"},"priority":7})");
}

TEST(Client, ASceneThatTheServiceHasIsNotSent) {
  const test::TempFolder dir;
  FakeService service;
  json sent;
  // httplib answers HEAD by the GET route.
  service.http.Get("/v1/scenes/sha256:" + std::string(kAbc),
                   [](const httplib::Request&, httplib::Response& res) { res.status = 200; });
  service.http.Post("/v1/jobs", [&](const httplib::Request& req, httplib::Response& res) {
    EXPECT_EQ(req.get_header_value("Content-Type"), "application/json");
    sent = json::parse(req.body);
    res.status = 202;
    res.set_content(job_text(), "application/json");
  });
  service.start();
  const auto job =
      Client(service.url()).submit({dir.write("a.glb", "abc"), {}, R"({"solver":{"seed":4}})", {}});
  ASSERT_TRUE(job) << job.error().message;
  EXPECT_EQ(sent["scene"], "sha256:" + std::string(kAbc));
  EXPECT_EQ(sent["settings"]["solver"]["seed"], 4);
  EXPECT_EQ(sent["dedupe"], true);
  EXPECT_FALSE(sent.contains("ttl_seconds"));
}

/// Takes an upload in pieces of at most `piece` bytes, and breaks the connection after each.
struct FakeUploads {
  std::string received;
  std::size_t piece = 3'000'000;
  int patches = 0;

  void serve(httplib::Server& http, std::size_t length) {
    http.Post("/v1/uploads", [=](const httplib::Request& req, httplib::Response& res) {
      EXPECT_EQ(req.get_header_value("Upload-Length"), std::to_string(length));
      EXPECT_TRUE(req.get_header_value("Idempotency-Key").starts_with("scene-"));
      res.status = 201;
      res.set_header("Location", "/v1/uploads/upl_1");
      res.set_header("Upload-Offset", "0");
    });
    http.Get("/v1/uploads/upl_1", [this](const httplib::Request&, httplib::Response& res) {
      res.set_header("Upload-Offset", std::to_string(received.size()));
    });
    http.Patch("/v1/uploads/upl_1", [=, this](const httplib::Request& req, httplib::Response& res,
                                              const httplib::ContentReader& body) {
      ++patches;
      EXPECT_EQ(req.get_header_value("Upload-Offset"), std::to_string(received.size()));
      std::size_t taken = 0;
      const bool whole = body([&](const char* data, std::size_t size) {
        const std::size_t fits = std::min(size, piece - taken);
        received.append(data, fits);
        taken += fits;
        return fits == size;
      });
      if (!whole) {  // the connection breaks in the answer
        res.status = 200;
        res.set_content_provider(1, "text/plain", [](auto, auto, auto&) { return false; });
        return;
      }
      if (received.size() < length) return;
      res.status = 201;
      res.set_content(R"({"id":"sha256:whole"})", "application/json");
    });
  }
};

TEST(Client, ALargeUploadGoesOnWhereItBroke) {
  const test::TempFolder dir;
  std::string bytes(Client::kResumableBytes, 'a');
  for (std::size_t i = 0; i < bytes.size(); i += 997) bytes[i] = static_cast<char>(i >> 8);
  FakeService service;
  FakeUploads uploads;
  uploads.serve(service.http, bytes.size());
  std::string scene;
  service.http.Post("/v1/jobs", [&](const httplib::Request& req, httplib::Response& res) {
    scene = json::parse(req.body)["scene"];
    res.status = 202;
    res.set_content(job_text(), "application/json");
  });
  service.start();
  RetryPolicy quick;
  quick.first = quick.longest = std::chrono::milliseconds(10);
  const auto job = Client(service.url()).submit({dir.write("a.glb", bytes), {}, "", {}}, quick);
  ASSERT_TRUE(job) << job.error().message;
  EXPECT_EQ(scene, "sha256:whole");
  EXPECT_TRUE(uploads.received == bytes);
  EXPECT_GE(uploads.patches, 3);
}

TEST(Client, AServiceWithoutUploadsGetsALargeSceneAtOnce) {
  const test::TempFolder dir;
  FakeService service;
  std::size_t received = 0;
  service.http.Post("/v1/jobs", [&](const httplib::Request& req, httplib::Response& res) {
    received = req.files.find("scene")->second.content.size();
    res.status = 202;
    res.set_content(job_text(), "application/json");
  });
  service.start();
  const std::string bytes(Client::kResumableBytes, 'a');
  ASSERT_TRUE(Client(service.url()).submit({dir.write("a.glb", bytes), {}, "", {}}));
  EXPECT_EQ(received, bytes.size());
}

TEST(Client, AnUploadThatNobodyTakesIsGivenUp) {
  const test::TempFolder dir;
  FakeService service;
  service.http.Post("/v1/uploads", [](const httplib::Request&, httplib::Response& res) {
    res.status = 503;
    res.set_content(proto::to_text(proto::problem_json({"draining", "Going.", {}}, 503, "r")),
                    "application/problem+json");
  });
  service.start();
  RetryPolicy quick;
  quick.first = quick.longest = std::chrono::milliseconds(10);
  quick.give_up = std::chrono::milliseconds(100);
  const auto job =
      Client(service.url())
          .submit({dir.write("a.glb", std::string(Client::kResumableBytes, 'a')), {}, "", {}},
                  quick);
  ASSERT_FALSE(job);
  EXPECT_EQ(job.error().code, "draining");
}

TEST(Client, TheServicesProblemsComeThrough) {
  FakeService service;
  const proto::Error problem{"not_found", "no such job", {{"request", "/id", "gone"}}};
  service.http.Get(job_path(), [&](const httplib::Request&, httplib::Response& res) {
    res.status = 404;
    res.set_content(proto::to_text(proto::problem_json(problem, 404, "r")),
                    "application/problem+json");
  });
  service.http.Get("/v1/jobs", [&](const httplib::Request&, httplib::Response& res) {
    res.set_content("<html>hello", "text/html");
  });
  service.start();
  Client client(service.url());
  const auto job = client.job(kId);
  ASSERT_FALSE(job);
  EXPECT_EQ(proto::to_json(job.error()), proto::to_json(problem));
  EXPECT_EQ(client.jobs().error().code, "bad_document");
  EXPECT_EQ(client.cancel(kId).error().code, "bad_document");  // A bare 404.
  EXPECT_EQ(client.job("../../x").error().code, "bad_request");
  EXPECT_EQ(Client({"http://127.0.0.1:1", ""}).job(kId).error().code, "server_unreachable");
}

/// An event stream that breaks after every second event.
void serve_events(FakeService& service, std::atomic<int>& connections, std::vector<int>& resumed) {
  service.http.Get(job_path("/events"), [&](const httplib::Request& req, httplib::Response& res) {
    ++connections;
    const std::string last = req.get_header_value("Last-Event-ID");
    const int after = last.empty() ? 0 : std::stoi(last);
    resumed.push_back(after);
    std::string text = "retry: 1\n\n";
    for (int id = after + 1; id <= std::min(after + 2, 7); ++id)
      text += "id: " + std::to_string(id) + "\nevent: " + (id == 7 ? "job.end" : "log") +
              "\ndata: {}\n\n";
    text += "id: 99\ndata: half an ev";
    res.set_content(text, "text/event-stream");
  });
}

TEST(Client, FollowResumesWhereTheStreamBroke) {
  FakeService service;
  std::atomic<int> connections = 0;
  std::vector<int> resumed;
  serve_events(service, connections, resumed);
  service.start();
  Client client(service.url());
  std::vector<std::uint64_t> ids;
  const RetryPolicy policy{.first = std::chrono::milliseconds(1)};
  const auto done = client.follow(
      kId, 0,
      [&](const proto::Event& e) {
        ids.push_back(e.id);
        return true;
      },
      policy);
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_EQ(ids, (std::vector<std::uint64_t>{1, 2, 3, 4, 5, 6, 7}));
  EXPECT_EQ(resumed, (std::vector<int>{0, 2, 4, 6}));
}

TEST(Client, FollowEndsWhenTheHandlerHasHadEnough) {
  FakeService service;
  std::atomic<int> connections = 0;
  std::vector<int> resumed;
  serve_events(service, connections, resumed);
  service.start();
  Client client(service.url());
  EXPECT_TRUE(client.follow(kId, 3, [](const proto::Event&) { return false; }));
  EXPECT_EQ(connections, 1);
  EXPECT_EQ(resumed, std::vector<int>{3});
}

TEST(Client, FollowGivesUpInTheEnd) {
  const RetryPolicy policy{.first = std::chrono::milliseconds(1),
                           .longest = std::chrono::milliseconds(5),
                           .give_up = std::chrono::milliseconds(50)};
  const auto handler = [](const proto::Event&) { return true; };
  EXPECT_EQ(Client({"http://127.0.0.1:1", ""}).follow(kId, 0, handler, policy).error().code,
            "server_unreachable");
  FakeService service;  // Answers, but knows no such job.
  service.start();
  EXPECT_EQ(Client(service.url()).follow(kId, 0, handler, policy).error().code, "bad_document");
}

struct ResultsService : FakeService {
  std::string listed = kAbc, body = "abc";
  std::string name = "page_00.exr";

  ResultsService() {
    http.Get(job_path("/results"), [this](const httplib::Request&, httplib::Response& res) {
      const json file{
          {"name", name}, {"media_type", "image/x-exr"}, {"bytes", 3}, {"sha256", listed}};
      res.set_content(json{{"files", {file}}}.dump(), "application/json");
    });
    http.Get(job_path("/results/(.+)"), [this](const httplib::Request&, httplib::Response& res) {
      res.set_content(body, "image/x-exr");
    });
    start();
  }
};

TEST(Client, DownloadsAreVerified) {
  const test::TempFolder dir;
  ResultsService service;
  Client client(service.url());
  const auto files = client.results(kId);
  ASSERT_TRUE(files) << files.error().message;
  ASSERT_EQ(files->size(), 2u);
  EXPECT_EQ(files->back().name, "manifest.json");
  ASSERT_TRUE(client.download(kId, files->front(), dir.path()));
  EXPECT_EQ(test::read_bytes(dir.path() / "page_00.exr"), "abc");

  service.body = "abd";  // A right file is kept without asking; a wrong one never appears.
  EXPECT_TRUE(client.download(kId, files->front(), dir.path()));
  std::filesystem::remove(dir.path() / "page_00.exr");
  EXPECT_EQ(client.download(kId, files->front(), dir.path()).error().code, "digest_mismatch");
  EXPECT_TRUE(std::filesystem::is_empty(dir.path()));
}

TEST(Client, ResultNamesThatLeaveTheFolderAreRefused) {
  const test::TempFolder dir;
  ResultsService service;
  service.name = "../evil";
  Client client(service.url());
  EXPECT_EQ(client.results(kId).error().code, "bad_document");
  EXPECT_EQ(client.download(kId, {"../evil", "", 0, ""}, dir.path()).error().code, "bad_request");
}

}  // namespace
}  // namespace kiln::clients
