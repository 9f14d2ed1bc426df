#include <algorithm>
#include <thread>
#include <utility>

#include "clients/client_impl.h"
#include "clients/sse_parser.h"

namespace kiln::clients {
namespace {

using Clock = std::chrono::steady_clock;
using std::chrono::milliseconds;

/// The way in which one connection ended.
enum class Outcome {
  kEnded,   ///< the job is over, or the handler asked to stop
  kLost,    ///< another try may succeed
  kFailed,  ///< `error` says why
};

class Follower {
 public:
  Follower(const ServerUrl& url, const std::string& token, std::string path,
           const std::function<bool(const proto::Event&)>& handler, const RetryPolicy& policy)
      : url_(url), token_(token), path_(std::move(path)), handler_(handler), policy_(policy) {}

  proto::Expected<void> run(std::uint64_t after) {
    last_id_ = after;
    milliseconds pause = policy_.first;
    auto heard = Clock::now();
    while (true) {
      answered_ = false;
      const Outcome outcome = connect();
      if (outcome == Outcome::kEnded) return {};
      if (outcome == Outcome::kFailed) return proto::Unexpected(std::move(error_));
      if (answered_) {
        heard = Clock::now();
        pause = policy_.first;
      }
      if (Clock::now() - heard > policy_.give_up) return proto::Unexpected(std::move(error_));
      std::this_thread::sleep_for(std::max(pause, server_pause()));
      pause = std::min(2 * pause, policy_.longest);
    }
  }

 private:
  const ServerUrl& url_;
  const std::string& token_;
  const std::string path_;
  const std::function<bool(const proto::Event&)>& handler_;
  const RetryPolicy& policy_;
  SseParser parser_;
  std::uint64_t last_id_ = 0;
  bool answered_ = false, ended_ = false;
  proto::Error error_;

  /// Returns the pause that the service asks for (`retry:`), within the policy's limit.
  milliseconds server_pause() const {
    return std::min(milliseconds(answered_ ? parser_.retry_ms().value_or(0) : 0), policy_.longest);
  }

  bool on_event(const proto::Event& event) {
    if (event.id != 0) last_id_ = event.id;
    ended_ = !handler_(event) || event.type == "job.end";
    return !ended_;
  }

  Outcome connect() {
    httplib::Client http(url_.origin);
    if (!token_.empty()) http.set_bearer_token_auth(token_);
    http.set_tcp_nodelay(true);
    http.set_connection_timeout(10, 0);
    http.set_read_timeout(policy_.silence.count(), 0);
    httplib::Headers headers{{"Accept", "text/event-stream"}};
    if (last_id_ != 0) headers.emplace("Last-Event-ID", std::to_string(last_id_));
    parser_.reconnect();
    int status = 0;
    std::string problem;
    const auto answer = http.Get(
        path_, headers,
        [&](const httplib::Response& head) {
          status = head.status;
          return true;
        },
        [&](const char* data, std::size_t size) {
          const std::string_view bytes(data, size);
          if (status == 200) {
            answered_ = true;
            return parser_.feed(bytes, [&](const proto::Event& e) { return on_event(e); });
          }
          problem += bytes;
          return problem.size() <= kMaxProblemBytes;
        });
    return judge(answer, status, problem);
  }

  Outcome judge(const httplib::Result& answer, int status, const std::string& problem) {
    if (ended_ || (answer && status == 204)) return Outcome::kEnded;
    if (parser_.overflowed()) {
      error_ = proto::Error{"bad_document", "an event is too large", {}};
      return Outcome::kFailed;
    }
    if (status == 0 || status == 200) {
      error_ = proto::Error{"server_unreachable",
                            url_.text() + " gave no event stream" +
                                (answer ? "" : " (" + httplib::to_string(answer.error()) + ")"),
                            {}};
      return Outcome::kLost;
    }
    error_ = error_of_answer(status, problem, url_.text());
    return status >= 500 || status == 429 ? Outcome::kLost : Outcome::kFailed;
  }
};

}  // namespace

proto::Expected<void> Client::follow(const std::string& id, std::uint64_t after,
                                     const std::function<bool(const proto::Event&)>& handler,
                                     const RetryPolicy& policy) {
  if (auto ok = check_job_id(id); !ok) return ok;
  return Follower(impl_->url, impl_->token, impl_->path("/jobs/" + id + "/events"), handler, policy)
      .run(after);
}

}  // namespace kiln::clients
