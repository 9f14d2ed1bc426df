#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "server/api/api.h"
#include "server/http/problem.h"

namespace kiln::api {
namespace {

constexpr std::size_t kMaxIdempotencyKey = 255;

proto::Unexpected refuse(const char* pointer, const std::string& what) {
  return proto::fail("invalid_request", what, "request", pointer);
}

}  // namespace

proto::Expected<std::string> idempotency_key(const http::Request& request) {
  const std::string* key = request.head.header("idempotency-key");
  if (!key) return std::string();
  const bool fits =
      !key->empty() && key->size() <= kMaxIdempotencyKey &&
      std::all_of(key->begin(), key->end(), [](char c) { return c > ' ' && c <= '~'; });
  if (fits) return *key;
  return proto::fail("bad_request",
                     "The Idempotency-Key has to be 1 to 255 visible ASCII characters.", "request",
                     "/headers/idempotency-key");
}

namespace {

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

}  // namespace

http::Response Api::receive_json_object(http::Request& request, JsonAnswer answer) {
  const auto parse = [](const std::string& text) -> proto::Expected<std::optional<nlohmann::json>> {
    if (text.empty()) return std::nullopt;
    auto document = proto::parse_json(text, "request");
    if (!document) return proto::Unexpected(document.error());
    if (!document->is_object()) return refuse("", "The body has to be a JSON object.");
    return std::move(*document);
  };
  return receive_text(
      request, parts_.data, parts_.config.max_request_json_bytes,
      [parse, answer = std::move(answer)](http::Request& again, proto::Expected<std::string> text) {
        if (!text) return problem(text.error(), again);
        const auto document = parse(*text);
        return document ? answer(again, *document) : problem(document.error(), again);
      });
}

// {"scene": "sha256:...", "settings": {...}, and options}
proto::Expected<Api::JobRequest> Api::read_json_job(const http::Request& request,
                                                    nlohmann::json document) {
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
    return refuse("/scene",
                  "`scene` has to be \"sha256:\" and 64 hexadecimal digits, as "
                  "POST /v1/scenes answered.");
  if (auto ok = check_owner(request, key); !ok) return proto::Unexpected(ok.error());
  auto scene = parts_.scenes.use(key);
  if (!scene) return proto::Unexpected(scene.error());
  job.scene = std::move(*scene);
  if (const auto given = document.find("settings"); given != document.end()) {
    auto settings = proto::settings_from_json(*given);
    if (!settings) return proto::Unexpected(settings.error());
    job.settings = std::move(*settings);
  }
  return asked;
}

namespace {

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

}  // namespace

http::Response Api::receive_job_request(http::Request& request, JobRequestAnswer answer) {
  if (media_type(request.head) == "application/json")
    return receive_json_object(
        request, [this, answer = std::move(answer)](http::Request& again, const auto& document) {
          return answer(again, read_json_job(again, document.value_or(nlohmann::json::object())));
        });
  return receive_upload(
      request, parts_.data, {parts_.config.max_upload_bytes, parts_.config.max_request_json_bytes},
      /*for_job=*/true,
      [answer = std::move(answer)](http::Request& again, proto::Expected<Upload> upload) {
        if (!upload) return answer(again, proto::Unexpected(upload.error()));
        JobRequest asked;
        if (auto read = read_parts(*upload, asked.job); !read)
          return answer(again, proto::Unexpected(read.error()));
        asked.upload.emplace(std::move(upload->scene));
        return answer(again, std::move(asked));
      });
}

http::Response Api::answer_when_checked(http::Request& request, const files::SceneFiles& files,
                                        const proto::BakeSettings& settings, CheckAnswer answer) {
  constexpr auto kPatience = std::chrono::seconds(30);
  return answer_when_checked(request, files, settings, std::move(answer),
                             std::chrono::steady_clock::now() + kPatience);
}

http::Response Api::answer_when_checked(http::Request& request, const files::SceneFiles& files,
                                        const proto::BakeSettings& settings, CheckAnswer answer,
                                        std::chrono::steady_clock::time_point until) {
  // Who finds the line full asks again when it has moved; who missed that, after a while.
  constexpr auto kAskAgain = std::chrono::milliseconds(100);
  const auto checked = parts_.check(files, settings);
  const auto now = std::chrono::steady_clock::now();
  if (checked || checked.error().code != "overloaded" || now >= until)
    return answer(request, checked);
  http::Response response;
  response.deferred = http::Deferred{
      std::min(until, now + kAskAgain),
      [this](std::function<void()> wake) {
        return parts_.watch_checks ? parts_.watch_checks(std::move(wake)) : nullptr;
      },
      [this, files, settings, answer = std::move(answer), until](http::Request& again) {
        return answer_when_checked(again, files, settings, answer, until);
      }};
  return response;
}

http::Response Api::post_job(http::Request& request) {
  auto key = idempotency_key(request);
  if (!key) return problem(key.error(), request);
  if (auto open = parts_.jobs.submitter().accepting(request.principal.tenant, *key); !open)
    return problem(open.error(), request);
  return receive_job_request(request, [this, key = *key](http::Request& again,
                                                         proto::Expected<JobRequest> asked) {
    return asked ? check_and_submit(again, std::move(*asked), key) : problem(asked.error(), again);
  });
}

http::Response Api::check_and_submit(http::Request& request, JobRequest asked,
                                     const std::string& key) {
  jobs::Submission& job = asked.job;
  if (const auto& hook = job.options.webhook)
    if (auto ok = parts_.webhooks.check(*hook, request.principal.tenant); !ok)
      return problem(ok.error(), request);
  job.tenant = request.principal.tenant;
  job.idempotency_key = key;
  const auto kept = std::make_shared<JobRequest>(std::move(asked));
  const auto answer = [this, kept](http::Request& again, const proto::Expected<void>& checked) {
    return checked ? submit(again, *kept) : problem(checked.error(), again);
  };
  return answer_when_checked(request, kept->files(), kept->job.settings, answer);
}

http::Response Api::submit(http::Request& request, JobRequest& asked) {
  if (asked.upload) {
    auto put = put_scene(request, std::move(*asked.upload));
    if (!put) return problem(put.error(), request);
    asked.job.scene = std::move(put->scene);
  }
  auto submitted = parts_.jobs.submitter().submit(asked.job);
  if (!submitted) return problem(submitted.error(), request);
  const auto patience = preferred_wait(request);
  const auto answer = [this, patience, replayed = submitted->replayed](http::Request&,
                                                                       const proto::Job& job) {
    http::Response response = job_response(proto::is_terminal(job.state) ? 200 : 202, job);
    if (patience.count() > 0)
      response.header("Preference-Applied", "wait=" + std::to_string(patience.count()));
    if (replayed) response.header("Idempotent-Replayed", "true");
    return response.header("Location", "/v1/jobs/" + job.id);
  };
  return answer_when_moved(request, submitted->job, patience, std::nullopt, answer);
}

}  // namespace kiln::api
