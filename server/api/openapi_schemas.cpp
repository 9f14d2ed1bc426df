#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "proto/problems.h"
#include "server/api/openapi.h"

namespace kiln::api {
namespace {

using nlohmann::json;

json ref(const char* name) {
  return {{"$ref", std::string("#/components/schemas/") + name}};
}

json text(const char* description) {
  return {{"type", "string"}, {"description", description}};
}

json integer(std::int64_t minimum = 0) {
  return {{"type", "integer"}, {"minimum", minimum}};
}

json integer(std::int64_t minimum, const char* description) {
  return {{"type", "integer"}, {"minimum", minimum}, {"description", description}};
}

json digest(const char* description) {
  return {{"type", "string"}, {"pattern", "^[0-9a-f]{64}$"}, {"description", description}};
}

json nullable(json schema) {
  schema["type"] = {schema["type"], "null"};
  return schema;
}

json time(const char* description) {
  return {{"type", "string"}, {"format", "date-time"}, {"description", description}};
}

json list_of(json items) {
  return {{"type", "array"}, {"items", std::move(items)}};
}

/// Makes an object of exactly these members.
json closed(json properties) {
  json required = json::array();
  for (const auto& [name, schema] : properties.items()) required.push_back(name);
  return {{"type", "object"},
          {"properties", std::move(properties)},
          {"required", std::move(required)},
          {"additionalProperties", false}};
}

json states() {
  json all = json::array();
  for (int i = 0; i <= static_cast<int>(proto::JobState::kCanceled); ++i)
    all.push_back(proto::to_string(static_cast<proto::JobState>(i)));
  return {{"type", "string"}, {"enum", std::move(all)}};
}

json codes() {
  json all = json::array();
  for (const auto& kind : proto::problem_kinds()) all.push_back(std::string(kind.code));
  return {{"type", "string"}, {"enum", std::move(all)}};
}

json priority() {
  constexpr int kMax = proto::JobOptions::kMaxPriority;
  return {{"type", "integer"}, {"minimum", -kMax}, {"maximum", kMax}};
}

json ttl_seconds() {
  return {{"type", "integer"}, {"minimum", 0}, {"maximum", proto::JobOptions::kMaxTtlSeconds}};
}

json labels() {
  return {{"type", "object"},
          {"additionalProperties", {{"type", "string"}}},
          {"maxProperties", proto::JobOptions::kMaxLabels}};
}

json webhook() {
  json events = json::array();
  for (const auto& name : proto::kWebhookEvents) events.push_back(std::string(name));
  return {
      {"type", "object"},
      {"properties",
       {{"url", {{"type", "string"}, {"maxLength", proto::Webhook::kMaxUrl}}},
        {"events",
         {{"type", "array"},
          {"minItems", 1},
          {"uniqueItems", true},
          {"default", {"job.end"}},
          {"items", {{"type", "string"}, {"enum", std::move(events)}}}}},
        {"secret_ref", nullable(text("name of a secret of the service; without: not signed"))}}},
      {"required", {"url"}},
      {"additionalProperties", false}};
}

json or_null(const char* schema) {
  return {{"oneOf", {ref(schema), {{"type", "null"}}}}};
}

json options() {
  return {{"type", "object"},
          {"properties",
           {{"priority", priority()},
            {"labels", labels()},
            {"ttl_seconds", ttl_seconds()},
            {"dedupe", {{"type", "boolean"}, {"default", true}}},
            {"webhook", or_null("Webhook")}}},
          {"additionalProperties", false}};
}

json job_request() {
  json schema = options();
  schema["properties"]["scene"] = {{"type", "string"}, {"pattern", "^sha256:[0-9a-f]{64}$"}};
  schema["properties"]["settings"] = ref("Settings");
  schema["required"] = {"scene"};
  return schema;
}

json patch() {
  json schema = options();
  schema["properties"].erase("dedupe");
  schema["properties"].erase("webhook");
  schema["properties"]["labels"]["additionalProperties"] = {{"type", {"string", "null"}}};
  return schema;
}

json progress() {
  return closed({{"stage", text("import, atlas, solve, reference or output")},
                 {"pass", integer()},
                 {"max_passes", integer()},
                 {"batches_done", integer()},
                 {"batches_total", integer()},
                 {"residual", {{"type", "number"}}},
                 {"fraction", {{"type", "number"}, {"minimum", 0}, {"maximum", 1}}},
                 {"eta_seconds", {{"type", {"number", "null"}}, {"minimum", 0}}}});
}

json links() {
  json members = json::object();
  for (const char* name : {"self", "events", "results", "cancel", "retry", "preview"})
    members[name] = {{"type", "string"}};
  return closed(std::move(members));
}

json place() {
  return closed({{"source", text("scene, settings or request")},
                 {"pointer", text("JSON pointer (RFC 6901)")},
                 {"detail", {{"type", "string"}}}});
}

/// RFC 9457. A failed job's error has neither `instance` nor `request_id`.
json problem_schema() {
  json schema = closed({{"type", {{"type", "string"}}},
                        {"title", {{"type", "string"}}},
                        {"status", integer(400)},
                        {"detail", {{"type", "string"}}},
                        {"code", codes()},
                        {"errors", list_of(place())}});
  schema["properties"]["instance"] = {{"type", "string"}};
  schema["properties"]["request_id"] = {{"type", "string"}};
  return schema;
}

json job() {
  return closed({{"id", {{"type", "string"}, {"pattern", "^job_[0-9a-z]{26}$"}}},
                 {"state", states()},
                 {"attempt", integer(1)},
                 {"version", integer(1)},
                 {"scene", closed({{"sha256", {{"type", "string"}}}, {"bytes", integer()}})},
                 {"settings", ref("Settings")},
                 {"settings_hash", digest("of the settings, defaults included")},
                 {"result_key", nullable(digest("of scene, settings, version and instruction set: "
                                                "jobs with the same key have the same pixels"))},
                 {"queue_position",
                  nullable(integer(1, "of a job that waits, by priority and age; 1: the next"))},
                 {"tenant", nullable(text("null on a service without tokens"))},
                 {"priority", priority()},
                 {"labels", labels()},
                 {"webhook", or_null("Webhook")},
                 {"ttl_seconds", ttl_seconds()},
                 {"cached", {{"type", "boolean"}}},
                 {"created_at", time("when it was posted")},
                 {"started_at", nullable(time("of the attempt"))},
                 {"finished_at", nullable(time("when it was over"))},
                 {"expires_at", nullable(time("when it will be deleted"))},
                 {"memory_estimate_bytes", nullable(integer(1))},
                 {"progress", ref("Progress")},
                 {"error", or_null("Problem")},
                 {"links", links()}});
}

json scene() {
  return closed({{"id", {{"type", "string"}, {"pattern", "^sha256:[0-9a-f]{64}$"}}},
                 {"sha256", text("of the main file")},
                 {"bytes", integer()},
                 {"side_files", integer()},
                 {"links", closed({{"self", {{"type", "string"}}}})}});
}

json upload() {
  return closed({{"id", {{"type", "string"}, {"pattern", "^upl_[0-9a-z]{26}$"}}},
                 {"offset", integer()},
                 {"length", integer(1)},
                 {"complete", {{"type", "boolean"}}},
                 {"expires_at", time("when it is forgotten")},
                 {"scene", nullable(text("sha256:..., once it is whole"))},
                 {"links", closed({{"self", {{"type", "string"}}}})}});
}

json capabilities() {
  const json usage = closed({{"queued_jobs", integer()},
                             {"running_jobs", integer()},
                             {"result_bytes", integer()},
                             {"upload_bytes", integer()},
                             {"texels_today", integer()},
                             {"cpu_seconds_today", {{"type", "number"}}},
                             {"day", {{"type", "string"}, {"format", "date"}}}});
  return {{"type", "object"},
          {"properties",
           {{"version", {{"type", "string"}}},
            {"limits", {{"type", "object"}, {"additionalProperties", integer()}}},
            {"usage", usage}}},
          {"required", {"version", "limits", "usage"}}};
}

json result_file() {
  return closed({{"name", {{"type", "string"}}},
                 {"media_type", {{"type", "string"}}},
                 {"bytes", integer()},
                 {"sha256", {{"type", "string"}}},
                 {"href", {{"type", "string"}}}});
}

}  // namespace

json openapi_schemas() {
  json settings = proto::settings_schema();
  settings.erase("$schema");  // that of the whole document holds
  settings.erase("$id");
  return {{"Settings", std::move(settings)},
          {"Options", options()},
          {"Webhook", webhook()},
          {"WebhookTest", closed({{"id", {{"type", "string"}}},
                                  {"delivered", {{"type", "boolean"}}},
                                  {"status", nullable(integer())},
                                  {"error", nullable(text("why it was not delivered"))}})},
          {"JobRequest", job_request()},
          {"JobPatch", patch()},
          {"Progress", progress()},
          {"Problem", problem_schema()},
          {"Job", job()},
          {"JobList", closed({{"items", list_of(ref("Job"))},
                              {"next_cursor", nullable({{"type", "string"}})}})},
          {"Scene", scene()},
          {"Upload", upload()},
          {"Results",
           {{"type", "object"},
            {"description", "manifest.json, whose files have an href"},
            {"properties", {{"files", list_of(result_file())}}},
            {"required", {"files"}}}},
          {"Capabilities", capabilities()}};
}

}  // namespace kiln::api
