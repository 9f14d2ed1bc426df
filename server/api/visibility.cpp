#include "server/api/visibility.h"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <memory>
#include <optional>
#include <string_view>
#include <utility>

#include "baker/visibility/pairs.h"
#include "server/api/request.h"
#include "server/api/upload.h"
#include "server/base/clock.h"
#include "server/http/problem.h"

namespace kiln::api {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr std::chrono::minutes kPatience(10);  // a large scene takes minutes to be made ready
constexpr std::uint64_t kMostBytes = std::uint64_t{visibility::kMostPairs} * visibility::kPairBytes;

Unexpected wrong_scene(const char* code, const std::string& why) {
  return proto::fail(code, why, "request", "/query/scene");
}

bool is_digest(std::string_view text) {
  constexpr std::size_t kDigits = 64;
  return text.size() == kDigits && std::ranges::all_of(text, [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

/// Returns the scene that the query names, if it is one of the client's.
Expected<data::StoredScene> find_scene(const Scenes& part, const http::Request& request) {
  constexpr std::string_view kPrefix = "sha256:";
  if (auto ok = only_query(request, {"scene"}); !ok) return Unexpected(ok.error());
  const std::string* id = request.head.query_value("scene");
  if (!id || !id->starts_with(kPrefix) || !is_digest(std::string_view(*id).substr(kPrefix.size())))
    return wrong_scene("bad_request",
                       "The query parameter `scene` has to name a scene: sha256: and 64 digits.");
  const std::string key = id->substr(kPrefix.size());
  if (auto ok = check_owner(part, request, key); !ok)
    return wrong_scene("not_found", ok.error().message);
  auto scene = part.scenes.use(key);
  if (!scene && scene.error().code == "not_found")
    return wrong_scene("not_found", scene.error().message);
  return scene;
}

Expected<void> check_type(const http::RequestHead& head) {
  const std::string type = media_type(head);
  if (type.empty() || type == "application/octet-stream") return {};
  return proto::fail("unsupported_media_type",
                     "Send the pairs as application/octet-stream, not " + type + ".");
}

/// The time that each step took, as browsers and proxies know it.
std::string server_timing(const VisibilityAnswer& answer) {
  constexpr double kMs = 1000;
  std::array<char, 96> text{};
  std::snprintf(text.data(), text.size(), "scene;dur=%.3f, trace;dur=%.3f",
                answer.ready_seconds * kMs, answer.trace_seconds * kMs);
  return text.data();
}

http::Response bits(http::Request& request, Expected<VisibilityAnswer> answer) {
  if (!answer) return problem(answer.error(), request);
  http::Response response;
  response.content_type = "application/octet-stream";
  response.header("Lightkiln-Pairs", std::to_string(answer->pairs))
      .header("Lightkiln-Visible", std::to_string(answer->visible))
      .header("Server-Timing", server_timing(*answer))
      .header("Cache-Control", "no-store");
  response.body = std::move(answer->bits);
  return response;
}

/// Answers once all pairs are there.
http::Response answer_pairs(const Visibility& part, const http::Request& request,
                            data::StoredScene scene, proto::Fd pairs) {
  const auto result = std::make_shared<std::optional<Expected<VisibilityAnswer>>>();
  const auto file = std::make_shared<const proto::Fd>(std::move(pairs));
  return part.desk.answer(
      [&see = part.see, &pool = part.pool, &owners = part.scenes.owners, &cpu = part.cpu,
       &metrics = part.metrics, tenant = request.principal.tenant,
       input = VisibilityInput{std::move(scene), file->get()}, file,
       result](const std::stop_token& stop) {
        VisibilityResult done = see(input, pool, stop);
        cpu.leave_out(done.cpu_seconds);
        owners.add_usage(tenant, base::today(), {0, done.cpu_seconds});
        if (done.answer) metrics.visibility(done.answer->pairs, done.answer->was_ready);
        *result = std::move(done.answer);
      },
      [result](http::Request& again) { return bits(again, std::move(**result)); }, kPatience,
      "The pairs were not answered in time.");
}

http::Response too_many(const http::Request& request) {
  return problem({"overloaded", "Too many requests of visibility are being answered.", {}},
                 request);
}

}  // namespace

http::Response post_visibility(const Visibility& part, http::Request& request) {
  if (auto ok = check_type(request.head); !ok) return problem(ok.error(), request);
  auto scene = find_scene(part.scenes, request);
  if (!scene) return problem(scene.error(), request);
  if (auto ok = part.admission.check_day(request.principal.tenant); !ok)
    return problem(ok.error(), request);
  if (!part.desk.has_room()) return too_many(request);
  return receive_file(
      request, part.scenes.intake, kMostBytes,
      [&part, scene = std::move(*scene)](http::Request& again, Expected<proto::Fd> pairs) {
        if (!pairs) return problem(pairs.error(), again);
        if (!part.desk.has_room()) return too_many(again);
        return answer_pairs(part, again, scene, std::move(*pairs));
      });
}

}  // namespace kiln::api
