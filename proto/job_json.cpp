#include <array>
#include <nlohmann/json.hpp>
#include <utility>

#include "proto/json.h"
#include "proto/json_reader.h"
#include "proto/json_values.h"
#include "proto/problems.h"
#include "proto/sha256.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

constexpr std::array<std::pair<JobState, const char*>, 8> kStates{{
    {JobState::kQueued, "queued"},
    {JobState::kPreparing, "preparing"},
    {JobState::kRunning, "running"},
    {JobState::kFinalizing, "finalizing"},
    {JobState::kCanceling, "canceling"},
    {JobState::kSucceeded, "succeeded"},
    {JobState::kFailed, "failed"},
    {JobState::kCanceled, "canceled"},
}};

json text_or_null(const std::string& text) {
  return text.empty() ? json(nullptr) : json(text);
}

json links(const std::string& id) {
  const std::string self = "/v1/jobs/" + id;
  return {{"self", self},
          {"events", self + "/events"},
          {"results", self + "/results"},
          {"cancel", self + "/cancel"},
          {"retry", self + "/retry"},
          {"preview", self + "/preview"}};
}

void read_progress(JsonReader& in, JobProgress& out) {
  in.read("stage", out.stage);
  in.read("pass", out.pass);
  in.read("max_passes", out.max_passes);
  in.read("batches_done", out.batches_done);
  in.read("batches_total", out.batches_total);
  in.read("residual", out.residual);
  in.read("fraction", out.fraction);
  in.read("eta_seconds", out.eta_seconds);
}

void read_error(JsonReader& in, Error& out) {
  in.read("code", out.code);
  in.read("detail", out.message);
  in.read_list("errors", out.details, [](JsonReader& item, ErrorDetail& place) {
    item.read("source", place.source);
    item.read("pointer", place.pointer);
    item.read("detail", place.detail);
  });
}

void read_summary(JsonReader& in, JobSummary& out) {
  in.read("id", out.id);
  std::string state;
  in.read("state", state);
  if (auto known = job_state_from_string(state))
    out.state = *known;
  else
    in.wrong("state", "a job state", json(state));
  in.read("attempt", out.attempt);
  in.read("version", out.version);
  JsonReader scene = in.child("scene");
  scene.read("sha256", out.scene_sha256);
  scene.read("bytes", out.scene_bytes);
  in.read_or_null("created_at", out.created_at);
  in.read_or_null("started_at", out.started_at);
  in.read_or_null("finished_at", out.finished_at);
  JsonReader progress = in.child("progress");
  read_progress(progress, out.progress);
  const auto* error = in.find("error");
  if (error == nullptr || error->is_null()) return;
  JsonReader members = in.child("error");
  read_error(members, out.error.emplace());
}

}  // namespace

const char* to_string(JobState state) {
  for (const auto& [known, name] : kStates)
    if (known == state) return name;
  return "unknown";
}

Expected<JobState> job_state_from_string(std::string_view text) {
  std::string known;
  for (const auto& [state, name] : kStates) {
    if (text == name) return state;
    known += (known.empty() ? "" : ", ") + std::string(name);
  }
  return fail("bad_request", "unknown job state \"" + brief(text) + "\"; known: " + known);
}

json to_json(const JobProgress& p) {
  return {{"stage", p.stage},
          {"pass", p.pass},
          {"max_passes", p.max_passes},
          {"batches_done", p.batches_done},
          {"batches_total", p.batches_total},
          {"residual", p.residual},
          {"fraction", p.fraction},
          {"eta_seconds", or_null(p.eta_seconds)}};
}

json to_json(const Job& job) {
  return {{"id", job.id},
          {"state", to_string(job.state)},
          {"attempt", job.attempt},
          {"version", job.version},
          {"scene", {{"sha256", job.scene_sha256}, {"bytes", job.scene_bytes}}},
          {"settings", to_json(job.settings)},
          {"settings_hash", sha256_hex(to_text(to_json(job.settings)))},
          {"result_key", text_or_null(job.result_key)},
          {"queue_position", job.queue_position ? json(job.queue_position) : json(nullptr)},
          {"tenant", text_or_null(job.tenant)},
          {"priority", job.priority},
          {"labels", job.labels},
          {"webhook", job.webhook ? to_json(*job.webhook) : json(nullptr)},
          {"ttl_seconds", job.ttl_seconds},
          {"cached", job.cached},
          {"created_at", text_or_null(job.created_at)},
          {"started_at", text_or_null(job.started_at)},
          {"finished_at", text_or_null(job.finished_at)},
          {"expires_at", text_or_null(job.expires_at)},
          {"memory_estimate_bytes",
           job.memory_estimate_bytes ? json(job.memory_estimate_bytes) : json(nullptr)},
          {"progress", to_json(job.progress)},
          {"error", job.error ? to_json(*job.error) : json(nullptr)},
          {"links", links(job.id)}};
}

json to_json(const Error& error) {
  const ProblemKind& kind = problem_kind(error.code);
  json places = json::array();
  for (const auto& d : error.details)
    places.push_back({{"source", d.source}, {"pointer", d.pointer}, {"detail", d.detail}});
  return {{"type", "urn:lightkiln:problem:" + error.code},
          {"title", std::string(kind.title)},
          {"status", kind.status},
          {"detail", error.message},
          {"code", error.code},
          {"errors", std::move(places)}};
}

json problem_json(const Error& error, int http_status, std::string_view request_id,
                  std::string_view instance) {
  json doc = to_json(error);
  doc["status"] = http_status;
  doc["request_id"] = std::string(request_id);
  if (!instance.empty()) doc["instance"] = std::string(instance);
  return doc;
}

Expected<Error> error_from_json(const json& doc) {
  ProblemList problems("document");
  JsonReader in(doc, "", problems);
  Error out;
  read_error(in, out);
  if (!problems.empty()) return Unexpected(std::move(problems).error("bad_document"));
  return out;
}

Expected<JobProgress> progress_from_json(const json& doc) {
  ProblemList problems("document");
  JsonReader in(doc, "", problems);
  JobProgress out;
  read_progress(in, out);
  if (!problems.empty()) return Unexpected(std::move(problems).error("bad_document"));
  return out;
}

Expected<JobSummary> job_summary_from_json(const json& doc) {
  ProblemList problems("document");
  JsonReader in(doc, "", problems);
  JobSummary out;
  read_summary(in, out);
  if (!problems.empty()) return Unexpected(std::move(problems).error("bad_document"));
  return out;
}

Expected<std::vector<JobSummary>> job_list_from_json(const json& doc) {
  ProblemList problems("document");
  JsonReader in(doc, "", problems);
  std::vector<JobSummary> out;
  in.read_list("items", out, read_summary);
  if (!problems.empty()) return Unexpected(std::move(problems).error("bad_document"));
  return out;
}

}  // namespace kiln::proto
