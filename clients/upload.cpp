#include <algorithm>
#include <charconv>
#include <chrono>
#include <thread>
#include <utility>

#include "clients/client_impl.h"
#include "clients/multipart_body.h"
#include "proto/json.h"

/// This file sends uploads and resumes them where they broke.
namespace kiln::clients {
namespace {

using Clock = std::chrono::steady_clock;
using nlohmann::json;

std::optional<std::uint64_t> offset_of(const httplib::Response& answer) {
  const std::string text = answer.get_header_value("Upload-Offset");
  std::uint64_t value = 0;
  const auto parsed = std::from_chars(text.data(), text.data() + text.size(), value);
  if (text.empty() || parsed.ec != std::errc() || parsed.ptr != text.data() + text.size())
    return std::nullopt;
  return value;
}

/// Sends one body in one upload, over as many connections as needed.
class Uploader {
 public:
  Uploader(Client::Impl& client, MultipartBody& body, const std::string& name,
           const RetryPolicy& policy)
      : client_(client), body_(body), name_(name), policy_(policy) {}

  proto::Expected<std::string> run() {
    auto pause = policy_.first;
    auto moved = Clock::now();
    std::uint64_t best = 0;
    while (true) {
      const bool answered = !error_ && (path_.empty() ? begin() : send());
      if (error_) return proto::Unexpected(std::move(*error_));
      if (!scene_.empty()) return scene_;
      if (answered || offset_ > best) {
        moved = Clock::now();
        pause = policy_.first;
        best = std::max(best, offset_);
        if (answered) continue;
      }
      if (Clock::now() - moved > policy_.give_up) return proto::Unexpected(std::move(lost_));
      std::this_thread::sleep_for(pause);
      pause = std::min(2 * pause, policy_.longest);
      if (!path_.empty()) ask();
    }
  }

 private:
  Client::Impl& client_;
  MultipartBody& body_;
  const std::string name_;
  const RetryPolicy policy_;
  std::string path_;  ///< the upload's path; "" until the service has named it
  std::uint64_t offset_ = 0;
  std::string scene_;
  std::optional<proto::Error> error_;  ///< an error that no retry can fix
  proto::Error lost_;                  ///< the reason why there was no answer

  void fail(const httplib::Response& answer) {
    error_ = error_of_answer(answer.status, answer.body, client_.url.text());
  }

  void set_offset(const httplib::Response& answer) {
    const auto told = offset_of(answer);
    if (told && *told <= body_.size())
      offset_ = *told;
    else
      error_ = proto::Error{"bad_document", client_.url.text() + " sends no Upload-Offset", {}};
  }

  bool is_passing(const httplib::Result& answer) {
    if (!answer) {
      lost_ = client_.unreachable(answer.error()).value();
      return true;
    }
    if (answer->status < 500 && answer->status != 429) return false;
    lost_ = error_of_answer(answer->status, answer->body, client_.url.text());
    return answer->status != 507;  // a full disk stays full
  }

  bool begin() {
    const httplib::Headers headers{{"Upload-Length", std::to_string(body_.size())},
                                   {"Idempotency-Key", name_}};
    const auto answer =
        client_.http.Post(client_.path("/uploads"), headers, "", body_.content_type());
    if (is_passing(answer)) return false;
    const std::string at = answer->get_header_value("Location");
    if ((answer->status != 200 && answer->status != 201) || !at.starts_with("/v1/uploads/")) {
      fail(*answer);
      return true;
    }
    path_ = client_.url.base + at;
    set_offset(*answer);
    return true;
  }

  // Sends one PATCH with all bytes that remain.
  bool send() {
    const auto provider = [&](std::size_t at, std::size_t length, httplib::DataSink& sink) {
      return body_.read(offset_ + at, length, [&](std::string_view piece) {
        return sink.write(piece.data(), piece.size());
      });
    };
    const httplib::Headers headers{{"Upload-Offset", std::to_string(offset_)}};
    const auto answer = client_.http.Patch(path_, headers, body_.size() - offset_, provider,
                                           "application/partial-upload");
    if (!body_.error().empty()) {
      error_ = proto::Error{"io_error", body_.error(), {}};
      return true;
    }
    if (is_passing(answer)) return false;
    if (answer->status == 409 || answer->status == 204) {
      lost_ =
          proto::Error{"bad_document", client_.url.text() + " accepts no bytes of the upload", {}};
      const std::uint64_t before = offset_;
      set_offset(*answer);
      return offset_ != before;
    }
    take_scene(*answer);
    return true;
  }

  // Asks for the upload's offset after a connection broke. Without an answer the next round asks
  // again.
  void ask() {
    const auto answer = client_.http.Get(path_);
    if (is_passing(answer)) return;
    if (answer->status == 404) {
      path_.clear();  // the upload expired, so it starts again
      offset_ = 0;
    } else if (answer->status == 200) {
      set_offset(*answer);
    } else {
      fail(*answer);
    }
  }

  void take_scene(const httplib::Response& answer) {
    const auto document = proto::parse_json(answer.body, "answer");
    if ((answer.status != 200 && answer.status != 201) || !document || !document->is_object() ||
        !document->contains("id") || !(*document)["id"].is_string())
      return fail(answer);
    scene_ = (*document)["id"].get<std::string>();
  }
};

}  // namespace

proto::Expected<std::string> Client::Impl::upload(MultipartBody& body, const std::string& name,
                                                  const RetryPolicy& policy) {
  return Uploader(*this, body, name, policy).run();
}

}  // namespace kiln::clients
