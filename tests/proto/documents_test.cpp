#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>

#include "proto/json.h"
#include "proto/nearest_name.h"
#include "proto/problems.h"

namespace kiln::proto {
namespace {

using nlohmann::json;

Job some_job() {
  Job job;
  job.id = "job_0123456789abcdefghijklmnop";
  job.state = JobState::kFailed;
  job.attempt = 2;
  job.version = 17;
  job.scene_sha256 = std::string(64, 'a');
  job.scene_bytes = 1ull << 40;
  job.created_at = "2030-01-02T03:04:05Z";
  job.progress = {"solve", 3, 17, 5, 9, 0.25, 0.5, 12.5};
  job.error = Error{"no_light", "no light", {{"scene", "/nodes/3", "nothing shines"}}};
  return job;
}

TEST(JobJson, Shape) {
  const json doc = to_json(some_job());
  const std::string self = "/v1/jobs/job_0123456789abcdefghijklmnop";
  EXPECT_EQ(doc["state"], "failed");
  EXPECT_EQ(doc["scene"], json({{"sha256", std::string(64, 'a')}, {"bytes", 1ull << 40}}));
  EXPECT_EQ(doc["started_at"], nullptr);
  EXPECT_EQ(doc["settings"], to_json(BakeSettings{}));
  EXPECT_EQ(doc["links"]["self"], self);
  for (const char* name : {"events", "results", "cancel", "preview"})
    EXPECT_EQ(doc["links"][name], self + "/" + name);
  EXPECT_EQ(doc["error"]["status"], 422);
  EXPECT_EQ(doc["error"]["title"], "The scene has no light");
  Job fine = some_job();
  fine.error.reset();
  EXPECT_EQ(to_json(fine)["error"], nullptr);
}

TEST(JobJson, TheSummaryReadsWhatTheJobWrote) {
  const Job job = some_job();
  const auto read = job_summary_from_json(to_json(job));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->id, job.id);
  EXPECT_EQ(read->state, job.state);
  EXPECT_EQ(read->attempt, 2u);
  EXPECT_EQ(read->version, 17u);
  EXPECT_EQ(read->scene_bytes, 1ull << 40);
  EXPECT_EQ(read->started_at, "");
  EXPECT_EQ(read->created_at, job.created_at);
  EXPECT_EQ(to_json(read->progress), to_json(job.progress));
  ASSERT_TRUE(read->error);
  EXPECT_EQ(to_json(*read->error), to_json(*job.error));
}

TEST(JobJson, TheSummaryNamesWhatIsMissing) {
  json doc = to_json(some_job());
  doc.erase("attempt");
  doc["state"] = "asleep";
  doc["progress"]["pass"] = -1;
  doc["settings"] = {{"of", "a newer version"}};  // Not read.
  const auto read = job_summary_from_json(doc);
  ASSERT_FALSE(read);
  EXPECT_EQ(read.error().code, "bad_document");
  std::set<std::string> pointers;
  for (const auto& d : read.error().details) pointers.insert(d.pointer);
  EXPECT_EQ(pointers, (std::set<std::string>{"/attempt", "/state", "/progress/pass"}));
  for (const auto& hostile : {json(nullptr), json(3), json::array(), json::object()})
    EXPECT_FALSE(job_summary_from_json(hostile));
}

TEST(JobState, EveryStateHasAName) {
  std::set<std::string> names;
  for (int i = 0; i <= static_cast<int>(JobState::kCanceled); ++i) {
    const auto state = static_cast<JobState>(i);
    names.insert(to_string(state));
    EXPECT_EQ(*job_state_from_string(to_string(state)), state);
  }
  EXPECT_EQ(names.size(), 8u);
  EXPECT_TRUE(names.count("canceled"));
  EXPECT_FALSE(job_state_from_string("Queued"));
  EXPECT_FALSE(job_state_from_string(""));
}

TEST(Problem, Shape) {
  const Error error{
      "invalid_settings", "two things", {{"settings", "/a", "x"}, {"scene", "", "y"}}};
  const json doc = problem_json(error, 422, "req_1", "/v1/jobs");
  EXPECT_EQ(doc, json({{"type", "urn:lightkiln:problem:invalid_settings"},
                       {"title", "The settings are not valid"},
                       {"status", 422},
                       {"detail", "two things"},
                       {"instance", "/v1/jobs"},
                       {"code", "invalid_settings"},
                       {"request_id", "req_1"},
                       {"errors",
                        {{{"source", "settings"}, {"pointer", "/a"}, {"detail", "x"}},
                         {{"source", "scene"}, {"pointer", ""}, {"detail", "y"}}}}}));
  EXPECT_FALSE(problem_json(error, 422, "r").contains("instance"));
  const auto read = error_from_json(doc);
  ASSERT_TRUE(read);
  EXPECT_EQ(to_json(*read), to_json(error));
  EXPECT_FALSE(error_from_json(json::array()));
  EXPECT_FALSE(error_from_json({{"code", 3}, {"detail", "x"}, {"errors", json::array()}}));
}

TEST(Problem, TheTableIsSortedAndComplete) {
  const auto& kinds = problem_kinds();
  for (std::size_t i = 1; i < kinds.size(); ++i) EXPECT_LT(kinds[i - 1].code, kinds[i].code);
  for (const auto& kind : kinds) {
    EXPECT_GE(kind.status, 400);
    EXPECT_LT(kind.status, 600);
    EXPECT_FALSE(kind.title.empty());
  }
  EXPECT_EQ(problem_kind("queue_full").status, 503);
  EXPECT_EQ(problem_kind("result_not_ready").status, 425);
  EXPECT_EQ(problem_kind("never heard of").status, 500);
  EXPECT_EQ(problem_kind("never heard of").code, "internal");
}

Manifest some_manifest() {
  Manifest m;
  m.version = "1.2.3";
  m.scene_sha256 = std::string(64, 'b');
  m.instruction_set = "avx2";
  m.settings.solver.samples = 7;
  m.settings.lights.emplace_back().type = LightType::kRect;
  m.settings.lights.back().width = 0.1f;
  m.pages.push_back({512, 256, 1000, "page_00.exr", "page_00.png", 0.1f, 1234.5f, 99.5f, 7, 4});
  m.nodes.push_back({3, 2, "wall \"a\"", 0, {0.5f, 0.25f}, {0.1f, 0}, "unwrapped", "overlap"});
  m.files.push_back({"page_00.exr", "image/x-exr", 1ull << 33, std::string(64, 'c')});
  m.statistics.triangles = 12;
  m.statistics.rays = 1ull << 60;
  m.statistics.tail_scale = 1.5;
  m.statistics.stages.push_back({"import", 0.25});
  m.statistics.passes.push_back({"bounce", 1, 0.5, 3.25, 1.5, 99, std::nullopt});
  m.statistics.passes.push_back({"round", 2, 0.5, 3.25, 1.5, 99, 0.25});
  m.statistics.standard_error = 0.25;
  m.statistics.ray_pattern = "tile";
  m.statistics.memory_estimate_bytes = 1u << 30;
  m.warnings.push_back({"alpha_ignored", "/materials/0", "opaque now"});
  return m;
}

TEST(ManifestJson, RoundTrip) {
  const json doc = to_json(some_manifest());
  EXPECT_EQ(doc["pages"][0]["preview_exposure"].dump(), "0.1");
  EXPECT_EQ(doc["units"]["texel"], "lx");
  EXPECT_EQ(doc["pages"][0]["glb_clipped"], 7);
  const auto read = manifest_from_json(json::parse(doc.dump()));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(to_json(*read), doc);
  json before = doc;  // of a version without pages' own scales in lit.glb
  for (const char* later : {"glb_scale", "glb_clipped", "glb_clipped_lamps"})
    before["pages"][0].erase(later);
  const auto old = manifest_from_json(before);
  ASSERT_TRUE(old) << old.error().message;
  EXPECT_EQ(old->pages[0].glb_scale, 0);
  EXPECT_EQ(old->pages[0].max_lx, 1234.5f);
  EXPECT_EQ(read->statistics.rays, 1ull << 60);
  EXPECT_EQ(read->nodes[0].scale, (std::array<float, 2>{0.5f, 0.25f}));
}

// Each member, taken away or turned into something else, is missed under its own pointer.
TEST(ManifestJson, EveryMemberIsChecked) {
  const json doc = to_json(some_manifest());
  std::size_t tried = 0;
  const json flat = doc.flatten();
  for (const auto& [pointer, value] : flat.items()) {
    if (pointer.rfind("/settings", 0) == 0 || pointer.rfind("/units", 0) == 0) continue;
    json broken = doc;
    broken[json::json_pointer(pointer)] = json::object();
    const auto read = manifest_from_json(broken);
    ASSERT_FALSE(read) << pointer;
    EXPECT_EQ(pointer.rfind(read.error().details[0].pointer, 0), 0u) << pointer;
    ++tried;
  }
  EXPECT_GT(tried, 40u);
  json broken = doc;
  broken["settings"]["solver"]["samples"] = 0;
  EXPECT_EQ(manifest_from_json(broken).error().details[0].pointer, "/settings/solver/samples");
  broken = doc;
  broken["manifest_version"] = 2;
  EXPECT_FALSE(manifest_from_json(broken));
}

TEST(PassReportJson, RoundTrip) {
  const PassReport pass{"direct", 0, 1, 12.5, 0.125, 1ull << 50, 0.02};
  EXPECT_EQ(to_json(*pass_report_from_json(to_json(pass))), to_json(pass));
  EXPECT_FALSE(pass_report_from_json(json::object()));
}

TEST(NearestName, FindsMisspellings) {
  const std::vector<std::string_view> known{"bounces", "samples", "direct_samples", "seed"};
  EXPECT_EQ(nearest_name("bonuces", known), "bounces");  // A swap is one edit.
  EXPECT_EQ(nearest_name("sample", known), "samples");
  EXPECT_EQ(nearest_name("directSamples", known), "direct_samples");
  EXPECT_EQ(nearest_name("sede", known), "seed");
  EXPECT_EQ(nearest_name("radiance", known), "");
  EXPECT_EQ(nearest_name("", known), "");
  EXPECT_EQ(nearest_name(std::string(1'000'000, 's'), known), "");
  EXPECT_EQ(name_hint("zzz", {"a", "b"}), "; known: \"a\", \"b\"");
}

}  // namespace
}  // namespace kiln::proto
