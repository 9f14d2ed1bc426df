#include "server/api/api.h"

#include <algorithm>
#include <charconv>
#include <nlohmann/json.hpp>

#include "baker/bake.h"
#include "proto/json.h"
#include "proto/json_values.h"
#include "server/api/openapi.h"
#include "server/base/ids.h"
#include "server/http/problem.h"
#include "server/sandbox/setup.h"

namespace kiln::api {

Api::Api(ApiParts parts)
    : parts_(std::move(parts)),
      tenant_rate_(parts_.config.max_requests_per_minute_per_tenant),
      token_rate_(parts_.config.max_requests_per_minute_per_token),
      webhook_tests_(std::max<std::ptrdiff_t>(parts_.config.http_threads / 2, 1)) {
  for (const Route& route : routes())
    router_.add(route.method, route.pattern,
                [this, handler = route.handler](http::Request& r) { return (this->*handler)(r); });
}

const std::vector<Api::Route>& Api::routes() {
  static const std::vector<Route> all{
      {"GET", "/", &Api::get_root},
      {"GET", "/openapi.json", &Api::get_openapi},
      {"GET", "/v1/capabilities", &Api::get_capabilities},
      {"POST", "/v1/scenes", &Api::post_scene},
      {"PUT", "/v1/scenes/sha256:{}", &Api::put_scene_named},
      {"GET", "/v1/scenes/sha256:{}", &Api::get_scene},
      {"POST", "/v1/jobs", &Api::post_job},
      {"GET", "/v1/jobs", &Api::list_jobs},
      {"GET", "/v1/jobs/{}", &Api::get_job},
      {"PATCH", "/v1/jobs/{}", &Api::patch_job},
      {"DELETE", "/v1/jobs/{}", &Api::delete_job},
      {"POST", "/v1/jobs/{}/cancel", &Api::cancel_job},
      {"POST", "/v1/jobs/{}/retry", &Api::retry_job},
      {"GET", "/v1/jobs/{}/events", &Api::get_events},
      {"GET", "/v1/events", &Api::get_all_events},
      {"POST", "/v1/uploads", &Api::post_upload},
      {"GET", "/v1/uploads/{}", &Api::get_upload},
      {"PATCH", "/v1/uploads/{}", &Api::patch_upload},
      {"DELETE", "/v1/uploads/{}", &Api::delete_upload},
      {"POST", "/v1/webhooks/test", &Api::test_webhook},
      {"GET", "/v1/jobs/{}/results", &Api::get_results},
      {"GET", "/v1/jobs/{}/results/{}", &Api::get_result},
      {"GET", "/v1/jobs/{}/results.zip", &Api::get_results_zip},
      {"GET", "/v1/jobs/{}/preview", &Api::get_preview},
  };
  return all;
}

std::vector<std::pair<std::string, std::string>> api_routes() {
  std::vector<std::pair<std::string, std::string>> all;
  for (const Api::Route& route : Api::routes()) all.emplace_back(route.method, route.pattern);
  return all;
}

http::Response Api::handle(http::Request& request) {
  const std::string& path = request.head.path;
  if (path != "/" && path != "/openapi.json") {  // these tell nothing of this service
    auto principal = parts_.gate.admit(request.head);
    if (!principal) return problem(principal.error(), request);
    request.principal = std::move(*principal);
    return handle_limited(request);
  }
  return router_.route(request);
}

// Says with every answer what is left, as draft-ietf-httpapi-ratelimit-headers has it.
http::Response Api::handle_limited(http::Request& request) {
  const base::Principal& client = request.principal;
  // A request that one of them refuses costs the other nothing.
  const bool counts =
      tenant_rate_.look(client.tenant).allowed && token_rate_.look(client.token).allowed;
  const auto state = [&](auth::RateLimiter& limiter, const std::string& key) {
    return counts ? limiter.take(key) : limiter.look(key);
  };
  const std::pair<const char*, auth::RateLimiter::State> states[]{
      {"tenant", state(tenant_rate_, client.tenant)}, {"token", state(token_rate_, client.token)}};
  std::string policies, now;
  std::uint32_t retry = 0;
  for (const auto& [name, left] : states) {
    if (!left.limited) continue;
    const std::string comma = policies.empty() ? "\"" : ", \"";
    policies += comma + name + "\";q=" + std::to_string(left.limit) + ";w=60";
    now += comma + name + "\";r=" + std::to_string(left.remaining) +
           ";t=" + std::to_string(left.reset);
    if (!left.allowed) retry = std::max(retry, left.retry);
  }
  http::Response response =
      retry == 0 ? router_.route(request)
                 : problem({"rate_limited",
                            "Too many requests; one is allowed in " + std::to_string(retry) + " s.",
                            {}},
                           request);
  if (policies.empty()) return response;
  if (retry > 0) response.replace("Retry-After", std::to_string(retry));
  return response.header("RateLimit-Policy", policies).header("RateLimit", now);
}

http::Response Api::get_root(http::Request& request) {
  const std::string* host = request.head.header("host");
  const std::string url = "http://" + (host ? *host : parts_.config.listen);
  http::Response response;
  response.content_type = "text/plain; charset=utf-8";
  response.body = "Lightkiln " LIGHTKILN_VERSION
                  ": lightmaps for glTF scenes.\n\nBake a scene:\n  curl -F scene=@scene.glb " +
                  url + "/v1/jobs\nFollow it:\n  curl -N " + url +
                  "/v1/jobs/{id}/events\nFetch what came of it:\n  curl " + url +
                  "/v1/jobs/{id}/results\nWhat can be set:\n  curl " + url + "/v1/capabilities\n";
  return response;
}

http::Response Api::get_openapi(http::Request&) {
  return http::json_response(200, openapi_document());
}

http::Response Api::get_capabilities(http::Request& request) {
  const nlohmann::json schema = proto::settings_schema();
  nlohmann::json document{
      {"version", LIGHTKILN_VERSION},
      {"methods", schema.at("/properties/solver/properties/method/enum"_json_pointer)},
      {"settings", {{"schema", schema}, {"defaults", proto::to_json(proto::BakeSettings{})}}},
      {"threads", parts_.bake_threads},
      {"instruction_set", baker::instruction_set()}};
  // The schema lists the presets in the order of their values.
  const auto& names = schema.at("/properties/quality/properties/preset/enum"_json_pointer);
  for (std::size_t i = 0; i < names.size(); ++i)
    document["presets"][names[i].get<std::string>()] = {
        {"target_error", proto::shortest_number(proto::target_error(proto::Preset(i)))}};
  const files::ImportLimits import = sandbox::import_limits(parts_.config);
  document["limits"] = {
      {"job_seconds", parts_.config.max_job_seconds},
      {"tenant_queued_jobs", parts_.config.max_queued_jobs_per_tenant},
      {"tenant_running_jobs", parts_.config.max_running_jobs_per_tenant},
      {"tenant_result_bytes", parts_.config.max_bytes_per_tenant},
      {"tenant_texels_per_day", parts_.config.max_texels_per_tenant_per_day},
      {"tenant_cpu_seconds_per_day", parts_.config.max_cpu_seconds_per_tenant_per_day},
      {"tenant_requests_per_minute", parts_.config.max_requests_per_minute_per_tenant},
      {"token_requests_per_minute", parts_.config.max_requests_per_minute_per_token},
      {"upload_bytes", parts_.config.max_upload_bytes},
      {"request_json_bytes", parts_.config.max_request_json_bytes},
      {"memory_bytes", parts_.jobs.admission().memory_limit()},
      {"queued_jobs", parts_.config.max_queued_jobs},
      {"running_jobs", parts_.config.max_running_jobs},
      {"scene_json_bytes", import.json_bytes},
      {"scene_json_depth", import.json_depth},
      {"import_memory_bytes", parts_.import_memory_bytes},
      {"import_seconds", parts_.config.import_seconds},
      {"nodes", import.nodes},
      {"node_depth", import.node_depth},
      {"vertices", import.vertices},
      {"triangles", import.triangles},
      {"image_pixels", import.image_pixels},
      {"all_image_pixels", import.all_image_pixels},
      {"lights", import.lights}};
  const std::string& tenant = request.principal.tenant;
  const jobs::Admission::Usage usage = parts_.jobs.admission().usage(tenant);
  document["usage"] = {{"queued_jobs", usage.queued},
                       {"running_jobs", usage.running},
                       {"result_bytes", usage.result_bytes},
                       {"upload_bytes", parts_.uploads.bytes(tenant)},
                       {"texels_today", usage.today.texels},
                       {"cpu_seconds_today", usage.today.cpu_seconds},
                       {"day", usage.day}};
  return http::json_response(200, document);
}

proto::Expected<std::optional<std::uint64_t>> query_number(const http::Request& request,
                                                           const char* name, std::uint64_t max) {
  const std::string* text = request.head.query_value(name);
  if (!text) return std::nullopt;
  std::uint64_t value = 0;
  const auto parsed = std::from_chars(text->data(), text->data() + text->size(), value);
  if (text->empty() || parsed.ec != std::errc() || parsed.ptr != text->data() + text->size() ||
      value > max)
    return proto::fail("bad_request",
                       std::string("The query parameter `") + name +
                           "` has to be a whole number from 0 to " + std::to_string(max) + ".",
                       "request", std::string("/query/") + name);
  return value;
}

http::AdminPages admin_pages(const data::DataFolder& data, store::JobStore& store,
                             const std::function<bool()>& draining,
                             const std::function<std::string()>& metrics) {
  http::AdminPages pages;
  pages["/healthz"] = [] {
    return http::json_response(200, {{"status", "ok"}, {"version", LIGHTKILN_VERSION}});
  };
  pages["/metrics"] = [metrics] {
    http::Response response;
    response.content_type = "text/plain; version=0.0.4; charset=utf-8";
    response.body = metrics();
    return response.header("Cache-Control", "no-store");
  };
  pages["/readyz"] = [&data, &store, draining] {
    constexpr double kMinFree = 0.05;
    const bool is_draining = draining();
    const bool store_ok = store.writable(), disk_ok = data.writable();
    const double free = data.free_share();
    const bool ready = !is_draining && store_ok && disk_ok && free >= kMinFree;
    return http::json_response(ready ? 200 : 503, {{"ready", ready},
                                                   {"draining", is_draining},
                                                   {"store_writable", store_ok},
                                                   {"disk_writable", disk_ok},
                                                   {"disk_free_share", free}});
  };
  return pages;
}

}  // namespace kiln::api
