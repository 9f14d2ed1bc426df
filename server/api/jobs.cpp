#include "server/api/jobs.h"

#include <algorithm>
#include <nlohmann/json.hpp>
#include <utility>

#include "proto/json.h"
#include "proto/text_codes.h"
#include "server/api/request.h"
#include "server/base/ids.h"
#include "server/http/conditional.h"
#include "server/http/problem.h"

namespace kiln::api {
namespace {

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

nlohmann::json job_document(const jobs::JobLookup& lookup, proto::Job job) {
  if (job.state == proto::JobState::kQueued) job.queue_position = lookup.queue_position(job.id);
  return proto::to_json(job);
}

std::string etag_of(std::uint64_t version) {
  return "\"" + std::to_string(version) + "\"";
}

// The only member of an optional body, one of a few words; the first of them when it is not there.
proto::Expected<std::string> read_choice(const std::optional<nlohmann::json>& body,
                                         const char* name, const std::vector<std::string>& words) {
  if (!body) return words.front();
  const auto value = body->find(name);
  if (body->size() != (value == body->end() ? 0 : 1))
    return proto::fail("invalid_request",
                       "The body may have the member `" + std::string(name) + "` only.", "request",
                       "");
  if (value == body->end()) return words.front();
  std::string known;
  for (const auto& word : words) {
    if (*value == word) return word;
    known += (known.empty() ? "`" : " or `") + word + "`";
  }
  return proto::fail("invalid_request", "`" + std::string(name) + "` has to be " + known + ".",
                     "request", "/" + std::string(name));
}

}  // namespace

http::Response job_response(const jobs::JobLookup& lookup, int status, const proto::Job& job) {
  return http::json_response(status, job_document(lookup, job))
      .header("ETag", etag_of(job.version));
}

proto::Expected<proto::Job> find_job(const jobs::JobLookup& lookup, const http::Request& request) {
  const std::string& id = request.parameters.at(0);
  const auto missing = [&] { return fail("not_found", "There is no job " + id + "."); };
  if (!base::is_id(id, "job_")) return missing();
  auto job = lookup.get(id);
  if (job && !request.principal.may_see(job->tenant)) return missing();
  return job;
}

http::Response list_jobs(const Jobs& part, http::Request& request) {
  auto filter = read_filter(request);
  if (!filter) return problem(filter.error(), request);
  if (!request.principal.admin) filter->tenant = request.principal.tenant;
  const jobs::JobLookup::Page page = part.lookup.list(*filter);
  nlohmann::json items = nlohmann::json::array();
  for (const auto& job : page.jobs) items.push_back(job_document(part.lookup, job));
  nlohmann::json document{{"items", std::move(items)}, {"next_cursor", nullptr}};
  if (!page.next) return http::json_response(200, document);
  document["next_cursor"] = std::to_string(*page.next);
  return http::json_response(200, document)
      .header("Link", "<" + page_link(*filter, *page.next) + ">; rel=\"next\"");
}

http::Response answer_when_moved(const jobs::JobLookup& lookup, http::Request& request,
                                 const proto::Job& job, std::chrono::seconds time,
                                 std::optional<std::uint64_t> since, JobAnswer answer) {
  if (time.count() == 0 || proto::is_terminal(job.state) || (since && *since != job.version))
    return answer(request, job);
  http::Response response;
  response.deferred =
      http::Deferred{std::chrono::steady_clock::now() + time,
                     [&lookup, id = job.id, since](std::function<void()> wake) {
                       return lookup.watch(id, since, std::move(wake));
                     },
                     [&lookup, id = job.id, answer = std::move(answer)](http::Request& again) {
                       const auto now = lookup.get(id);
                       return now ? answer(again, *now) : problem(now.error(), again);
                     }};
  return response;
}

http::Response get_job(const Jobs& part, http::Request& request) {
  auto wait = query_number(request, "wait", kMaxWaitSeconds);
  if (!wait) return problem(wait.error(), request);
  auto since = query_number(request, "since", INT64_MAX);
  if (!since) return problem(since.error(), request);
  auto job = find_job(part.lookup, request);
  if (!job) return problem(job.error(), request);
  const auto answer = [&part, since = *since](http::Request& asked, const proto::Job& now) {
    const std::string etag = etag_of(now.version);
    if (client_has(asked, etag) || since == now.version) return not_modified(etag);
    return job_response(part.lookup, 200, now);
  };
  return answer_when_moved(part.lookup, request, *job, std::chrono::seconds(wait->value_or(0)),
                           *since, answer);
}

http::Response patch_job(const Jobs& part, http::Request& request) {
  auto job = find_job(part.lookup, request);
  if (!job) return problem(job.error(), request);
  const auto answer = [&part, id = job->id](http::Request& again, const auto& body) {
    auto patch = proto::job_patch_from_json(body.value_or(nlohmann::json::object()));
    if (!patch) return problem(patch.error(), again);
    const std::string* condition = again.head.header("if-match");
    auto patched = part.control.patch(id, *patch, [&](std::uint64_t version) {
      return !condition || http::matches_strongly(*condition, etag_of(version));
    });
    return patched ? job_response(part.lookup, 200, *patched) : problem(patched.error(), again);
  };
  return receive_json_object(request, part.intake, answer);
}

http::Response cancel_job(const Jobs& part, http::Request& request) {
  auto job = find_job(part.lookup, request);
  if (!job) return problem(job.error(), request);
  const auto answer = [&part](http::Request& again, const auto& body) {
    auto mode = read_choice(body, "mode", {"now", "drain"});
    if (!mode) return problem(mode.error(), again);
    auto before = find_job(part.lookup, again);
    if (!before) return problem(before.error(), again);
    auto canceled = part.control.cancel(
        before->id, *mode == "drain" ? jobs::CancelMode::kDrain : jobs::CancelMode::kNow);
    if (!canceled) return problem(canceled.error(), again);
    return job_response(part.lookup, proto::is_terminal(before->state) ? 200 : 202, *canceled);
  };
  return receive_json_object(request, part.intake, answer);
}

http::Response retry_job(const Jobs& part, http::Request& request) {
  auto job = find_job(part.lookup, request);
  if (!job) return problem(job.error(), request);
  const auto answer = [&part, id = job->id](http::Request& again, const auto& body) {
    auto from = read_choice(body, "from", {"checkpoint", "start"});
    if (!from) return problem(from.error(), again);
    auto retried = part.control.retry(
        id, *from == "start" ? jobs::RetryFrom::kStart : jobs::RetryFrom::kCheckpoint);
    return retried ? job_response(part.lookup, 202, *retried) : problem(retried.error(), again);
  };
  return receive_json_object(request, part.intake, answer);
}

http::Response delete_job(const Jobs& part, http::Request& request) {
  auto job = find_job(part.lookup, request);
  if (!job) return problem(job.error(), request);
  const std::string* force = request.head.query_value("force");
  if (force && *force != "true" && *force != "false")
    return problem({"bad_request",
                    "`force` has to be true or false.",
                    {{"request", "/query/force", "not true or false"}}},
                   request);
  auto removed = part.control.remove(job->id, force && *force == "true");
  return removed ? no_content() : problem(removed.error(), request);
}

}  // namespace kiln::api
