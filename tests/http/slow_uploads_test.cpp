#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <thread>
#include <vector>

#include "tests/http/live.h"
#include "tests/support/sanitizer.h"

/// Bodies that arrive slowly, and answers that are taken slowly, hold no request thread.
namespace kiln::test {
namespace {

using std::chrono::milliseconds;
using std::chrono::seconds;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kPiece = 4'000;
constexpr int kPieces = 10;

std::string scene_head(std::size_t bytes) {
  return "POST /v1/scenes HTTP/1.1\r\nHost: x\r\nContent-Type: model/gltf-binary\r\n"
         "Content-Length: " +
         std::to_string(bytes) + "\r\n\r\n";
}

/// Uploads that have begun and wait for their clients.
std::vector<Wire> begin_uploads(const Live& live, int count, const char* from = "127.0.0.1") {
  std::vector<Wire> wires;
  for (int i = 0; i < count; ++i) {
    wires.emplace_back(live.port(), from);
    EXPECT_TRUE(wires.back().send(scene_head(kPieces * kPiece) + std::string(kPiece, 'a')));
  }
  return wires;
}

void expect_uploads(const Live& live, std::size_t count) {
  const std::string line = "\nhttp_uploads " + std::to_string(count) + "\n";
  const auto late = Clock::now() + seconds(20);
  std::string all;
  while (all.find(line) == std::string::npos && Clock::now() < late)
    all = ask(live.service->admin_port(), "GET", "/metrics").body;
  EXPECT_NE(all.find(line), std::string::npos) << all;
}

base::ServerConfig few_threads(unsigned threads) {
  base::ServerConfig config;
  config.http_threads = threads;
  config.max_uploads_per_address = config.max_uploads_per_tenant = 0;
  return config;
}

// With a thread for each of them, nobody else is answered before one of these has ended.
TEST(SlowUploads, MoreThanThereAreThreadsLeaveAllOfThemFree) {
  jobs::FakeBake fake;
  const Live live(fake.instant(), few_threads(4));
  const auto wires = begin_uploads(live, 20);
  expect_uploads(live, 20);
  const auto began = Clock::now();
  for (int i = 0; i < 10; ++i) EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs").status, 200);
  EXPECT_LT(Clock::now() - began, seconds(2) * kSlowdown);
  for (int piece = 1; piece < kPieces; ++piece)
    for (const Wire& wire : wires) ASSERT_TRUE(wire.send(std::string(kPiece, 'a')));
  for (const Wire& wire : wires) {
    const std::string text = wire.read("\r\n\r\n", seconds(20));
    EXPECT_TRUE(text.starts_with("HTTP/1.1 20")) << text;
  }
  expect_uploads(live, 0);
}

TEST(SlowUploads, HundredsBesideShortRequests) {
  constexpr int kUploads = 300;
  jobs::FakeBake fake;
  const Live live(fake.instant(), few_threads(8));
  const auto wires = begin_uploads(live, kUploads);
  expect_uploads(live, kUploads);
  std::atomic<bool> sent{false};
  std::thread senders([&] {  // two pieces of each a second
    for (int piece = 1; piece < kPieces; ++piece) {
      for (std::size_t i = 0; i < wires.size(); ++i) {
        wires[i].send(std::string(kPiece, 'a'));
        if (i % 10 == 0) std::this_thread::sleep_for(milliseconds(10));
      }
    }
    sent = true;
  });
  const Wire wire(live.port());
  std::vector<Clock::duration> times;
  while (!sent) {
    const auto began = Clock::now();
    wire.send("GET /v1/jobs HTTP/1.1\r\nHost: x\r\n\r\n");
    ASSERT_NE(wire.read("next_cursor\":null}\n").find("HTTP/1.1 200"), std::string::npos);
    times.push_back(Clock::now() - began);
    std::this_thread::sleep_for(milliseconds(1));
  }
  senders.join();
  std::sort(times.begin(), times.end());
  EXPECT_LT(times[times.size() * 99 / 100], milliseconds(50) * kSlowdown);
  for (const Wire& upload : wires)
    EXPECT_TRUE(upload.read("\r\n\r\n", seconds(20)).starts_with("HTTP/1.1 20"));
  EXPECT_TRUE(std::filesystem::is_empty(live.folder.path() / "data" / "tmp"));
}

TEST(SlowUploads, OfOneAddressAreLimitedBeforeAByteIsKept) {
  jobs::FakeBake fake;
  base::ServerConfig config = few_threads(4);
  config.max_uploads_per_address = 3;
  const Live live(fake.instant(), config);
  auto wires = begin_uploads(live, 3);
  expect_uploads(live, 3);
  const Wire fourth(live.port());
  fourth.send(
      "POST /v1/scenes HTTP/1.1\r\nHost: x\r\nExpect: 100-continue\r\n"
      "Content-Length: 40000\r\n\r\n");
  const std::string text = fourth.read("}\n");
  EXPECT_TRUE(text.starts_with("HTTP/1.1 429")) << text;
  EXPECT_NE(text.find("\"too_many_uploads\""), std::string::npos) << text;
  EXPECT_NE(text.find("\r\nRetry-After: "), std::string::npos) << text;
  EXPECT_NE(text.find("\r\nConnection: close\r\n"), std::string::npos) << text;
  const auto entries = std::filesystem::directory_iterator(live.folder.path() / "data" / "tmp");
  EXPECT_EQ(std::distance(begin(entries), end(entries)), 3) << "nothing of the fourth";

  const auto others = begin_uploads(live, 3, "127.0.0.2");
  expect_uploads(live, 6);
  EXPECT_EQ(ask(live.port(), "POST", "/v1/scenes", {}, "glTF").status, 201)
      << "a body that comes with its head is no upload that waits";
  wires.pop_back();  // who goes makes room
  expect_uploads(live, 5);
  EXPECT_EQ(begin_uploads(live, 1).size(), 1u);
}

TEST(SlowUploads, OfOneTenantAreLimited) {
  jobs::FakeBake fake;
  base::ServerConfig config = few_threads(4);
  config.max_uploads_per_tenant = 2;
  const Live live(fake.instant(), config);
  const auto begin = [&](const std::string& tenant, const char* from) {
    const auto token = live.service->tokens().create(tenant, {"read", "write"}).value().secret;
    Wire wire(live.port(), from);
    wire.send("POST /v1/scenes HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer " + token +
              "\r\nContent-Length: 40000\r\n\r\nglTF");
    return wire;
  };
  const Wire first = begin("art", "127.0.0.1"), second = begin("art", "127.0.0.2");
  expect_uploads(live, 2);
  EXPECT_TRUE(begin("art", "127.0.0.3").read("}\n").starts_with("HTTP/1.1 429"));
  const Wire other = begin("game", "127.0.0.1");
  expect_uploads(live, 3);
}

// Its token, its size and its type are judged from the head: the body is not waited for.
TEST(SlowUploads, AreRefusedByTheirHeads) {
  jobs::FakeBake fake;
  base::ServerConfig config = few_threads(2);
  config.max_upload_bytes = 100'000;
  const Live live(fake.instant(), config);
  for (const auto& [extra, status] : std::vector<std::pair<std::string, std::string>>{
           {"Content-Length: 100001", "413"},
           {"Content-Length: 9\r\nContent-Type: text/plain", "415"},
           {"Content-Length: 9\r\nContent-Encoding: gzip", "415"},
           {"Content-Length: 9\r\nOrigin: http://elsewhere", "403"}}) {
    const Wire wire(live.port());
    wire.send("POST /v1/scenes HTTP/1.1\r\nHost: x\r\nExpect: 100-continue\r\n" + extra +
              "\r\n\r\n");
    EXPECT_TRUE(wire.read("}\n").starts_with("HTTP/1.1 " + status)) << extra;
  }
  const Wire welcome(live.port());
  welcome.send(
      "POST /v1/scenes HTTP/1.1\r\nHost: x\r\nExpect: 100-continue\r\nContent-Length: 4\r\n\r\n");
  EXPECT_EQ(welcome.read("\r\n\r\n"), "HTTP/1.1 100 Continue\r\n\r\n");
  welcome.send("glTF");
  EXPECT_TRUE(welcome.read("}\n").starts_with("HTTP/1.1 201"));
}

/// A client whose socket takes little and that reads nothing until it is asked to.
class SlowReader {
 public:
  SlowReader(std::uint16_t port, const std::string& request)
      : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const int small = 2'048;
    ::setsockopt(fd_.get(), SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::connect(fd_.get(), reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
    EXPECT_EQ(::send(fd_.get(), request.data(), request.size(), 0), ssize_t(request.size()));
  }
  std::string read_all() const {
    std::string all;
    char piece[4'096];
    for (;;) {
      const ssize_t got = ::recv(fd_.get(), piece, sizeof piece, 0);
      if (got <= 0) return all;
      all.append(piece, static_cast<std::size_t>(got));
    }
  }

 private:
  proto::Fd fd_;
};

TEST(SlowDownloads, HoldNoThread) {
  jobs::FakeBake fake;
  const Live live(fake.instant(), few_threads(2));
  const std::string id = post_job(live.port());
  ASSERT_EQ(wait_for_state(live.port(), id, "succeeded"), "succeeded");
  const std::string path = "/v1/jobs/" + id + "/results/page_00.exr";
  const std::string whole = ask(live.port(), "GET", path).body;
  ASSERT_EQ(whole.size(), 100'000u);
  std::vector<std::unique_ptr<SlowReader>> readers;
  for (int i = 0; i < 6; ++i)
    readers.push_back(std::make_unique<SlowReader>(
        live.port(), "GET " + path + " HTTP/1.1\r\nHost: x\r\nConnection: close\r\n\r\n"));
  std::this_thread::sleep_for(milliseconds(200));
  const auto began = Clock::now();
  for (int i = 0; i < 10; ++i) EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs").status, 200);
  EXPECT_LT(Clock::now() - began, seconds(2) * kSlowdown);
  for (const auto& reader : readers) {
    const std::string text = reader->read_all();
    EXPECT_EQ(text.substr(text.find("\r\n\r\n") + 4), whole);
  }
}

}  // namespace
}  // namespace kiln::test
