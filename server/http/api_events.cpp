#include <charconv>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/http/api.h"
#include "server/http/hub.h"
#include "server/http/problem.h"

namespace kiln::server {

Response Api::get_events(Request& request) {
  auto job = find_job(request);
  if (!job) return problem(job.error(), request);
  if (request.head.http_1_0)
    return problem({"bad_request", "An event stream needs HTTP/1.1.", {}}, request);
  auto after = query_number(request, "after", INT64_MAX);
  if (!after) return problem(after.error(), request);
  std::uint64_t last_seen = after->value_or(0);
  if (const std::string* header = request.head.header("last-event-id");
      header && !header->empty()) {
    const auto parsed = std::from_chars(header->data(), header->data() + header->size(), last_seen);
    if (parsed.ec != std::errc() || parsed.ptr != header->data() + header->size())
      return problem({"bad_request",
                      "The Last-Event-ID has to be a whole number.",
                      {{"request", "/headers/last-event-id", "not a whole number"}}},
                     request);
  }
  const auto ring = jobs_.events(job->id);
  if (!ring) return problem({"not_found", "There is no job " + job->id + ".", {}}, request);
  const EventRing::Tail tail = ring->after(last_seen);
  Response response;
  if (tail.ended && tail.complete && tail.events.empty()) {
    response.status = 204;  // tells an EventSource to stop asking
    return response;
  }
  StreamContent stream{ring, last_seen, "retry: 2000\n\n"};
  if (!tail.complete) {
    // Read after the ring: the snapshot holds at least what its id promises.
    auto now = jobs_.get(job->id);
    if (!now) return problem(now.error(), request);
    stream.intro += sse_text({tail.last, "snapshot", proto::to_text(proto::to_json(*now))});
    // job.end comes in any case: where it is the last event, it follows the snapshot.
    const bool over = ring->after(tail.last, 0).ended;
    stream.after = over ? tail.last - 1 : tail.last;
  }
  response.content_type = "text/event-stream";
  response.header("Cache-Control", "no-store").header("X-Accel-Buffering", "no");
  response.stream = std::move(stream);
  return response;
}

}  // namespace kiln::server
