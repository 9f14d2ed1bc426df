#include "clients/client.h"

#include <algorithm>
#include <random>
#include <utility>

#include "clients/client_impl.h"
#include "clients/multipart_body.h"
#include "proto/files.h"
#include "proto/json.h"
#include "proto/scene_name.h"

namespace kiln::clients {
namespace {

using nlohmann::json;

/// Returns a boundary that the files' bytes contain with a chance of 2^-128 only.
std::string random_boundary() {
  std::random_device random;
  std::string text = "lightkiln-";
  constexpr std::string_view kDigits = "0123456789abcdef";
  for (int i = 0; i < 32; ++i) text += kDigits[random() & 15u];
  return text;
}

json options_document(const proto::JobOptions& options) {
  json document = proto::to_json(options);
  if (!options.ttl_seconds) document.erase("ttl_seconds");  // the service's default applies
  return document;
}

proto::Expected<void> add_scene(MultipartBody& body, const Submission& s) {
  if (auto ok = body.add_file("scene", s.scene.filename().string(), s.scene); !ok) return ok;
  for (const auto& [name, path] : s.side)
    if (auto ok = body.add_file("file", name, path); !ok) return ok;
  body.finish();
  return {};
}

proto::Expected<MultipartBody> body_of(const Submission& s) {
  MultipartBody body(random_boundary());
  if (!s.settings_json.empty()) body.add_text("settings", "application/json", s.settings_json);
  body.add_text("options", "application/json", proto::to_text(options_document(s.options)));
  if (auto ok = add_scene(body, s); !ok) return proto::Unexpected(std::move(ok.error()));
  return body;
}

/// Makes a body of the scene alone. It has the same bytes each time, so that a part of it can be
/// sent later.
proto::Expected<MultipartBody> scene_body(const Submission& s, const std::string& key) {
  if (s.side.empty()) return MultipartBody::bare(s.scene);
  MultipartBody body("lightkiln-" + key.substr(0, 32));
  if (auto ok = add_scene(body, s); !ok) return proto::Unexpected(std::move(ok.error()));
  return body;
}

struct Files {
  std::string key;  ///< the scene's key in the service
  std::uint64_t bytes = 0;
};

proto::Expected<Files> digest_files(const Submission& s) {
  const auto digest = [](const std::filesystem::path& path) {
    auto found = proto::digest_file(path);
    if (!found)
      found = proto::fail("missing_file", "The file " + path.string() + " can't be read.");
    return found;
  };
  const auto main = digest(s.scene);
  if (!main) return proto::Unexpected(main.error());
  Files files{"", main->bytes};
  std::vector<proto::SideDigest> side;
  for (const auto& [name, path] : s.side) {
    const auto one = digest(path);
    if (!one) return proto::Unexpected(one.error());
    side.push_back({name, one->sha256});
    files.bytes += one->bytes;
  }
  files.key = proto::scene_name(main->sha256, std::move(side)).key;
  return files;
}

}  // namespace

Client::Impl::Impl(ServerUrl where, std::string secret)
    : url(std::move(where)), http(url.origin), token(std::move(secret)) {
  if (!token.empty()) http.set_bearer_token_auth(token);
  http.set_tcp_nodelay(true);
  http.set_connection_timeout(10, 0);
  http.set_read_timeout(60, 0);
  http.set_write_timeout(60, 0);
}

proto::Unexpected Client::Impl::unreachable(httplib::Error error) const {
  return proto::fail("server_unreachable", url.text() + " does not answer (" +
                                               httplib::to_string(error) +
                                               "); is `lightkiln serve` running there?");
}

proto::Error error_of_answer(int status, const std::string& body, const std::string& origin) {
  if (auto doc = proto::parse_json(body, "answer"))
    if (auto error = proto::error_from_json(*doc)) return std::move(*error);
  return proto::fail("bad_document", origin + " answered " + std::to_string(status) +
                                         " without a problem document; is it a Lightkiln service?")
      .value();
}

proto::Expected<json> Client::Impl::document(const httplib::Result& answer) const {
  if (!answer) return unreachable(answer.error());
  if (answer->status < 200 || answer->status > 299)
    return proto::Unexpected(error_of_answer(answer->status, answer->body, url.text()));
  auto doc = proto::parse_json(answer->body, "answer");
  if (!doc)
    return proto::fail("bad_document", url.text() + " answered with something that is not JSON; " +
                                           "is it a Lightkiln service?");
  return doc;
}

proto::Expected<json> Client::Impl::get(const std::string& below) {
  return document(http.Get(path(below)));
}

proto::Expected<void> check_job_id(const std::string& id) {
  const bool fits = id.size() == 30 && id.rfind("job_", 0) == 0 &&
                    std::all_of(id.begin() + 4, id.end(), [](char c) {
                      return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z');
                    });
  if (fits) return {};
  return proto::fail("bad_request", "\"" + id.substr(0, 60) +
                                        "\" is not a job's id: job_ and 26 characters of 0-9a-z");
}

Client::Client(ServerUrl url, std::string token)
    : impl_(std::make_unique<Impl>(std::move(url), std::move(token))) {}
Client::~Client() = default;

proto::Expected<bool> Client::Impl::has_scene(const std::string& key) {
  const auto answer = http.Head(path("/scenes/sha256:" + key));
  if (!answer) return unreachable(answer.error());
  return answer->status == 200;
}

proto::Expected<proto::JobSummary> Client::Impl::submit_known(const Submission& submission,
                                                              const std::string& scene) {
  json request = options_document(submission.options);
  request["scene"] = scene;
  if (!submission.settings_json.empty()) {
    auto settings = proto::parse_json(submission.settings_json, "settings");
    if (!settings) return proto::Unexpected(std::move(settings.error()));
    request["settings"] = std::move(*settings);
  }
  return document(http.Post(path("/jobs"), proto::to_text(request), "application/json"))
      .and_then(proto::job_summary_from_json);
}

proto::Expected<proto::JobSummary> Client::submit(const Submission& submission,
                                                  const RetryPolicy& policy) {
  const auto files = digest_files(submission);
  if (!files) return proto::Unexpected(files.error());
  const auto known = impl_->has_scene(files->key);
  if (!known) return proto::Unexpected(known.error());
  if (*known) {
    auto job = impl_->submit_known(submission, "sha256:" + files->key);
    if (job || job.error().code != "not_found") return job;  // the scene may just have been deleted
  }
  if (files->bytes < kResumableBytes) return impl_->submit_whole(submission);
  auto body = scene_body(submission, files->key);
  if (!body) return proto::Unexpected(std::move(body.error()));
  const auto scene = impl_->upload(*body, "scene-" + files->key, policy);
  if (scene) return impl_->submit_known(submission, *scene);
  // A service of an earlier version does not support uploads.
  const bool unknown = scene.error().code == "not_found" || scene.error().code == "bad_document";
  return unknown ? impl_->submit_whole(submission) : proto::Unexpected(scene.error());
}

proto::Expected<proto::JobSummary> Client::Impl::submit_whole(const Submission& submission) {
  auto body = body_of(submission);
  if (!body) return proto::Unexpected(std::move(body.error()));
  const auto provider = [&](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
    return body->read(offset, length, [&](std::string_view piece) {
      return sink.write(piece.data(), piece.size());
    });
  };
  const auto answer = http.Post(path("/jobs"), body->size(), provider, body->content_type());
  if (!body->error().empty()) return proto::fail("io_error", body->error());
  if (!answer && answer.error() == httplib::Error::Write)
    return proto::fail("server_unreachable",
                       url.text() + " closed the connection during the upload of " +
                           std::to_string(body->size()) +
                           " bytes; it may not accept so many (its --max-upload-bytes)");
  return document(answer).and_then(proto::job_summary_from_json);
}

proto::Expected<proto::JobSummary> Client::job(const std::string& id) {
  if (auto ok = check_job_id(id); !ok) return proto::Unexpected(std::move(ok.error()));
  return impl_->get("/jobs/" + id).and_then(proto::job_summary_from_json);
}

proto::Expected<std::vector<proto::JobSummary>> Client::jobs() {
  return impl_->get("/jobs?limit=50").and_then(proto::job_list_from_json);
}

proto::Expected<proto::JobSummary> Client::Impl::act(const std::string& id,
                                                     const std::string& action, const json& body) {
  if (auto ok = check_job_id(id); !ok) return proto::Unexpected(std::move(ok.error()));
  return document(http.Post(path("/jobs/" + id + "/" + action), proto::to_text(body),
                            "application/json"))
      .and_then(proto::job_summary_from_json);
}

proto::Expected<proto::JobSummary> Client::cancel(const std::string& id, bool keep_light) {
  return impl_->act(id, "cancel", {{"mode", keep_light ? "drain" : "now"}});
}

proto::Expected<proto::JobSummary> Client::retry(const std::string& id, bool from_start) {
  return impl_->act(id, "retry", {{"from", from_start ? "start" : "checkpoint"}});
}

}  // namespace kiln::clients
