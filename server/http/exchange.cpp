#include "server/http/exchange.h"

#include <algorithm>
#include <memory>
#include <new>
#include <nlohmann/json.hpp>
#include <utility>

#include "server/base/log.h"
#include "server/http/problem.h"
#include "server/store/database.h"

namespace kiln::http {
namespace {

constexpr std::size_t kPiece = std::size_t{256} * 1024;

proto::Error ended_early() {
  return {"bad_request", "The request's body ended early or is malformed.", {}};
}

proto::Error too_large(std::uint64_t limit) {
  return {"payload_too_large",
          "The request's body is over the limit of " + std::to_string(limit) + " bytes.",
          {}};
}

}  // namespace

Exchange::Exchange(std::shared_ptr<Connection> c, RequestHead h, std::string id)
    : connection(std::move(c)),
      head(std::move(h)),
      request{head, std::move(id)},
      body_(head),
      digest_(head),
      written_before_(connection->bytes_written()) {}

// Runs a step of the routes. An exception ends the request with a problem, not the service.
void Exchange::guard(const std::function<void()>& step) {
  const auto report = [&](const char* what) {
    log_line(base::LogLevel::kError, "http.exception", {{"path", head.path}, {"what", what}});
  };
  const auto fail = [&](const char* code, const char* message) {
    response = problem({code, message, {}}, request);
  };
  try {
    return step();
  } catch (const store::DatabaseError& e) {
    report(e.what());
    if (e.disk_full) return fail("storage_full", "The disk of the service is full.");
  } catch (const std::bad_alloc&) {
    report("out of memory");
    return fail("out_of_memory", "The service has no memory left for this request.");
  } catch (const std::exception& e) {
    report(e.what());
  } catch (...) {
    report("unknown type");
  }
  fail("internal", "The service failed at this request; its log says more.");
}

void Exchange::ask(const Handler& handler, const WaitingConnections& waiting) {
  guard([&] {
    response = handler(request);
    if (!response.deferred) return;
    waker = waiting.waker();
    watch_ = response.deferred->watch([waker = waker] { Waker::wake(waker); });
  });
}

void Exchange::ask_again(const WaitingConnections& waiting) {
  watch_.reset();
  const auto headers = std::move(response.headers);
  const Handler answer = std::move(response.deferred->answer);
  ask(answer, waiting);
  for (const auto& [name, value] : headers) response.header(name, value);
}

void Exchange::ask_with_body(const WaitingConnections& waiting) {
  of_peer.reset();
  of_tenant.reset();
  const auto headers = std::move(response.headers);
  const Receive wanted = std::move(*response.receive);
  ask([&](Request& asked) { return wanted.answer(asked, received_); }, waiting);
  for (const auto& [name, value] : headers) response.header(name, value);
}

bool Exchange::has_whole_body() const {
  return body_.done() ||
         (head.content_length && *head.content_length <= connection->buffered().size());
}

bool Exchange::begin_body() {
  clock.begin();
  const std::uint64_t most = response.receive->max_bytes;
  if (head.content_length.value_or(0) > most) {
    fail_body(too_large(most));
    return false;
  }
  const std::string* expect = head.header("expect");
  if (expect && equal_ignoring_case(*expect, "100-continue") && !connection->has_bytes() &&
      !body_.done())
    connection->write_at_once("HTTP/1.1 100 Continue\r\n\r\n");
  return true;
}

proto::Expected<void> Exchange::take(std::string_view bytes) {
  body_bytes_ += bytes.size();
  const std::uint64_t most = response.receive->max_bytes;
  if (body_bytes_ > most) return proto::Unexpected(too_large(most));
  digest_.update(bytes);
  try {
    return response.receive->take(bytes);
  } catch (const std::bad_alloc&) {
    return proto::fail("out_of_memory", "The service has no memory left for this request.");
  } catch (const std::exception& e) {
    log_line(base::LogLevel::kError, "http.exception", {{"path", head.path}, {"what", e.what()}});
    return proto::fail("internal", "The service failed at this request; its log says more.");
  }
}

Exchange::Moved Exchange::end_body(proto::Expected<void> received) {
  received_ = std::move(received);
  return Moved::kAll;
}

void Exchange::fail_slow_body() {
  fail_body(ended_early());
}

Exchange::Moved Exchange::receive(std::size_t most) {
  thread_local const auto buffer = std::make_unique_for_overwrite<char[]>(kPiece);
  const BodyDecoder::Take take = [this](std::string_view bytes) { return this->take(bytes); };
  std::size_t total = 0;
  while (!body_.done()) {
    std::string_view bytes = connection->buffered();
    const bool was_buffered = !bytes.empty();
    if (!was_buffered) {
      if (total >= most) return Moved::kMore;
      if (clock.too_slow(connection->limits())) return end_body(proto::Unexpected(ended_early()));
      // When the body's end is known, this takes nothing of the next request with it.
      const std::size_t want =
          head.chunked ? kPiece
                       : static_cast<std::size_t>(std::min<std::uint64_t>(kPiece, body_.sure()));
      std::size_t got = 0;
      const auto what = connection->receive(buffer.get(), want, got);
      if (what == Connection::Got::kNothing) return Moved::kBlocked;
      if (what == Connection::Got::kClosed) return end_body(proto::Unexpected(ended_early()));
      clock.moved(got);
      total += got;
      bytes = {buffer.get(), got};
    }
    const auto used = body_.feed(bytes, take);
    if (!used) return end_body(proto::Unexpected(used.error()));
    if (was_buffered)
      connection->consume(*used);
    else if (*used < bytes.size())
      connection->put_back(bytes.substr(*used));
  }
  return end_body(digest_.finish());
}

void Exchange::begin_answer(bool last) {
  // The rest of a body would be read as the next request.
  close_ = head.wants_close() || !body_.done() || last;
  clock.begin();
  answer_ = Answer(response, request.id, close_, head.method != "HEAD");
}

Exchange::Moved Exchange::send(std::uint64_t most) {
  if (broken_) return Moved::kAll;
  const Answer::Sent sent = answer_.send(*connection, clock, most);
  if (sent == Answer::Sent::kMore) return Moved::kMore;
  if (sent == Answer::Sent::kBlocked && !clock.too_slow(connection->limits()))
    return Moved::kBlocked;
  broken_ = sent != Answer::Sent::kAll;
  return Moved::kAll;
}

}  // namespace kiln::http
