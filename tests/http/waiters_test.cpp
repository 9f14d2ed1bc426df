#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <chrono>
#include <string>
#include <thread>
#include <vector>

#include "program.h"
#include "proto/files.h"

/// Requests that wait for a job hold a thread each: they must not take them all.
namespace kiln::server {
namespace {

using Clock = std::chrono::steady_clock;

proto::Fd send_request(std::uint16_t port, const std::string& path) {
  proto::Fd fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in to{};
  to.sin_family = AF_INET;
  to.sin_port = htons(port);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  EXPECT_EQ(::connect(fd.get(), reinterpret_cast<const sockaddr*>(&to), sizeof to), 0);
  const std::string text = "GET " + path + " HTTP/1.1\r\nHost: x\r\n\r\n";
  EXPECT_EQ(::send(fd.get(), text.data(), text.size(), MSG_NOSIGNAL), ssize_t(text.size()));
  return fd;
}

bool is_answered(const proto::Fd& fd) {
  pollfd one{fd.get(), POLLIN, 0};
  return ::poll(&one, 1, 0) > 0;
}

TEST(Waiters, FiveHundredOfThemKeepNobodyElseWaiting) {
  const test::TempFolder folder;
  constexpr unsigned kThreads = 6;
  Program program(folder.path() / "data",
                  {"--http-threads", std::to_string(kThreads), "--threads", "1"});
  const auto scene = write_scene(folder.path(), "cornell");
  const std::string id = post_job(program, scene, kLongBake);
  std::vector<proto::Fd> waiters;
  for (int i = 0; i < 500; ++i)
    waiters.push_back(send_request(program.port(), "/v1/jobs/" + id + "?wait=60"));
  const auto at_once = [&](const char* what, const auto& use) {
    const auto began = Clock::now();
    use();
    const std::chrono::duration<double> took = Clock::now() - began;
    EXPECT_LT(took.count(), 20.0) << what;  // a wait is sixty seconds
  };
  std::string other;
  for (int round = 0; round < 5; ++round) {
    at_once("health", [&] { EXPECT_EQ(ask(program.admin_port(), "GET", "/healthz").status, 200); });
    at_once("job", [&] { EXPECT_EQ(ask(program.port(), "GET", "/v1/jobs/" + id).status, 200); });
    at_once("submit", [&] { other = post_job(program, scene, kLongBake); });
    EXPECT_EQ(other.substr(0, 4), "job_");
  }
  // Half of the threads wait. The others are told what is known now.
  const auto late = Clock::now() + std::chrono::seconds(20);
  std::size_t open = waiters.size();
  while (open > kThreads / 2 && Clock::now() < late) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    open = 0;
    for (const auto& fd : waiters) open += !is_answered(fd);
  }
  EXPECT_EQ(open, kThreads / 2);
  EXPECT_EQ(ask(program.port(), "POST", "/v1/jobs/" + id + "/cancel").status, 202);
  const auto soon = Clock::now() + std::chrono::seconds(20);
  while (open > 0 && Clock::now() < soon) {
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
    open = 0;
    for (const auto& fd : waiters) open += !is_answered(fd);
  }
  EXPECT_EQ(open, 0u) << "those that wait hear of its end";
}

}  // namespace
}  // namespace kiln::server
