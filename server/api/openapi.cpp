#include "server/api/openapi.h"

#include <initializer_list>
#include <nlohmann/json.hpp>
#include <string>

namespace kiln::api {
namespace {

using nlohmann::json;

json schema_ref(const char* name) {
  return {{"$ref", std::string("#/components/schemas/") + name}};
}

json content(const char* media_type, json schema) {
  return {{media_type, {{"schema", std::move(schema)}}}};
}

json answer(const char* description) {
  return {{"description", description}};
}

json answer(const char* description, const char* schema) {
  return {{"description", description},
          {"content", content("application/json", schema_ref(schema))}};
}

json file_answer(const char* description, const char* media_type) {
  return {{"description", description}, {"content", {{media_type, json::object()}}}};
}

json query(const char* name, json schema, const char* description) {
  return {
      {"name", name}, {"in", "query"}, {"schema", std::move(schema)}, {"description", description}};
}

json header(const char* name, const char* description) {
  return {{"name", name},
          {"in", "header"},
          {"schema", {{"type", "string"}}},
          {"description", description}};
}

json required(json parameter) {
  parameter["required"] = true;
  return parameter;
}

json path_parameter(const char* name, const char* pattern) {
  return {{"name", name},
          {"in", "path"},
          {"required", true},
          {"schema", {{"type", "string"}, {"pattern", pattern}}}};
}

const json kText = {{"type", "string"}};
const json kNumber = {{"type", "integer"}, {"minimum", 0}};

/// Makes one operation. Everything that goes wrong is a Problem.
json operation(const char* id, const char* summary, json responses, json parameters = json::array(),
               json body = nullptr) {
  for (const char* failures : {"4XX", "5XX"})
    responses[failures] = {{"description", "A problem"},
                           {"content", content("application/problem+json", schema_ref("Problem"))}};
  json out{{"operationId", id}, {"summary", summary}, {"responses", std::move(responses)}};
  if (!parameters.empty()) out["parameters"] = std::move(parameters);
  if (!body.is_null()) out["requestBody"] = std::move(body);
  return out;
}

/// Makes an operation that needs no token.
json open_to_all(json operation) {
  operation["security"] = json::array();
  return operation;
}

json json_body(json schema, bool required) {
  return {{"required", required}, {"content", content("application/json", std::move(schema))}};
}

json choice_body(const char* member, const json& words) {
  return json_body({{"type", "object"},
                    {"properties", {{member, {{"type", "string"}, {"enum", words}}}}},
                    {"additionalProperties", false}},
                   false);
}

/// Describes a scene as the body: the bare file, or a form with side files.
json scene_body(json form_members) {
  form_members["scene"] = {{"type", "string"}, {"contentMediaType", "application/octet-stream"}};
  json types = content(
      "multipart/form-data",
      {{"type", "object"}, {"properties", std::move(form_members)}, {"required", {"scene"}}});
  for (const char* type : {"model/gltf-binary", "model/gltf+json", "application/octet-stream"})
    types[type] = json::object();
  return {{"required", true}, {"content", std::move(types)}};
}

json job_body() {
  json body =
      scene_body({{"settings", schema_ref("Settings")}, {"options", schema_ref("Options")}});
  body["content"].update(content("application/json", schema_ref("JobRequest")));
  return body;
}

json range_parameters() {
  return {header("Range", "one range"), header("If-Range", "an ETag"),
          header("If-None-Match", "ETags")};
}

json file_answers(const char* media_type) {
  return {{"200", file_answer("The file", media_type)},
          {"206", file_answer("The range", media_type)},
          {"304", answer("It is the one that the client has")}};
}

json job_paths() {
  json jobs{
      {"post", operation("postJob", "Bake a scene",
                         {{"202", answer("Queued", "Job")},
                          {"200", answer("There already: cached or replayed", "Job")}},
                         {header("Idempotency-Key", "names this request"),
                          header("Prefer", "wait=30: answer at its end, or after 30 s; at most 60"),
                          header("Content-Digest", "sha-256, checked")},
                         job_body())},
      {"get", operation("listJobs", "Jobs, newest first", {{"200", answer("A page", "JobList")}},
                        {query("state", kText, "only those in this state"),
                         query("label", kText, "name:value; several have to hold together"),
                         query("limit", kNumber, "at most 200"),
                         query("cursor", kText, "next_cursor of the page before")})}};
  json one{
      {"parameters", {path_parameter("id", "^job_[0-9a-z]{26}$")}},
      {"get", operation("getJob", "One job",
                        {{"200", answer("The job", "Job")}, {"304", answer("It has not changed")}},
                        {query("wait", kNumber, "seconds to wait until it is over, at most 60"),
                         query("since", kNumber, "wait for another version than this one only"),
                         header("If-None-Match", "ETags")})},
      {"patch", operation("patchJob", "Change its options", {{"200", answer("The job", "Job")}},
                          {header("If-Match", "ETags")}, json_body(schema_ref("JobPatch"), true))},
      {"delete", operation("deleteJob", "Delete it with its files", {{"204", answer("Gone")}},
                           {query("force", {{"type", "boolean"}}, "cancel it first")})}};
  return {{"/v1/jobs", std::move(jobs)}, {"/v1/jobs/{id}", std::move(one)}};
}

json view_operation() {
  return operation(
      "getView", "The baked scene with a layer as its color",
      {{"200", file_answer("A picture", "image/png")}, {"304", answer("The client has it")}},
      {query("layer", kText, "of the pages; irradiance by default"),
       query("camera", kText,
             "fit, the name of a camera of the scene, or x,y,z:tx,ty,tz[:degrees]"),
       query("size", {{"type", "string"}, {"pattern", "^[0-9]+x[0-9]+$"}},
             "WIDTHxHEIGHT, each at most 4096; 1024x768 by default"),
       query("exposure", {{"type", "number"}}, "factor on light before the tone curve"),
       query("ortho", {{"type", "boolean"}}, "no perspective"),
       query("filter", {{"enum", {"bilinear", "nearest"}}}, "between texels"),
       query("shaded", {{"type", "boolean"}},
             "the light that leaves the surface, where the layer is irradiance"),
       header("If-None-Match", "ETags")});
}

json job_action_paths() {
  const json id{path_parameter("id", "^job_[0-9a-z]{26}$")};
  const auto path = [&](const char* method, json what) {
    return json{{"parameters", id}, {method, std::move(what)}};
  };
  return {
      {"/v1/jobs/{id}/cancel",
       path("post", operation("cancelJob", "Stop it",
                              {{"202", answer("Canceling", "Job")}, {"200", answer("Over", "Job")}},
                              json::array(), choice_body("mode", {"now", "drain"})))},
      {"/v1/jobs/{id}/retry",
       path("post", operation("retryJob", "Run it again", {{"202", answer("Queued", "Job")}},
                              json::array(), choice_body("from", {"checkpoint", "start"})))},
      {"/v1/jobs/{id}/events",
       path("get", operation("getEvents", "Its events as they come",
                             {{"200", file_answer("A stream", "text/event-stream")},
                              {"204", answer("It is over, and nothing is missing")}},
                             {query("after", kNumber, "id of the last event seen"),
                              header("Last-Event-ID", "the same")}))},
      {"/v1/events",
       {{"get", operation("getAllEvents", "The events of all jobs as they come",
                          {{"200", file_answer("A stream", "text/event-stream")}},
                          {query("after", kNumber, "id of the last event seen; without: from now"),
                           header("Last-Event-ID", "the same")})}}},
      {"/v1/webhooks/test",
       {{"post", operation("testWebhook", "Send a message, to try it",
                           {{"202", answer("What came of it", "WebhookTest")}}, json::array(),
                           json_body(schema_ref("Webhook"), true))}}},
      {"/v1/jobs/{id}/preview",
       path("get", operation("getPreview", "A page after its latest pass",
                             {{"200", file_answer("A picture", "image/png")},
                              {"304", answer("The client has it")}},
                             {query("page", kNumber, "from 0"),
                              query("pass", {{"const", "latest"}}, "only `latest`"),
                              query("exposure", {{"type", "number"}}, "scale of the values"),
                              header("If-None-Match", "ETags")}))},
      {"/v1/jobs/{id}/view", path("get", view_operation())}};
}

json result_paths() {
  const json id = path_parameter("id", "^job_[0-9a-z]{26}$");
  return {{"/v1/jobs/{id}/results",
           {{"parameters", {id}},
            {"get", operation("getResults", "The manifest",
                              {{"200", answer("The manifest", "Results")},
                               {"304", answer("The client has it")}},
                              {header("If-None-Match", "ETags")})}}},
          {"/v1/jobs/{id}/results.zip",
           {{"parameters", {id}},
            {"get", operation("getResultsZip", "All files", file_answers("application/zip"),
                              range_parameters())}}},
          {"/v1/jobs/{id}/results/{name}",
           {{"parameters", {id, path_parameter("name", "^[^/]+$")}},
            {"get", operation("getResult", "One file", file_answers("application/octet-stream"),
                              range_parameters())}}}};
}

json scene_paths() {
  const json body = scene_body(json::object());
  const json digest{header("Content-Digest", "sha-256, checked")};
  return {
      {"/v1/scenes",
       {{"post", operation("postScene", "Upload a scene",
                           {{"201", answer("Stored", "Scene")}, {"200", answer("Known", "Scene")}},
                           digest, body)}}},
      {"/v1/scenes/sha256:{digest}",
       {{"parameters", {path_parameter("digest", "^[0-9a-f]{64}$")}},
        {"get", operation("getScene", "Whether it is there", {{"200", answer("It is", "Scene")}})},
        {"put", operation("putScene", "Upload this scene",
                          {{"201", answer("Stored", "Scene")}, {"200", answer("Known", "Scene")}},
                          digest, body)}}}};
}

json with_headers(json answer, std::initializer_list<const char*> names) {
  for (const char* name : names) answer["headers"][name] = {{"schema", kText}};
  return answer;
}

json visibility_paths() {
  json post =
      operation("postVisibility", "Which pairs of points of a scene see each other",
                {{"200", with_headers(file_answer("A bit per pair", "application/octet-stream"),
                                      {"Lightkiln-Pairs", "Lightkiln-Visible", "Server-Timing"})}},
                {required(query("scene", {{"type", "string"}, {"pattern", "^sha256:[0-9a-f]{64}$"}},
                                "id of a stored scene")),
                 header("Content-Digest", "sha-256, checked")});
  post["requestBody"] = {
      {"required", true},
      {"description",
       "six little-endian 32-bit floats a pair: x, y, z of the one point, then of the other"},
      {"content", {{"application/octet-stream", json::object()}}}};
  return {{"/v1/visibility", {{"post", std::move(post)}}}};
}

json upload_paths() {
  const json id = path_parameter("id", "^upl_[0-9a-z]{26}$");
  const auto state = [](json answer) {
    return with_headers(std::move(answer), {"Upload-Offset", "Upload-Length", "Upload-Complete"});
  };
  json post = operation("postUpload", "Begin an upload that can be resumed",
                        {{"201", state(answer("Begun", "Upload"))},
                         {"200", state(answer("The one that this key names", "Upload"))}},
                        {required(header("Upload-Length", "bytes of the whole")),
                         header("Idempotency-Key", "names this upload"),
                         header("Repr-Digest", "sha-256 of the whole, checked at its end")});
  json body = scene_body(json::object());
  body["required"] = false;
  body["description"] = "the first bytes of the whole, whose media type it tells";
  post["requestBody"] = std::move(body);
  json patch = operation("patchUpload", "Go on with it",
                         {{"204", state({{"description", "Taken; there is more to come"}})},
                          {"201", state(answer("It is whole: a new scene", "Scene"))},
                          {"200", state(answer("It is whole: a scene that was known", "Scene"))},
                          {"409", state(answer("It goes on at Upload-Offset"))}},
                         {required(header("Upload-Offset", "bytes before this part"))});
  patch["responses"]["409"]["content"] = content("application/problem+json", schema_ref("Problem"));
  patch["requestBody"] = {{"required", true},
                          {"content", {{"application/partial-upload", json::object()}}}};
  return {{"/v1/uploads", {{"post", std::move(post)}}},
          {"/v1/uploads/{id}",
           {{"parameters", {id}},
            {"get", operation("getUpload", "How far it is; HEAD tells it by headers",
                              {{"200", state(answer("The upload", "Upload"))}})},
            {"patch", std::move(patch)},
            {"delete", operation("deleteUpload", "Forget it", {{"204", answer("Gone")}})}}}};
}

json service_paths() {
  return {
      {"/",
       {{"get", open_to_all(operation("getRoot", "A hint",
                                      {{"200", file_answer("A text", "text/plain")}}))}}},
      {"/openapi.json",
       {{"get", open_to_all(operation("getOpenapi", "This document",
                                      {{"200", file_answer("OpenAPI", "application/json")}}))}}},
      {"/v1/capabilities",
       {{"get", operation("getCapabilities", "Version, settings, limits",
                          {{"200", answer("What it can do", "Capabilities")}})}}}};
}

}  // namespace

json openapi_document() {
  json paths = service_paths();
  for (const json& more : {upload_paths(), scene_paths(), visibility_paths(), job_paths(),
                           job_action_paths(), result_paths()})
    paths.update(more);
  json document{
      {"openapi", "3.1.0"},
      {"info",
       {{"title", "Lightkiln"},
        {"version", LIGHTKILN_VERSION},
        {"description", "Lightmaps for glTF scenes. docs/http-api.md explains it in words."},
        {"license", {{"name", "Apache-2.0"}, {"identifier", "Apache-2.0"}}}}},
      {"servers", {{{"url", "/"}}}},
      {"security", {{{"token", json::array()}}, json::object()}},
      {"paths", std::move(paths)},
      {"components",
       {{"schemas", openapi_schemas()},
        {"securitySchemes", {{"token", {{"type", "http"}, {"scheme", "bearer"}}}}}}}};
  add_openapi_examples(document);
  return document;
}

}  // namespace kiln::api
