#include "server/api/api.h"

#include <algorithm>
#include <string>
#include <utility>

#include "server/http/problem.h"

namespace kiln::api {

Api::Api(ApiParts parts)
    : gate_(parts.gate),
      tenant_rate_(parts.config.max_requests_per_minute_per_tenant),
      token_rate_(parts.config.max_requests_per_minute_per_token),
      webhook_tests_(std::max<std::ptrdiff_t>(parts.config.http_threads / 2, 1)),
      view_(parts.view),
      see_(parts.see),
      resources_([&]() -> Resources {
        const auto& [config, data, store, scenes, jobs, feeds, webhooks, uploads, gate, check, pool,
                     view, see, metrics, import_memory] = parts;
        const Intake intake{data, {config.max_upload_bytes, config.max_request_json_bytes}};
        const jobs::JobLookup& lookup = jobs.lookup();
        return {.capabilities = {config, jobs.admission(), uploads, pool.size(), import_memory},
                .scenes = {scenes, store, check, intake},
                .submit = {jobs.submitter(), lookup, webhooks, resources_.scenes},
                .jobs = {lookup, jobs.control(), intake},
                .events = {lookup, feeds},
                .uploads = {uploads, store, resources_.scenes, config.max_bytes_per_tenant},
                .webhook_tests = {webhooks, intake, webhook_tests_},
                .results = {lookup, data, previews_},
                .views = {lookup, data, view_, pool, views_},
                .visibility = {resources_.scenes, see_, pool, visibility_, jobs.admission(),
                               jobs.cpu_meter(), metrics}};
      }()),
      router_(make_router(resources_)) {}

http::Response Api::handle(http::Request& request) {
  const std::string& path = request.head.path;
  if (path != "/" && path != "/openapi.json") {  // both are the same for all clients
    auto principal = gate_.admit(request.head);
    if (!principal) return problem(principal.error(), request);
    request.principal = std::move(*principal);
    return handle_limited(request);
  }
  return router_.route(request);
}

// Every answer says how many requests are left, as draft-ietf-httpapi-ratelimit-headers has it.
http::Response Api::handle_limited(http::Request& request) {
  const base::Principal& client = request.principal;
  // A request that one limit refuses costs the other nothing.
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

}  // namespace kiln::api
