#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/uri_escape.h"
#include "server/api/api.h"
#include "server/base/ids.h"
#include "server/http/conditional.h"
#include "server/http/problem.h"

namespace kiln::api {
namespace {

using proto::Expected;
using proto::fail;

constexpr std::uint32_t kDefaultPage = 50, kMaxPage = 200;
constexpr std::size_t kMaxLabelFilters = 8;

// ?state=&label=name:value&limit=&cursor=
Expected<store::JobFilter> read_filter(const http::Request& request) {
  store::JobFilter filter;
  if (const std::string* state = request.head.query_value("state")) {
    auto parsed = proto::job_state_from_string(*state);
    if (!parsed)
      return fail("bad_request", "There is no job state `" + *state + "`.", "request",
                  "/query/state");
    filter.state = *parsed;
  }
  for (const auto& [name, value] : request.head.query) {
    if (name != "label") continue;
    const auto colon = value.find(':');
    if (colon == std::string::npos || filter.labels.size() == kMaxLabelFilters)
      return fail("bad_request", "`label` has to be name:value, and there at most 8 times.",
                  "request", "/query/label");
    filter.labels.emplace_back(value.substr(0, colon), value.substr(colon + 1));
  }
  auto limit = query_number(request, "limit", kMaxPage);
  auto cursor = query_number(request, "cursor", INT64_MAX);
  if (!limit) return proto::Unexpected(limit.error());
  if (!cursor) return proto::Unexpected(cursor.error());
  filter.limit =
      std::max<std::uint32_t>(1, static_cast<std::uint32_t>(limit->value_or(kDefaultPage)));
  if (*cursor) filter.before = static_cast<std::int64_t>(**cursor);
  return filter;
}

std::string page_link(const store::JobFilter& filter, std::int64_t cursor) {
  std::string link =
      "/v1/jobs?limit=" + std::to_string(filter.limit) + "&cursor=" + std::to_string(cursor);
  if (filter.state) link += std::string("&state=") + proto::to_string(*filter.state);
  for (const auto& [name, value] : filter.labels)
    link += "&label=" + proto::percent_encode(name) + ":" + proto::percent_encode(value);
  return link;
}

}  // namespace

nlohmann::json Api::job_document(proto::Job job) const {
  if (job.state == proto::JobState::kQueued)
    job.queue_position = parts_.jobs.lookup().queue_position(job.id);
  return proto::to_json(job);
}

http::Response Api::job_response(int status, const proto::Job& job) const {
  return http::json_response(status, job_document(job))
      .header("ETag", "\"" + std::to_string(job.version) + "\"");
}

Expected<proto::Job> Api::find_job(const http::Request& request) const {
  const std::string& id = request.parameters.at(0);
  const auto missing = [&] { return fail("not_found", "There is no job " + id + "."); };
  if (!base::is_id(id, "job_")) return missing();
  auto job = parts_.jobs.lookup().get(id);
  if (job && !request.principal.may_see(job->tenant)) return missing();
  return job;
}

http::Response Api::list_jobs(http::Request& request) {
  auto filter = read_filter(request);
  if (!filter) return problem(filter.error(), request);
  if (!request.principal.admin) filter->tenant = request.principal.tenant;
  const jobs::JobLookup::Page page = parts_.jobs.lookup().list(*filter);
  nlohmann::json items = nlohmann::json::array();
  for (const auto& job : page.jobs) items.push_back(job_document(job));
  nlohmann::json document{{"items", std::move(items)}, {"next_cursor", nullptr}};
  if (!page.next) return http::json_response(200, document);
  document["next_cursor"] = std::to_string(*page.next);
  return http::json_response(200, document)
      .header("Link", "<" + page_link(*filter, *page.next) + ">; rel=\"next\"");
}

http::Response Api::answer_when_moved(http::Request& request, const proto::Job& job,
                                      std::chrono::seconds time, std::optional<std::uint64_t> since,
                                      JobAnswer answer) {
  if (time.count() == 0 || proto::is_terminal(job.state) || (since && *since != job.version))
    return answer(request, job);
  http::Response response;
  response.deferred =
      http::Deferred{std::chrono::steady_clock::now() + time,
                     [this, id = job.id, since](std::function<void()> wake) {
                       return parts_.jobs.lookup().watch(id, since, std::move(wake));
                     },
                     [this, id = job.id, answer = std::move(answer)](http::Request& again) {
                       const auto now = parts_.jobs.lookup().get(id);
                       return now ? answer(again, *now) : problem(now.error(), again);
                     }};
  return response;
}

http::Response Api::get_job(http::Request& request) {
  auto wait = query_number(request, "wait", kMaxWaitSeconds);
  if (!wait) return problem(wait.error(), request);
  auto since = query_number(request, "since", INT64_MAX);
  if (!since) return problem(since.error(), request);
  auto job = find_job(request);
  if (!job) return problem(job.error(), request);
  const auto answer = [this, since = *since](http::Request& asked, const proto::Job& now) {
    const std::string etag = "\"" + std::to_string(now.version) + "\"";
    const auto* known = asked.head.header("if-none-match");
    if ((!known || !http::matches_etag(*known, etag)) && since != now.version)
      return job_response(200, now);
    http::Response response;
    response.status = 304;
    return response.header("ETag", etag);
  };
  return answer_when_moved(request, *job, std::chrono::seconds(wait->value_or(0)), *since, answer);
}

}  // namespace kiln::api
