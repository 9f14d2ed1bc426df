#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/api/api.h"
#include "server/http/conditional.h"
#include "server/http/problem.h"

/// The routes that change a job.
namespace kiln::api {
namespace {

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

http::Response Api::patch_job(http::Request& request) {
  auto job = find_job(request);
  if (!job) return problem(job.error(), request);
  return receive_json_object(request, [this, id = job->id](http::Request& again, const auto& body) {
    auto patch = proto::job_patch_from_json(body.value_or(nlohmann::json::object()));
    if (!patch) return problem(patch.error(), again);
    const std::string* condition = again.head.header("if-match");
    auto patched = parts_.jobs.control().patch(id, *patch, [&](std::uint64_t version) {
      return !condition ||
             http::matches_strongly(*condition, "\"" + std::to_string(version) + "\"");
    });
    return patched ? job_response(200, *patched) : problem(patched.error(), again);
  });
}

http::Response Api::cancel_job(http::Request& request) {
  auto job = find_job(request);
  if (!job) return problem(job.error(), request);
  return receive_json_object(request, [this](http::Request& again, const auto& body) {
    auto mode = read_choice(body, "mode", {"now", "drain"});
    if (!mode) return problem(mode.error(), again);
    auto before = find_job(again);
    if (!before) return problem(before.error(), again);
    auto canceled = parts_.jobs.control().cancel(
        before->id, *mode == "drain" ? jobs::CancelMode::kDrain : jobs::CancelMode::kNow);
    if (!canceled) return problem(canceled.error(), again);
    return job_response(proto::is_terminal(before->state) ? 200 : 202, *canceled);
  });
}

http::Response Api::retry_job(http::Request& request) {
  auto job = find_job(request);
  if (!job) return problem(job.error(), request);
  return receive_json_object(request, [this, id = job->id](http::Request& again, const auto& body) {
    auto from = read_choice(body, "from", {"checkpoint", "start"});
    if (!from) return problem(from.error(), again);
    auto retried = parts_.jobs.control().retry(
        id, *from == "start" ? jobs::RetryFrom::kStart : jobs::RetryFrom::kCheckpoint);
    return retried ? job_response(202, *retried) : problem(retried.error(), again);
  });
}

http::Response Api::delete_job(http::Request& request) {
  auto job = find_job(request);
  if (!job) return problem(job.error(), request);
  const std::string* force = request.head.query_value("force");
  if (force && *force != "true" && *force != "false")
    return problem({"bad_request",
                    "`force` has to be true or false.",
                    {{"request", "/query/force", "not true or false"}}},
                   request);
  auto removed = parts_.jobs.control().remove(job->id, force && *force == "true");
  if (!removed) return problem(removed.error(), request);
  http::Response response;
  response.status = 204;
  return response;
}

}  // namespace kiln::api
