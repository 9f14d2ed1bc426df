#include <charconv>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/http/api.h"
#include "server/http/conditional.h"
#include "server/http/hub.h"
#include "server/http/problem.h"
#include "server/jobs/ids.h"

namespace kiln::server {
namespace {

using proto::Expected;
using proto::fail;

constexpr std::uint64_t kMaxWaitSeconds = 60;
constexpr std::uint32_t kDefaultPage = 50, kMaxPage = 200;

std::string job_path(const proto::Job& job) {
  return "/v1/jobs/" + job.id;
}

Response job_response(int status, const proto::Job& job) {
  return json_response(status, proto::to_json(job))
      .header("ETag", "\"" + std::to_string(job.version) + "\"");
}

}  // namespace

Expected<proto::Job> Api::find_job(const Request& request) const {
  const std::string& id = request.parameters.at(0);
  if (!is_id(id, "job_")) return fail("not_found", "There is no job " + id + ".");
  return jobs_.get(id);
}

// {"scene": "sha256:...", "settings": {...}}
Expected<Api::JobRequest> Api::read_json_job(Request& request) {
  auto text = receive_text(request, config_.max_request_json_bytes);
  if (!text) return proto::Unexpected(text.error());
  auto document = proto::parse_json(*text, "request");
  if (!document) return proto::Unexpected(document.error());
  const auto refuse = [](const char* pointer, const std::string& what) {
    return fail("invalid_request", what, "request", pointer);
  };
  if (!document->is_object()) return refuse("", "The body has to be a JSON object.");
  for (const auto& [key, value] : document->items())
    if (key != "scene" && key != "settings")
      return refuse(("/" + key).c_str(), "The member `" + key + "` is not known here.");
  constexpr std::string_view kPrefix = "sha256:";
  const auto scene_name = document->find("scene");
  const bool named = scene_name != document->end() && scene_name->is_string();
  const std::string name = named ? scene_name->get<std::string>() : std::string();
  if (!name.starts_with(kPrefix) ||
      !proto::is_sha256(std::string_view(name).substr(kPrefix.size())))
    return refuse("/scene",
                  "`scene` has to be \"sha256:\" and 64 hexadecimal digits, as "
                  "POST /v1/scenes answered.");
  auto scene = scenes_.find(name.substr(kPrefix.size()));
  if (!scene) return proto::Unexpected(scene.error());
  proto::BakeSettings settings;
  if (const auto given = document->find("settings"); given != document->end()) {
    auto parsed = proto::settings_from_json(*given);
    if (!parsed) return proto::Unexpected(parsed.error());
    settings = std::move(*parsed);
  }
  if (auto ok = check_(scene->files, settings); !ok) return proto::Unexpected(ok.error());
  return JobRequest{std::move(*scene), std::move(settings)};
}

Expected<Api::JobRequest> Api::read_job_request(Request& request) {
  if (media_type(request.head) == "application/json") return read_json_job(request);
  auto upload =
      receive_upload(request, data_, {config_.max_upload_bytes, config_.max_request_json_bytes},
                     /*settings_allowed=*/true);
  if (!upload) return proto::Unexpected(upload.error());
  auto settings = proto::parse_settings(upload->settings.value_or(""));
  if (!settings) return proto::Unexpected(settings.error());
  if (auto ok = check_(upload->scene.files(), *settings); !ok) return proto::Unexpected(ok.error());
  auto put = scenes_.put(std::move(upload->scene));
  if (!put) return proto::Unexpected(put.error());
  return JobRequest{std::move(put->scene), std::move(*settings)};
}

Response Api::post_job(Request& request) {
  if (auto open = jobs_.accepting(); !open) return problem(open.error(), request);
  auto input = read_job_request(request);
  if (!input) return problem(input.error(), request);
  auto job = jobs_.submit(input->scene, input->settings);
  if (!job) return problem(job.error(), request);
  return job_response(202, *job).header("Location", job_path(*job));
}

Response Api::list_jobs(Request& request) {
  JobFilter filter;
  if (const std::string* state = request.head.query_value("state")) {
    auto parsed = proto::job_state_from_string(*state);
    if (!parsed)
      return problem({"bad_request",
                      "There is no job state `" + *state + "`.",
                      {{"request", "/query/state", "not a job state"}}},
                     request);
    filter.state = *parsed;
  }
  auto limit = query_number(request, "limit", kMaxPage);
  auto cursor = query_number(request, "cursor", INT64_MAX);
  if (!limit) return problem(limit.error(), request);
  if (!cursor) return problem(cursor.error(), request);
  filter.limit =
      std::max<std::uint32_t>(1, static_cast<std::uint32_t>(limit->value_or(kDefaultPage)));
  if (*cursor) filter.before = static_cast<std::int64_t>(**cursor);

  const JobService::Page page = jobs_.list(filter);
  nlohmann::json items = nlohmann::json::array();
  for (const auto& job : page.jobs) items.push_back(proto::to_json(job));
  nlohmann::json document{{"items", std::move(items)}, {"next_cursor", nullptr}};
  if (!page.next) return json_response(200, document);
  document["next_cursor"] = std::to_string(*page.next);
  std::string next =
      "/v1/jobs?limit=" + std::to_string(filter.limit) + "&cursor=" + std::to_string(*page.next);
  if (filter.state) next += std::string("&state=") + proto::to_string(*filter.state);
  return json_response(200, document).header("Link", "<" + next + ">; rel=\"next\"");
}

// A waiting request holds a thread, so only half of them may wait; the others are answered at once.
Expected<proto::Job> Api::wait_for_job(const Request& request, std::chrono::seconds time) {
  const std::string& id = request.parameters.at(0);
  if (!is_id(id, "job_") || time.count() == 0 || !waits_.try_acquire()) return find_job(request);
  const struct Release {
    std::counting_semaphore<>& slots;
    ~Release() { slots.release(); }
  } release{waits_};
  return jobs_.wait(id, time);
}

Response Api::get_job(Request& request) {
  auto wait = query_number(request, "wait", kMaxWaitSeconds);
  if (!wait) return problem(wait.error(), request);
  auto job = wait_for_job(request, std::chrono::seconds(wait->value_or(0)));
  if (!job) return problem(job.error(), request);
  const std::string etag = "\"" + std::to_string(job->version) + "\"";
  if (const auto* known = request.head.header("if-none-match");
      known && matches_etag(*known, etag)) {
    Response response;
    response.status = 304;
    return response.header("ETag", etag);
  }
  return job_response(200, *job);
}

Response Api::cancel_job(Request& request) {
  auto before = find_job(request);
  if (!before) return problem(before.error(), request);
  auto job = jobs_.cancel(before->id);
  if (!job) return problem(job.error(), request);
  return job_response(proto::is_terminal(before->state) ? 200 : 202, *job);
}

Response Api::delete_job(Request& request) {
  auto job = find_job(request);
  if (!job) return problem(job.error(), request);
  const std::string* force = request.head.query_value("force");
  if (force && *force != "true" && *force != "false")
    return problem({"bad_request",
                    "`force` has to be true or false.",
                    {{"request", "/query/force", "not true or false"}}},
                   request);
  auto removed = jobs_.remove(job->id, force && *force == "true");
  if (!removed) return problem(removed.error(), request);
  Response response;
  response.status = 204;
  return response;
}

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
