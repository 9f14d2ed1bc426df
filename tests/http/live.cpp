#include "tests/http/live.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <nlohmann/json.hpp>
#include <thread>

#include "server/base/log.h"

namespace kiln::test {

namespace {

server::ServiceParts parts_of(jobs::BakeFunction bake, http::EdgeLimits limits,
                              api::CheckFunction check) {
  server::ServiceParts parts;
  parts.bake = std::move(bake);
  parts.check = std::move(check);
  parts.limits = limits;
  return parts;
}

}  // namespace

Live::Live(jobs::BakeFunction bake, base::ServerConfig config, http::EdgeLimits limits,
           api::CheckFunction check)
    : Live(parts_of(std::move(bake), limits, std::move(check)), std::move(config)) {}

Live::Live(server::ServiceParts parts, base::ServerConfig config) {
  set_up_log("off", base::LogFormat::kText);
  config.port = config.admin_port = 0;
  if (config.data == base::ServerConfig{}.data) config.data = folder.path() / "data";
  if (!parts.check)
    parts.check = [](const files::SceneFiles&, const proto::BakeSettings&) {
      return proto::Expected<void>();
    };
  auto started = server::Service::start(config, std::move(parts));
  if (!started) throw std::runtime_error(started.error().message);
  service = std::move(*started);
}

Wire::Wire(std::uint16_t port, const char* from)
    : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  ::inet_pton(AF_INET, from, &address.sin_addr);
  ::bind(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address);
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  if (::connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) {
    ::close(fd_);
    fd_ = -1;
  }
}

Wire::~Wire() {
  if (fd_ >= 0) ::close(fd_);
}

bool Wire::send(std::string_view bytes) const {
  while (!bytes.empty()) {
    const ssize_t sent = ::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
    if (sent <= 0) return false;
    bytes.remove_prefix(static_cast<std::size_t>(sent));
  }
  return true;
}

void Wire::finish() const {
  ::shutdown(fd_, SHUT_WR);
}

std::string Wire::read(const std::string& until, std::chrono::milliseconds time) const {
  const auto deadline = std::chrono::steady_clock::now() + time;
  std::string text;
  for (;;) {
    if (!until.empty() && text.find(until) != std::string::npos) return text;
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(
        deadline - std::chrono::steady_clock::now());
    pollfd p{fd_, POLLIN, 0};
    if (left.count() <= 0 || ::poll(&p, 1, static_cast<int>(left.count())) <= 0) return text;
    char piece[65536];
    const ssize_t got = ::recv(fd_, piece, sizeof piece, 0);
    if (got <= 0) return text;
    text.append(piece, static_cast<std::size_t>(got));
  }
}

bool Wire::closed(std::chrono::milliseconds time) const {
  const auto deadline = std::chrono::steady_clock::now() + time;
  while (std::chrono::steady_clock::now() < deadline) {
    pollfd p{fd_, POLLIN, 0};
    if (::poll(&p, 1, 50) <= 0) continue;
    char piece[4096];
    if (::recv(fd_, piece, sizeof piece, 0) <= 0) return true;
  }
  return false;
}

bool read_head(const std::string& text, Answer& answer) {
  const auto end = text.find("\r\n\r\n");
  if (!text.starts_with("HTTP/1.1 ") || end == std::string::npos) return false;
  answer.status = std::stoi(text.substr(9, 3));
  for (auto at = text.find("\r\n") + 2; at < end;) {
    const auto line_end = text.find("\r\n", at);
    const auto colon = text.find(':', at);
    std::string name = text.substr(at, colon - at);
    std::transform(name.begin(), name.end(), name.begin(),
                   [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
    answer.headers[name] = text.substr(colon + 2, line_end - colon - 2);
    at = line_end + 2;
  }
  return true;
}

Answer ask(std::uint16_t port, const std::string& method, const std::string& target,
           const std::vector<std::string>& headers, const std::string& body) {
  const Wire wire(port);
  std::string head = method + " " + target + " HTTP/1.1\r\nHost: test\r\nConnection: close\r\n";
  for (const auto& header : headers) head += header + "\r\n";
  if (!body.empty() || method == "POST")
    head += "Content-Length: " + std::to_string(body.size()) + "\r\n";
  wire.send(head + "\r\n" + body);
  const std::string text = wire.read({}, std::chrono::seconds(60));
  Answer answer;
  if (read_head(text, answer)) answer.body = text.substr(text.find("\r\n\r\n") + 4);
  return answer;
}

std::string form(const std::vector<std::pair<std::string, std::string>>& parts) {
  std::string body;
  for (const auto& [disposition, content] : parts)
    body += "--B\r\nContent-Disposition: form-data; " + disposition + "\r\n\r\n" + content + "\r\n";
  return body + "--B--\r\n";
}

std::string post_job(std::uint16_t port) {
  const Answer answer = ask(port, "POST", "/v1/jobs", {kForm},
                            form({{"name=\"scene\"; filename=\"a.glb\"", "glTF"},
                                  {"name=\"options\"", R"({"dedupe":false})"}}));
  EXPECT_EQ(answer.status, 202) << answer.body;
  return member(answer.body, "id");
}

std::string member(const std::string& text, const std::string& key) {
  const auto document = nlohmann::json::parse(text, nullptr, false);
  if (!document.is_object() || !document.contains(key)) return "(no " + key + ")";
  return document[key].is_string() ? document[key].get<std::string>() : document[key].dump();
}

std::string wait_for_state(std::uint16_t port, const std::string& id, const std::string& state) {
  std::string now;
  for (int i = 0; i < 3000; ++i) {
    now = member(ask(port, "GET", "/v1/jobs/" + id).body, "state");
    if (now == state) break;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return now;
}

}  // namespace kiln::test
