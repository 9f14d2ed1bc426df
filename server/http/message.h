#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "proto/expected.h"
#include "server/base/event_ring.h"
#include "server/base/principal.h"
#include "server/http/content.h"
#include "server/http/head.h"

namespace kiln::http {

/// A request as the routes see it: its head. A route that wants the body asks for it with a
/// Receive.
struct Request {
  const RequestHead& head;
  std::string id;                         ///< req_..., on the answer and in the log
  base::Principal principal{};            ///< sender of the request
  std::vector<std::string> parameters{};  ///< values for the route's pattern, in order
  std::string route{};                    ///< the pattern; "" when there is none for the path
  /// The time that the request waited because its client asked for it. The service did no work
  /// then.
  std::chrono::steady_clock::duration asleep{};
};

/// An event stream that takes the connection over once the head of the answer is out.
struct StreamContent {
  std::shared_ptr<const base::EventRing> ring;
  std::uint64_t after = 0;
  std::string intro;
};

struct Response;

/// A response that asks for the request's body. The body arrives without holding a request thread,
/// and may take as long as its client is allowed to.
struct Receive {
  std::uint64_t max_bytes = 0;  ///< a longer body is `payload_too_large`
  /// Takes the next piece, from any thread, one piece at a time. It may wait for the disk. An error
  /// ends the body.
  std::function<proto::Expected<void>(std::string_view)> take;
  /// Makes the answer, on a request thread, once the body is whole or has failed. Errors: those of
  /// `take`, `payload_too_large`, `digest_mismatch`, and `bad_request` when the body ended early,
  /// is malformed, or came too slowly.
  std::function<Response(Request&, const proto::Expected<void>& received)> answer;
};

/// A response that waits for something. The connection waits without a thread meanwhile, and the
/// request is dropped when its client goes.
struct Deferred {
  std::chrono::steady_clock::time_point until;  ///< answers then in any case
  /// Called once. It calls `wake` when the answer can be given, from any thread, perhaps at once.
  /// The server keeps the returned object until the request goes on.
  std::function<std::shared_ptr<const void>(std::function<void()> wake)> watch;
  /// Makes the answer, on a request thread. Headers that came with this are added to it.
  std::function<Response(Request&)> answer;
};

struct Response {
  int status = 200;
  std::vector<std::pair<std::string, std::string>> headers{};
  std::string content_type{};
  std::string body{};
  Content content{};  ///< instead of `body`, when it is not empty
  std::optional<StreamContent> stream{};
  std::optional<Receive> receive{};
  std::optional<Deferred> deferred{};

  Response& header(std::string name, std::string value) {
    headers.emplace_back(std::move(name), std::move(value));
    return *this;
  }
  /// Sets the header, in place of one that is there.
  Response& replace(const std::string& name, std::string value) {
    std::erase_if(headers, [&](const auto& entry) { return entry.first == name; });
    return header(name, std::move(value));
  }
};

using Handler = std::function<Response(Request&)>;

}  // namespace kiln::http
