#include "server/api/capabilities.h"

#include <nlohmann/json.hpp>
#include <string>

#include "baker/bake.h"
#include "baker/visibility/pairs.h"
#include "proto/json.h"
#include "proto/json_values.h"
#include "server/api/openapi.h"
#include "server/http/problem.h"
#include "server/sandbox/setup.h"

namespace kiln::api {
namespace {

using base::ServerConfig;
using files::ImportLimits;

/// The source of the figures of the limits.
struct LimitSources {
  const Capabilities& part;
  const ImportLimits import;
};

struct Limit {
  const char* name;
  std::uint64_t (*of)(const LimitSources&);
};

template <auto member>
std::uint64_t configured(const LimitSources& from) {
  return from.part.config.*member;
}

template <auto member>
std::uint64_t of_import(const LimitSources& from) {
  return from.import.*member;
}

// The table holds every limit that a client can meet, by its name in the API. 0 means that there is
// none.
constexpr Limit kLimits[] = {
    {"job_seconds", configured<&ServerConfig::max_job_seconds>},
    {"tenant_queued_jobs", configured<&ServerConfig::max_queued_jobs_per_tenant>},
    {"tenant_running_jobs", configured<&ServerConfig::max_running_jobs_per_tenant>},
    {"tenant_result_bytes", configured<&ServerConfig::max_bytes_per_tenant>},
    {"tenant_texels_per_day", configured<&ServerConfig::max_texels_per_tenant_per_day>},
    {"tenant_cpu_seconds_per_day", configured<&ServerConfig::max_cpu_seconds_per_tenant_per_day>},
    {"tenant_requests_per_minute", configured<&ServerConfig::max_requests_per_minute_per_tenant>},
    {"token_requests_per_minute", configured<&ServerConfig::max_requests_per_minute_per_token>},
    {"tenant_uploads", configured<&ServerConfig::max_uploads_per_tenant>},
    {"address_uploads", configured<&ServerConfig::max_uploads_per_address>},
    {"upload_bytes", configured<&ServerConfig::max_upload_bytes>},
    {"visibility_pairs",
     [](const LimitSources&) -> std::uint64_t { return visibility::kMostPairs; }},
    {"request_json_bytes", configured<&ServerConfig::max_request_json_bytes>},
    {"memory_bytes", [](const LimitSources& from) { return from.part.admission.memory_limit(); }},
    {"queued_jobs", configured<&ServerConfig::max_queued_jobs>},
    {"running_jobs", configured<&ServerConfig::max_running_jobs>},
    {"scene_json_bytes", of_import<&ImportLimits::json_bytes>},
    {"scene_json_depth", of_import<&ImportLimits::json_depth>},
    {"import_memory_bytes", [](const LimitSources& from) { return from.part.import_memory_bytes; }},
    {"import_seconds", configured<&ServerConfig::import_seconds>},
    {"nodes", of_import<&ImportLimits::nodes>},
    {"node_depth", of_import<&ImportLimits::node_depth>},
    {"vertices", of_import<&ImportLimits::vertices>},
    {"triangles", of_import<&ImportLimits::triangles>},
    {"image_pixels", of_import<&ImportLimits::image_pixels>},
    {"all_image_pixels", of_import<&ImportLimits::all_image_pixels>},
    {"lights", of_import<&ImportLimits::lights>},
};

nlohmann::json limits_document(const Capabilities& part) {
  const LimitSources from{part, sandbox::import_limits(part.config)};
  auto document = nlohmann::json::object();
  for (const Limit& limit : kLimits) document[limit.name] = limit.of(from);
  return document;
}

// The schema lists the presets in the order of their values.
nlohmann::json presets_document(const nlohmann::json& schema) {
  const auto& names = schema.at("/properties/quality/properties/preset/enum"_json_pointer);
  nlohmann::json document;
  for (std::size_t i = 0; i < names.size(); ++i)
    document[names[i].get<std::string>()] = {
        {"target_error", proto::shortest_number(proto::target_error(proto::Preset(i)))}};
  return document;
}

nlohmann::json usage_document(const Capabilities& part, const std::string& tenant) {
  const jobs::Admission::Usage usage = part.admission.usage(tenant);
  return {{"queued_jobs", usage.queued},
          {"running_jobs", usage.running},
          {"result_bytes", usage.result_bytes},
          {"upload_bytes", part.uploads.bytes(tenant)},
          {"texels_today", usage.today.texels},
          {"cpu_seconds_today", usage.today.cpu_seconds},
          {"day", usage.day}};
}

}  // namespace

http::Response get_capabilities(const Capabilities& part, http::Request& request) {
  const nlohmann::json schema = proto::settings_schema();
  return http::json_response(
      200, {{"version", LIGHTKILN_VERSION},
            {"methods", schema.at("/properties/solver/properties/method/enum"_json_pointer)},
            {"settings", {{"schema", schema}, {"defaults", proto::to_json(proto::BakeSettings{})}}},
            {"threads", part.bake_threads},
            {"instruction_set", baker::instruction_set()},
            {"presets", presets_document(schema)},
            {"limits", limits_document(part)},
            {"usage", usage_document(part, request.principal.tenant)}});
}

http::Response get_root(const Capabilities& part, http::Request& request) {
  const std::string* host = request.head.header("host");
  const std::string url = "http://" + (host ? *host : part.config.listen);
  http::Response response;
  response.content_type = "text/plain; charset=utf-8";
  response.body = "Lightkiln " LIGHTKILN_VERSION
                  ": lightmaps for glTF scenes.\n\nBake a scene:\n  curl -F scene=@scene.glb " +
                  url + "/v1/jobs\nFollow it:\n  curl -N " + url +
                  "/v1/jobs/{id}/events\nFetch what came of it:\n  curl " + url +
                  "/v1/jobs/{id}/results\nWhat can be set:\n  curl " + url + "/v1/capabilities\n";
  return response;
}

http::Response get_openapi(const Capabilities&, http::Request&) {
  return http::json_response(200, openapi_document());
}

}  // namespace kiln::api
