#include "clients/client.h"

#include <algorithm>
#include <random>
#include <utility>

#include "clients/client_impl.h"
#include "clients/multipart_body.h"
#include "proto/json.h"

namespace kiln::clients {
namespace {

using nlohmann::json;

/// A boundary that the files' bytes don't contain, but for a chance of 2^-128.
std::string random_boundary() {
  std::random_device random;
  std::string text = "lightkiln-";
  constexpr std::string_view kDigits = "0123456789abcdef";
  for (int i = 0; i < 32; ++i) text += kDigits[random() & 15u];
  return text;
}

proto::Expected<MultipartBody> body_of(const Submission& s) {
  MultipartBody body(random_boundary());
  if (!s.settings_json.empty()) body.add_text("settings", "application/json", s.settings_json);
  json options = proto::to_json(s.options);
  if (!s.options.ttl_seconds) options.erase("ttl_seconds");  // the service's default
  body.add_text("options", "application/json", proto::to_text(options));
  if (auto ok = body.add_file("scene", s.scene.filename().string(), s.scene); !ok)
    return proto::Unexpected(std::move(ok.error()));
  for (const auto& [name, path] : s.side)
    if (auto ok = body.add_file("file", name, path); !ok)
      return proto::Unexpected(std::move(ok.error()));
  body.finish();
  return body;
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
  return proto::fail("server_unreachable", "no answer from " + url.text() + " (" +
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

proto::Expected<proto::JobSummary> Client::submit(const Submission& submission) {
  auto body = body_of(submission);
  if (!body) return proto::Unexpected(std::move(body.error()));
  const auto provider = [&](std::size_t offset, std::size_t length, httplib::DataSink& sink) {
    return body->read(offset, length, [&](std::string_view piece) {
      return sink.write(piece.data(), piece.size());
    });
  };
  const auto answer =
      impl_->http.Post(impl_->path("/jobs"), body->size(), provider, body->content_type());
  if (!body->error().empty()) return proto::fail("io_error", body->error());
  if (!answer && answer.error() == httplib::Error::Write)
    return proto::fail("server_unreachable",
                       impl_->url.text() + " closed the connection during the upload of " +
                           std::to_string(body->size()) +
                           " bytes; it may not accept so many (its --max-upload-bytes)");
  return impl_->document(answer).and_then(proto::job_summary_from_json);
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
