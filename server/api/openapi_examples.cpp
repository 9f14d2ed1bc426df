#include <map>
#include <nlohmann/json.hpp>
#include <string>

#include "proto/json.h"
#include "server/api/openapi.h"

/// Examples of requests and answers. Every request is sent to a live service by a test, and every
/// answer checked against its schema.
namespace kiln::api {
namespace {

using nlohmann::json;

constexpr const char* kExampleJob = "job_01m8147r8t52az2yn2xbswzh16";
constexpr const char* kExampleUpload = "upl_01m8147r8t52az2yn2xbswzh16";
const std::string kExampleDigest =
    "0142cc6f1b1d8a1c9a6c6f1d5f6f3a2b7e8d9c0b1a2f3e4d5c6b7a8990817263";

struct Examples {
  json parameters = json::object();  ///< by name
  json bodies = json::object();      ///< by media type
  json answers = json::object();     ///< by status; JSON only
};

json example_webhook() {
  proto::Webhook hook;
  hook.url = "https://ci.example.com/baked";
  hook.secret_ref = "ci";
  return proto::to_json(hook);
}

json example_job(proto::JobState state) {
  proto::Job job;
  job.id = kExampleJob;
  job.state = state;
  job.version = 7;
  job.scene_sha256 = kExampleDigest;
  job.scene_bytes = 2'524;
  job.result_key = "9f86d081884c7d659a2feaa0c55ad015a3bf4f1b2b0b822cd15d6c15b0f00a08";
  if (state == proto::JobState::kQueued) job.queue_position = 1;
  job.priority = 10;
  job.labels = {{"level", "yard"}};
  job.created_at = "2026-11-22T10:30:00.000Z";
  if (state == proto::JobState::kSucceeded) {
    job.started_at = "2026-11-22T10:30:00.012Z";
    job.finished_at = "2026-11-22T10:30:09.500Z";
    job.progress = {"output", 5, 16, 12, 12, 0.0004, 1};
  }
  return proto::to_json(job);
}

json example_scene() {
  const std::string id = "sha256:" + kExampleDigest;
  return {{"id", id},
          {"sha256", kExampleDigest},
          {"bytes", 2'524},
          {"side_files", 0},
          {"links", {{"self", "/v1/scenes/" + id}}}};
}

json example_upload(bool complete) {
  return {{"id", kExampleUpload},
          {"offset", complete ? 2'524 : 0},
          {"length", 2'524},
          {"complete", complete},
          {"expires_at", "2026-11-23T10:30:00.000Z"},
          {"scene", complete ? json("sha256:" + kExampleDigest) : json(nullptr)},
          {"links", {{"self", std::string("/v1/uploads/") + kExampleUpload}}}};
}

json example_results() {
  const json file{{"name", "page_00.exr"},
                  {"media_type", "image/x-exr"},
                  {"bytes", 524'288},
                  {"sha256", kExampleDigest},
                  {"href", std::string("/v1/jobs/") + kExampleJob + "/results/page_00.exr"}};
  return {{"files", json::array({file})}};
}

json example_options() {
  return {{"priority", 10}, {"labels", {{"level", "yard"}}}, {"ttl_seconds", 86'400}};
}

std::map<std::string, Examples> job_examples() {
  const json done = example_job(proto::JobState::kSucceeded);
  const json queued = example_job(proto::JobState::kQueued);
  json request = example_options();
  request["scene"] = "sha256:" + kExampleDigest;
  request["settings"] = {{"quality", {{"preset", "preview"}}}, {"solver", {{"seed", 2}}}};
  request["webhook"] = example_webhook();
  const json form{{"scene", "the bytes of yard.glb"},
                  {"settings", {{"quality", {{"target_error", 0.05}}}}},
                  {"options", example_options()}};
  return {
      {"postJob",
       {{{"Idempotency-Key", "yard-1"}, {"Prefer", "wait=1"}},
        {{"application/json", request}, {"multipart/form-data", form}},
        {{"200", done}, {"202", queued}}}},
      {"listJobs",
       {{{"state", "succeeded"}, {"label", "level:yard"}, {"limit", 10}, {"cursor", "1000"}},
        json::object(),
        {{"200", {{"items", json::array({done})}, {"next_cursor", nullptr}}}}}},
      {"getJob",
       {{{"wait", 1}, {"since", 1}, {"If-None-Match", "\"1\""}}, json::object(), {{"200", done}}}},
      {"patchJob",
       {{{"If-Match", "*"}},
        {{"application/json", {{"priority", 20}, {"labels", {{"level", nullptr}}}}}},
        {{"200", done}}}},
      {"deleteJob", {{{"force", true}}, json::object(), json::object()}},
      {"cancelJob", {json::object(), {{"application/json", {{"mode", "drain"}}}}, {{"200", done}}}},
      {"retryJob",
       {json::object(), {{"application/json", {{"from", "start"}}}}, {{"202", queued}}}},
      {"getEvents", {{{"after", 0}, {"Last-Event-ID", "1"}}, json::object(), json::object()}},
      {"getAllEvents", {{{"after", 0}, {"Last-Event-ID", "1"}}, json::object(), json::object()}},
      {"getPreview",
       {{{"page", 0}, {"pass", "latest"}, {"exposure", 0.01}, {"If-None-Match", "\"1-2\""}},
        json::object(),
        json::object()}},
      {"getView",
       {{{"layer", "irradiance"},
         {"camera", "fit"},
         {"size", "64x48"},
         {"exposure", 0.01},
         {"ortho", false},
         {"filter", "nearest"},
         {"shaded", true},
         {"If-None-Match", "\"odd\""}},
        json::object(),
        json::object()}},
      {"getResults",
       {{{"If-None-Match", "\"odd\""}}, json::object(), {{"200", example_results()}}}},
      {"getResult", {{{"Range", "bytes=0-9"}}, json::object(), json::object()}},
      {"getResultsZip", {{{"Range", "bytes=-10"}}, json::object(), json::object()}},
  };
}

std::map<std::string, Examples> other_examples() {
  return {
      {"getRoot", {}},
      {"getOpenapi", {}},
      {"getCapabilities", {}},
      {"postScene", {json::object(), json::object(), {{"200", example_scene()}}}},
      {"putScene", {json::object(), json::object(), {{"200", example_scene()}}}},
      {"getScene", {json::object(), json::object(), {{"200", example_scene()}}}},
      {"postUpload",
       {{{"Upload-Length", "2524"}, {"Idempotency-Key", "yard-1"}},
        json::object(),
        {{"200", example_upload(true)}, {"201", example_upload(false)}}}},
      {"getUpload", {json::object(), json::object(), {{"200", example_upload(false)}}}},
      {"patchUpload", {{{"Upload-Offset", "0"}}, json::object(), {{"201", example_scene()}}}},
      {"deleteUpload", {}},
      {"postVisibility", {{{"scene", "sha256:" + kExampleDigest}}, json::object(), json::object()}},
      {"testWebhook",
       {json::object(),
        {{"application/json", example_webhook()}},
        {{"202",
          {{"id", "msg_01m8147r8t52az2yn2xbswzh16"},
           {"delivered", true},
           {"status", 204},
           {"error", nullptr}}}}}},
  };
}

void add_to_parameters(json& parameters, const json& values) {
  for (auto& parameter : parameters) {
    const auto name = parameter.at("name").get<std::string>();
    if (values.contains(name)) parameter["example"] = values[name];
  }
}

void add_to_operation(json& operation, const Examples& examples) {
  if (operation.contains("parameters"))
    add_to_parameters(operation["parameters"], examples.parameters);
  for (const auto& [type, body] : examples.bodies.items())
    operation["requestBody"]["content"].at(type)["example"] = body;
  for (const auto& [status, answer] : examples.answers.items())
    operation["responses"].at(status)["content"].at("application/json")["example"] = answer;
}

}  // namespace

void add_openapi_examples(json& document) {
  auto examples = job_examples();
  examples.merge(other_examples());
  for (auto& [path, item] : document["paths"].items()) {
    if (item.contains("parameters"))
      for (auto& parameter : item["parameters"]) {
        const auto pattern = parameter["schema"]["pattern"].get<std::string>();
        if (pattern.starts_with("^job_")) parameter["example"] = kExampleJob;
        if (pattern.starts_with("^upl_")) parameter["example"] = kExampleUpload;
        if (parameter["name"] == "digest") parameter["example"] = kExampleDigest;
        if (parameter["name"] == "name") parameter["example"] = "page_00.exr";
      }
    for (auto& [method, operation] : item.items())
      if (operation.is_object() && operation.contains("operationId"))
        add_to_operation(operation, examples.at(operation["operationId"].get<std::string>()));
  }
}

}  // namespace kiln::api
