#include "server/api/admin.h"

#include <nlohmann/json.hpp>

#include "server/http/problem.h"

namespace kiln::api {

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
