#include "server/api/submit.h"

#include <algorithm>
#include <charconv>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "proto/json.h"
#include "proto/sha256.h"
#include "server/api/jobs.h"
#include "server/api/request.h"
#include "server/http/problem.h"

namespace kiln::api {
namespace {

/// A job as it was asked for: of a scene that is stored, or of one that came along.
struct JobRequest {
  jobs::Submission job;
  std::optional<data::SceneUpload> upload;
  files::SceneFiles files() const { return upload ? upload->files() : job.scene.files; }
};
using JobRequestAnswer = std::function<http::Response(http::Request&, proto::Expected<JobRequest>)>;

// The seconds of `Prefer: wait=30` (RFC 7240), at most as long as any request may wait; 0: none.
std::chrono::seconds preferred_wait(const http::Request& request) {
  const std::string* header = request.head.header("prefer");
  std::string_view list = header ? std::string_view(*header) : std::string_view();
  while (!list.empty()) {
    const auto comma = std::min(list.find(','), list.size());
    std::string_view text = http::trim_blanks(list.substr(0, comma));
    text = http::trim_blanks(text.substr(0, text.find(';')));
    list.remove_prefix(std::min(comma + 1, list.size()));
    if (text.size() < 6 || !http::equal_ignoring_case(text.substr(0, 5), "wait=")) continue;
    std::uint32_t seconds = 0;
    const auto parsed = std::from_chars(text.data() + 5, text.data() + text.size(), seconds);
    if (parsed.ptr != text.data() + text.size()) continue;  // as if it were not there
    if (parsed.ec != std::errc()) seconds = kMaxWaitSeconds;
    return std::chrono::seconds(std::min(seconds, kMaxWaitSeconds));
  }
  return {};
}

// "sha256:<digest>" without the prefix; "" when it is something else.
std::string scene_key(const nlohmann::json& document) {
  constexpr std::string_view kPrefix = "sha256:";
  const auto named = document.find("scene");
  if (named == document.end() || !named->is_string()) return {};
  const std::string name = named->get<std::string>();
  if (!name.starts_with(kPrefix) || !proto::is_sha256(name.substr(kPrefix.size()))) return {};
  return name.substr(kPrefix.size());
}

// Reads {"scene": "sha256:...", "settings": {...}, and options}.
proto::Expected<JobRequest> read_json_job(const Scenes& scenes, const http::Request& request,
                                          const nlohmann::json& document) {
  JobRequest asked;
  jobs::Submission& job = asked.job;
  nlohmann::json options = document;
  options.erase("scene");
  options.erase("settings");
  auto parsed = proto::job_options_from_json(options);
  if (!parsed) return proto::Unexpected(parsed.error());
  job.options = std::move(*parsed);
  const std::string key = scene_key(document);
  if (key.empty())
    return proto::fail("invalid_request",
                       "`scene` has to be \"sha256:\" and 64 hexadecimal digits, as "
                       "POST /v1/scenes answered.",
                       "request", "/scene");
  if (auto ok = check_owner(scenes, request, key); !ok) return proto::Unexpected(ok.error());
  auto scene = scenes.scenes.use(key);
  if (!scene) return proto::Unexpected(scene.error());
  job.scene = std::move(*scene);
  if (const auto given = document.find("settings"); given != document.end()) {
    auto settings = proto::settings_from_json(*given);
    if (!settings) return proto::Unexpected(settings.error());
    job.settings = std::move(*settings);
  }
  return asked;
}

proto::Expected<void> read_parts(const Upload& upload, jobs::Submission& job) {
  auto settings = proto::parse_settings(upload.settings.value_or(""));
  if (!settings) return proto::Unexpected(settings.error());
  job.settings = std::move(*settings);
  if (!upload.options) return {};
  auto document = proto::parse_json(*upload.options, "request");
  if (!document) return proto::Unexpected(document.error());
  auto options = proto::job_options_from_json(*document);
  if (!options) return proto::Unexpected(options.error());
  job.options = std::move(*options);
  return {};
}

http::Response receive_job_request(const Scenes& scenes, http::Request& request,
                                   JobRequestAnswer answer) {
  if (media_type(request.head) == "application/json")
    return receive_json_object(
        request, scenes.intake,
        [&scenes, answer = std::move(answer)](http::Request& again, const auto& document) {
          return answer(again,
                        read_json_job(scenes, again, document.value_or(nlohmann::json::object())));
        });
  return receive_upload(
      request, scenes.intake, /*for_job=*/true,
      [answer = std::move(answer)](http::Request& again, proto::Expected<Upload> upload) {
        if (!upload) return answer(again, proto::Unexpected(upload.error()));
        JobRequest asked;
        if (auto read = read_parts(*upload, asked.job); !read)
          return answer(again, proto::Unexpected(read.error()));
        asked.upload.emplace(std::move(upload->scene));
        return answer(again, std::move(asked));
      });
}

http::Response submit(const Submit& part, http::Request& request, JobRequest& asked) {
  if (asked.upload) {
    auto put = put_scene(part.scenes, request, std::move(*asked.upload));
    if (!put) return problem(put.error(), request);
    asked.job.scene = std::move(put->scene);
  }
  auto submitted = part.submitter.submit(asked.job);
  if (!submitted) return problem(submitted.error(), request);
  const auto patience = preferred_wait(request);
  const auto answer = [&part, patience, replayed = submitted->replayed](http::Request&,
                                                                        const proto::Job& job) {
    http::Response response =
        job_response(part.lookup, proto::is_terminal(job.state) ? 200 : 202, job);
    if (patience.count() > 0)
      response.header("Preference-Applied", "wait=" + std::to_string(patience.count()));
    if (replayed) response.header("Idempotent-Replayed", "true");
    return response.header("Location", "/v1/jobs/" + job.id);
  };
  return answer_when_moved(part.lookup, request, submitted->job, patience, std::nullopt, answer);
}

http::Response check_and_submit(const Submit& part, http::Request& request, JobRequest asked,
                                const std::string& key) {
  jobs::Submission& job = asked.job;
  if (const auto& hook = job.options.webhook)
    if (auto ok = part.webhooks.check(*hook, request.principal.tenant); !ok)
      return problem(ok.error(), request);
  job.tenant = request.principal.tenant;
  job.idempotency_key = key;
  const auto kept = std::make_shared<JobRequest>(std::move(asked));
  const auto answer = [&part, kept](http::Request& again, const proto::Expected<void>& checked) {
    return checked ? submit(part, again, *kept) : problem(checked.error(), again);
  };
  return answer_when_checked(part.scenes.check, request, kept->files(), kept->job.settings, answer);
}

}  // namespace

http::Response post_job(const Submit& part, http::Request& request) {
  auto key = idempotency_key(request);
  if (!key) return problem(key.error(), request);
  if (auto open = part.submitter.accepting(request.principal.tenant, *key); !open)
    return problem(open.error(), request);
  return receive_job_request(
      part.scenes, request,
      [&part, key = *key](http::Request& again, proto::Expected<JobRequest> asked) {
        return asked ? check_and_submit(part, again, std::move(*asked), key)
                     : problem(asked.error(), again);
      });
}

}  // namespace kiln::api
