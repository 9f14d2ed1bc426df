#include "server/api/events.h"

#include <charconv>
#include <nlohmann/json.hpp>
#include <optional>

#include "proto/json.h"
#include "server/api/jobs.h"
#include "server/api/request.h"
#include "server/http/event_streams.h"
#include "server/http/problem.h"

namespace kiln::api {
namespace {

using proto::Expected;
using proto::fail;

// The id of the last event that the client has: `Last-Event-ID` before `?after=`.
Expected<std::optional<std::uint64_t>> last_seen_event(const http::Request& request) {
  if (request.head.http_1_0) return fail("bad_request", "An event stream needs HTTP/1.1.");
  const std::string* header = request.head.header("last-event-id");
  if (!header || header->empty()) return query_number(request, "after", INT64_MAX);
  std::uint64_t last_seen = 0;
  const auto parsed = std::from_chars(header->data(), header->data() + header->size(), last_seen);
  if (parsed.ec == std::errc() && parsed.ptr == header->data() + header->size()) return last_seen;
  return fail("bad_request", "The Last-Event-ID has to be a whole number.", "request",
              "/headers/last-event-id");
}

http::Response stream_response(http::StreamContent stream) {
  http::Response response;
  response.content_type = "text/event-stream";
  response.header("Cache-Control", "no-store").header("X-Accel-Buffering", "no");
  response.stream = std::move(stream);
  return response;
}

constexpr const char* kIntro = "retry: 2000\n\n";

}  // namespace

http::Response get_events(const Events& part, http::Request& request) {
  auto job = find_job(part.lookup, request);
  if (!job) return problem(job.error(), request);
  auto given = last_seen_event(request);
  if (!given) return problem(given.error(), request);
  const std::uint64_t last_seen = given->value_or(0);
  const auto ring = part.lookup.events(job->id);
  if (!ring) return problem({"not_found", "There is no job " + job->id + ".", {}}, request);
  const base::EventRing::Tail tail = ring->after(last_seen);
  if (tail.ended && tail.complete && tail.events.empty()) {
    http::Response response;
    response.status = 204;  // tells an EventSource to stop asking
    return response;
  }
  http::StreamContent stream{ring, last_seen, kIntro};
  if (!tail.complete) {
    // Read after the ring: the snapshot holds at least what its id promises.
    auto now = part.lookup.get(job->id);
    if (!now) return problem(now.error(), request);
    stream.intro += http::sse_text({tail.last, "snapshot", proto::to_text(proto::to_json(*now))});
    // job.end comes in any case: where it is the last event, it follows the snapshot.
    const bool over = ring->after(tail.last, 0).ended;
    stream.after = over ? tail.last - 1 : tail.last;
  }
  return stream_response(std::move(stream));
}

// Streams the events of all jobs that the client may see. The stream begins with a snapshot of
// those that are not over, unless it goes on after an event that is known.
http::Response get_all_events(const Events& part, http::Request& request) {
  auto last_seen = last_seen_event(request);
  if (!last_seen) return problem(last_seen.error(), request);
  const base::Principal& client = request.principal;
  const auto tenant = client.admin ? std::nullopt : std::optional(client.tenant);
  const auto ring = part.feeds.of(tenant);
  const base::EventRing::Tail tail = ring->after(last_seen->value_or(0), 0);
  http::StreamContent stream{ring, last_seen->value_or(0), kIntro};
  if (!*last_seen || !tail.complete) {
    auto jobs = nlohmann::json::array();
    for (const auto& job : part.lookup.unfinished(tenant))
      jobs.push_back({{"id", job.id},
                      {"state", proto::to_string(job.state)},
                      {"attempt", job.attempt},
                      {"version", job.version}});
    const nlohmann::json data{{"jobs", std::move(jobs)}};
    stream.intro += http::sse_text({tail.last, "snapshot", proto::to_text(data)});
    stream.after = tail.last;
  }
  return stream_response(std::move(stream));
}

}  // namespace kiln::api
