#include "server/api/routes.h"

namespace kiln::api {
namespace {

template <auto handler, auto part>
http::Response call(const Resources& resources, http::Request& request) {
  return handler(resources.*part, request);
}

struct Route {
  const char *method, *pattern;
  http::Response (*call)(const Resources&, http::Request&);
};

constexpr Route kRoutes[] = {
    {"GET", "/", call<get_root, &Resources::capabilities>},
    {"GET", "/openapi.json", call<get_openapi, &Resources::capabilities>},
    {"GET", "/v1/capabilities", call<get_capabilities, &Resources::capabilities>},
    {"POST", "/v1/scenes", call<post_scene, &Resources::scenes>},
    {"PUT", "/v1/scenes/sha256:{}", call<put_scene_named, &Resources::scenes>},
    {"GET", "/v1/scenes/sha256:{}", call<get_scene, &Resources::scenes>},
    {"POST", "/v1/jobs", call<post_job, &Resources::submit>},
    {"GET", "/v1/jobs", call<list_jobs, &Resources::jobs>},
    {"GET", "/v1/jobs/{}", call<get_job, &Resources::jobs>},
    {"PATCH", "/v1/jobs/{}", call<patch_job, &Resources::jobs>},
    {"DELETE", "/v1/jobs/{}", call<delete_job, &Resources::jobs>},
    {"POST", "/v1/jobs/{}/cancel", call<cancel_job, &Resources::jobs>},
    {"POST", "/v1/jobs/{}/retry", call<retry_job, &Resources::jobs>},
    {"GET", "/v1/jobs/{}/events", call<get_events, &Resources::events>},
    {"GET", "/v1/events", call<get_all_events, &Resources::events>},
    {"POST", "/v1/uploads", call<post_upload, &Resources::uploads>},
    {"GET", "/v1/uploads/{}", call<get_upload, &Resources::uploads>},
    {"PATCH", "/v1/uploads/{}", call<patch_upload, &Resources::uploads>},
    {"DELETE", "/v1/uploads/{}", call<delete_upload, &Resources::uploads>},
    {"POST", "/v1/webhooks/test", call<test_webhook, &Resources::webhook_tests>},
    {"GET", "/v1/jobs/{}/results", call<get_results, &Resources::results>},
    {"GET", "/v1/jobs/{}/results/{}", call<get_result, &Resources::results>},
    {"GET", "/v1/jobs/{}/results.zip", call<get_results_zip, &Resources::results>},
    {"GET", "/v1/jobs/{}/preview", call<get_preview, &Resources::results>},
    {"GET", "/v1/jobs/{}/view", call<get_view, &Resources::views>},
    {"POST", "/v1/visibility", call<post_visibility, &Resources::visibility>},
};

}  // namespace

http::Router make_router(const Resources& resources) {
  http::Router router;
  for (const Route& route : kRoutes)
    router.add(route.method, route.pattern,
               [&resources, call = route.call](http::Request& request) {
                 return call(resources, request);
               });
  return router;
}

std::vector<std::pair<std::string, std::string>> api_routes() {
  std::vector<std::pair<std::string, std::string>> all;
  for (const Route& route : kRoutes) all.emplace_back(route.method, route.pattern);
  return all;
}

}  // namespace kiln::api
