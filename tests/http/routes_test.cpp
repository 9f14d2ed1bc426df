#include <gtest/gtest.h>

#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>
#include <stdexcept>

#include "baker/bake.h"
#include "proto/problems.h"
#include "proto/sha256.h"
#include "tests/http/live.h"

namespace kiln::test {
namespace {

TEST(Routes, AJobFromUploadToDownload) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const std::string path = "/v1/jobs/" + post_job(live.port());
  const Answer done = ask(live.port(), "GET", path + "?wait=20");
  EXPECT_EQ(member(done.body, "state"), "succeeded") << done.body;
  const std::string tag = "If-None-Match: " + done.headers.at("etag");
  EXPECT_EQ(ask(live.port(), "GET", path, {tag}).status, 304);
  const Answer list = ask(live.port(), "GET", path + "/results");
  EXPECT_NE(list.body.find(path + "/results/page_00.exr"), std::string::npos) << list.body;
  EXPECT_EQ(ask(live.port(), "GET", path + "/results/..%2fmanifest.json").status, 404);
  EXPECT_EQ(ask(live.port(), "GET", path + "/results/page_01.exr").status, 404);
  EXPECT_EQ(ask(live.port(), "DELETE", path).status, 204);
  EXPECT_EQ(ask(live.port(), "GET", path).status, 404);
}

TEST(Routes, ResultsHaveTagsAndRanges) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const std::string path = "/v1/jobs/" + post_job(live.port());
  ask(live.port(), "GET", path + "?wait=20");
  const auto get = [&](const std::vector<std::string>& headers, const char* method = "GET") {
    return ask(live.port(), method, path + "/results/page_00.exr", headers);
  };
  const Answer file = get({});
  EXPECT_EQ(file.status, 200);
  EXPECT_EQ(file.body, std::string(100'000, 'p'));
  EXPECT_EQ(file.headers.at("content-type"), "image/x-exr");
  const std::string etag = file.headers.at("etag");
  EXPECT_EQ(etag.size(), 66u) << "SHA-256 in quotes";
  const Answer part = get({"Range: bytes=99990-200000"});
  EXPECT_EQ(part.status, 206);
  EXPECT_EQ(part.body.size(), 10u);
  EXPECT_EQ(part.headers.at("content-range"), "bytes 99990-99999/100000");
  const Answer beyond = get({"Range: bytes=100000-"});
  EXPECT_EQ(beyond.status, 416);
  EXPECT_EQ(beyond.headers.at("content-range"), "bytes */100000");
  EXPECT_EQ(get({"Range: bytes=0-1,3-4"}).status, 416);
  EXPECT_EQ(get({"Range: bytes=0-1", "If-Range: " + etag}).status, 206);
  EXPECT_EQ(get({"Range: bytes=0-1", "If-Range: \"old\""}).body.size(), 100'000u);
  const Answer unchanged = get({"If-None-Match: " + etag});
  EXPECT_EQ(unchanged.status, 304);
  EXPECT_TRUE(unchanged.body.empty());
  const Answer head = get({}, "HEAD");
  EXPECT_EQ(head.headers.at("content-length"), "100000");
  EXPECT_TRUE(head.body.empty());
}

TEST(Routes, ScenesAreUploadedOnce) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const std::vector<std::string> type{"Content-Type: model/gltf-binary"};
  const Answer created = ask(live.port(), "POST", "/v1/scenes", type, "glTF1");
  EXPECT_EQ(created.status, 201) << created.body;
  EXPECT_EQ(ask(live.port(), "POST", "/v1/scenes", type, "glTF1").status, 200);
  EXPECT_EQ(ask(live.port(), "HEAD", created.headers.at("location")).status, 200);
  EXPECT_EQ(ask(live.port(), "HEAD", "/v1/scenes/sha256:" + std::string(64, '0')).status, 404);
  const Answer job =
      ask(live.port(), "POST", "/v1/jobs", {"Content-Type: application/json"},
          "{\"scene\":\"" + member(created.body, "id") + "\",\"settings\":{\"solver\":{}}}");
  EXPECT_EQ(job.status, 202) << job.body;
  const std::string id = member(job.body, "id");
  EXPECT_EQ(wait_for_state(live.port(), id, "succeeded"), "succeeded");
  const Answer list = ask(live.port(), "GET", "/v1/jobs?limit=1&state=succeeded");
  EXPECT_NE(list.body.find(id), std::string::npos);
}

TEST(Routes, WhatIsAnnouncedIsChecked) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const std::string key = proto::sha256_hex("glTF1"), path = "/v1/scenes/sha256:";
  const Answer put = ask(live.port(), "PUT", path + key, {}, "glTF1");
  EXPECT_EQ(put.status, 201) << put.body;
  EXPECT_EQ(member(put.body, "id"), "sha256:" + key);
  EXPECT_EQ(ask(live.port(), "PUT", path + key, {}, "glTF1").status, 200);
  const Answer other = ask(live.port(), "PUT", path + key, {}, "glTF2");
  EXPECT_EQ(other.status, 422);
  EXPECT_EQ(member(other.body, "code"), "digest_mismatch");
  EXPECT_EQ(ask(live.port(), "HEAD", path + proto::sha256_hex("glTF2")).status, 404);
  // printf abc | openssl dgst -sha256 -binary | base64
  const std::string digest = "ungWv48Bz+pBQUDeXa4iI7ADYaOWF3qctBD/YfIAFa0=";
  const auto post = [&](const std::string& header) {
    return ask(live.port(), "POST", "/v1/scenes", {"Content-Digest: " + header}, "abc").status;
  };
  EXPECT_EQ(post("sha-256=:" + digest + ":"), 201);
  EXPECT_EQ(post("md5=:AA==:, sha-256=:" + digest + ":"), 200);
  EXPECT_EQ(post("sha-256=:AAAA:"), 422);
  EXPECT_EQ(post("md5=:AA==:"), 200) << "an algorithm that is not known";
}

TEST(Routes, AllResultsComeAsOneArchive) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const std::string path = "/v1/jobs/" + post_job(live.port());
  ask(live.port(), "GET", path + "?wait=20");
  const Answer zip = ask(live.port(), "GET", path + "/results.zip");
  EXPECT_EQ(zip.status, 200);
  EXPECT_EQ(zip.headers.at("content-type"), "application/zip");
  EXPECT_TRUE(zip.body.starts_with("PK"));
  EXPECT_NE(zip.body.find(std::string(100'000, 'p')), std::string::npos);
  const Answer rest = ask(live.port(), "GET", path + "/results.zip",
                          {"Range: bytes=50000-", "If-Range: " + zip.headers.at("etag")});
  EXPECT_EQ(rest.status, 206);
  EXPECT_EQ(rest.body, zip.body.substr(50'000)) << "a download that was cut goes on";
  EXPECT_EQ(
      ask(live.port(), "GET", path + "/results.zip", {"If-None-Match: " + zip.headers.at("etag")})
          .status,
      304);
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs/job_x/results.zip").status, 404);
}

struct BadRequest {
  std::string method, target;
  std::vector<std::string> headers;
  std::string body;
  int status;
  std::string code, pointer;
};

void expect_problem(std::uint16_t port, const BadRequest& bad) {
  const Answer answer = ask(port, bad.method, bad.target, bad.headers, bad.body);
  const std::string what = bad.method + " " + bad.target + " " + bad.body.substr(0, 200);
  ASSERT_EQ(answer.status, bad.status) << what << "\n" << answer.body;
  EXPECT_EQ(answer.headers.at("content-type"), "application/problem+json") << what;
  EXPECT_EQ(member(answer.body, "code"), bad.code) << what;
  EXPECT_EQ(member(answer.body, "request_id"), answer.headers.at("x-request-id")) << what;
  if (bad.pointer.empty()) return;
  EXPECT_NE(answer.body.find("\"" + bad.pointer + "\""), std::string::npos) << answer.body;
}

TEST(Routes, EveryErrorIsAProblem) {
  jobs::FakeBake fake;
  base::ServerConfig config;
  config.max_upload_bytes = 1000;
  const Live live(fake.instant(), config);
  const std::vector<std::string> json{"Content-Type: application/json"};
  const std::pair<std::string, std::string> scene{"name=\"scene\"; filename=\"a.glb\"", "glTF"};
  const auto settings = [&](const char* text) {
    return form({scene, {"name=\"settings\"", text}});
  };
  const std::string none = "/v1/jobs/job_" + std::string(26, '0'), post = "POST", jobs = "/v1/jobs";
  for (const BadRequest& bad : std::vector<BadRequest>{
           {"GET", "/nothing", {}, "", 404, "not_found", ""},
           {post, "/v1/capabilities", {}, "", 405, "method_not_allowed", ""},
           {"PUT", jobs, {}, "", 405, "method_not_allowed", ""},
           {"GET", none, {}, "", 404, "not_found", ""},
           {"GET", none + "/events", {}, "", 404, "not_found", ""},
           {"GET", "/v1/jobs/..%2f..%2fetc", {}, "", 404, "not_found", ""},
           {"GET", none + "?wait=soon", {}, "", 400, "bad_request", "/query/wait"},
           {"GET", "/v1/jobs?state=odd", {}, "", 400, "bad_request", "/query/state"},
           {"GET", "/v1/jobs?limit=1000", {}, "", 400, "bad_request", "/query/limit"},
           {post, jobs, json, "{", 400, "invalid_json", ""},
           {post, jobs, json, "{\"scene\":\"x\"}", 422, "invalid_request", "/scene"},
           {post, jobs, json, "{\"sceen\":\"x\"}", 422, "invalid_request", "/sceen"},
           {post, jobs, {"Content-Type: text/plain"}, "x", 415, "unsupported_media_type", ""},
           {post, jobs, {kForm, "Content-Encoding: gzip"}, "x", 415, "unsupported_media_type", ""},
           {post, jobs, {kForm}, "garbage", 400, "bad_request", ""},
           {post,
            jobs,
            {kForm},
            form({{"name=\"settings\"", "{}"}}),
            422,
            "invalid_request",
            "/scene"},
           {post,
            jobs,
            {kForm},
            form({scene, {"name=\"odd\"", "x"}}),
            422,
            "invalid_request",
            "/odd"},
           {post, jobs, {kForm}, form({scene, scene}), 422, "invalid_request", "/scene"},
           {post,
            jobs,
            {kForm},
            settings("{\"solver\":{\"samples\":\"many\"}}"),
            422,
            "invalid_settings",
            "/solver/samples"},
           {post,
            jobs,
            {kForm},
            settings("{\"solver\":{\"sampels\":1}}"),
            422,
            "invalid_settings",
            "/solver/sampels"},
           {post, jobs, {kForm}, std::string(2000, 'x'), 413, "payload_too_large", ""},
       })
    expect_problem(live.port(), bad);
  const Answer wrong = ask(live.port(), "POST", "/v1/capabilities");
  EXPECT_EQ(wrong.headers.at("allow"), "GET, HEAD, OPTIONS");
  EXPECT_EQ(ask(live.service->admin_port(), "GET", "/readyz").status, 200);
  EXPECT_EQ(ask(live.service->admin_port(), "GET", "/healthz").status, 200);
  const Answer can = ask(live.port(), "GET", "/v1/capabilities");
  EXPECT_EQ(can.status, 200);
  EXPECT_EQ(member(can.body, "instruction_set"), baker::instruction_set());
  EXPECT_EQ(nlohmann::json::parse(can.body)["presets"]["production"]["target_error"].dump(),
            "0.018");
}

TEST(Routes, SideFilesReachTheCheckAndAnErrorNamesItsPlace) {
  jobs::FakeBake fake;
  std::vector<std::string> names;
  const Live live(
      fake.instant(), {}, {}, [&](const files::SceneFiles& files, const proto::BakeSettings&) {
        for (const auto& [name, path] : files.side) names.push_back(name);
        return proto::Expected<void>(proto::fail("invalid_scene", "Odd.", "scene", "/nodes/3"));
      });
  const Answer answer = ask(live.port(), "POST", "/v1/jobs", {kForm},
                            form({{"name=\"f\"; filename=\"b.bin\"", "1"},
                                  {"name=\"scene\"; filename=\"a.gltf\"", "{}"},
                                  {"name=\"file\"; filename=\"dir/t.png\"", "2"}}));
  EXPECT_EQ(answer.status, 422);
  EXPECT_EQ(member(answer.body, "code"), "invalid_scene");
  EXPECT_NE(answer.body.find("/nodes/3"), std::string::npos);
  EXPECT_EQ(names, (std::vector<std::string>{"b.bin", "dir/t.png"}));
  EXPECT_TRUE(std::filesystem::is_empty(live.folder.path() / "data" / "tmp"));
  EXPECT_TRUE(std::filesystem::is_empty(live.folder.path() / "data" / "scenes"));
}

TEST(Routes, AnExceptionIsAProblemWithoutItsText) {
  jobs::FakeBake fake;
  const Live live(
      fake.instant(), {}, {},
      [](const files::SceneFiles&, const proto::BakeSettings&) -> proto::Expected<void> {
        throw std::runtime_error("secret");
      });
  const Answer answer = ask(live.port(), "POST", "/v1/scenes", {}, "glTF");
  EXPECT_EQ(answer.status, 500);
  EXPECT_EQ(member(answer.body, "code"), "internal");
  EXPECT_EQ(answer.body.find("secret"), std::string::npos);
}

TEST(Routes, CancelAndNotReady) {
  jobs::FakeBake fake;
  const Live live(fake.holding());
  const std::string id = post_job(live.port()), path = "/v1/jobs/" + id;
  EXPECT_EQ(wait_for_state(live.port(), id, "running"), "running");
  for (const char* what : {"/results", "/results/page_00.exr", "/preview", "/view"}) {
    const Answer early = ask(live.port(), "GET", path + what);
    EXPECT_EQ(early.status, 425) << what;
    EXPECT_TRUE(early.headers.contains("retry-after"));
  }
  EXPECT_EQ(ask(live.port(), "DELETE", path).status, 409);
  EXPECT_EQ(ask(live.port(), "POST", path + "/cancel").status, 202);
  EXPECT_EQ(member(ask(live.port(), "GET", path + "?wait=10").body, "state"), "canceled");
  EXPECT_EQ(ask(live.port(), "POST", path + "/cancel").status, 200);
  EXPECT_EQ(ask(live.port(), "GET", path + "/results").status, 404);
}

Answer post_options(std::uint16_t port, const std::string& options, const std::string& key = "",
                    const std::string& scene = "glTF") {
  std::vector<std::string> headers{kForm};
  if (!key.empty()) headers.push_back("Idempotency-Key: " + key);
  return ask(port, "POST", "/v1/jobs", headers,
             form({{"name=\"scene\"; filename=\"a.glb\"", scene}, {"name=\"options\"", options}}));
}

TEST(Routes, ARequestThatIsSentAgainMakesNoSecondJob) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  const Answer first = post_options(live.port(), "{}", "abc");
  EXPECT_EQ(first.status, 202) << first.body;
  EXPECT_FALSE(first.headers.contains("idempotent-replayed"));
  const std::string path = first.headers.at("location");
  ask(live.port(), "GET", path + "?wait=20");
  const Answer again = post_options(live.port(), "{}", "abc");
  EXPECT_EQ(again.status, 200) << "over by now";
  EXPECT_EQ(again.headers.at("idempotent-replayed"), "true");
  EXPECT_EQ(again.headers.at("location"), path);
  const Answer other = post_options(live.port(), R"({"priority":1})", "abc");
  EXPECT_EQ(other.status, 422);
  EXPECT_EQ(member(other.body, "code"), "idempotency_mismatch");
  EXPECT_EQ(post_options(live.port(), "{}", "no blanks").status, 400);
  const Answer twin = post_options(live.port(), "{}");
  EXPECT_EQ(twin.status, 200);
  EXPECT_EQ(member(twin.body, "cached"), "true");
  EXPECT_EQ(ask(live.port(), "GET", twin.headers.at("location") + "/results/page_00.exr").body,
            std::string(100'000, 'p'));
  EXPECT_EQ(ask(live.port(), "GET", twin.headers.at("location") + "/events").status, 200);
  EXPECT_EQ(fake.started, 1);
  EXPECT_EQ(post_options(live.port(), R"({"dedupe":false})").status, 202);
}

TEST(Routes, OptionsAreKeptListedAndChanged) {
  jobs::FakeBake fake;
  const Live live(fake.holding());
  const Answer made = post_options(
      live.port(), R"({"priority":3,"labels":{"team":"a b&c","n":"1"},"ttl_seconds":60})");
  ASSERT_EQ(made.status, 202) << made.body;
  post_options(live.port(), R"({"labels":{"team":"a b&c"}})");
  const std::string path = made.headers.at("location"), id = member(made.body, "id");
  EXPECT_EQ(member(made.body, "priority"), "3");
  EXPECT_EQ(member(made.body, "ttl_seconds"), "60");
  const Answer page = ask(live.port(), "GET", "/v1/jobs?label=team:a%20b%26c&limit=1");
  ASSERT_TRUE(page.headers.contains("link")) << page.body;
  const std::string link = page.headers.at("link");
  const Answer rest = ask(live.port(), "GET", link.substr(1, link.find('>') - 1));
  EXPECT_NE(rest.body.find(id), std::string::npos) << "the label is part of the next page's link";
  EXPECT_EQ(member(ask(live.port(), "GET", "/v1/jobs?label=n:2").body, "items"), "[]");
  EXPECT_EQ(ask(live.port(), "GET", "/v1/jobs?label=team").status, 400);

  EXPECT_EQ(wait_for_state(live.port(), id, "running"), "running");
  const Answer patched =
      ask(live.port(), "PATCH", path, {}, R"({"labels":{"n":null,"x":"y"},"ttl_seconds":0})");
  EXPECT_EQ(patched.status, 200) << patched.body;
  EXPECT_EQ(member(patched.body, "labels"), R"({"team":"a b&c","x":"y"})");
  EXPECT_EQ(ask(live.port(), "PATCH", path, {"If-Match: \"1\""}, "{}").status, 412);
  EXPECT_EQ(ask(live.port(), "PATCH", path, {"If-Match: *"}, "{}").status, 200);
  EXPECT_EQ(ask(live.port(), "POST", path + "/retry").status, 409);
  EXPECT_EQ(ask(live.port(), "POST", path + "/cancel", {}, R"({"mode":"later"})").status, 422);
  EXPECT_EQ(ask(live.port(), "POST", path + "/cancel", {}, R"({"mode":"drain"})").status, 202);
  EXPECT_EQ(wait_for_state(live.port(), id, "canceled"), "canceled");
  EXPECT_EQ(ask(live.port(), "GET", path + "/results/page_00.exr").status, 200) << "what was done";
  const Answer again = ask(live.port(), "POST", path + "/retry", {}, R"({"from":"start"})");
  EXPECT_EQ(again.status, 202);
  EXPECT_EQ(member(again.body, "attempt"), "2");
  fake.go = true;
  EXPECT_EQ(wait_for_state(live.port(), id, "succeeded"), "succeeded");
  const Answer over = ask(live.port(), "GET", path);
  EXPECT_EQ(ask(live.port(), "PATCH", path, {"If-Match: " + over.headers.at("etag")},
                R"({"ttl_seconds":9})")
                .status,
            200);
  EXPECT_NE(member(ask(live.port(), "GET", path).body, "expires_at"), "null");
}

TEST(Routes, WrongOptionsAreNamed) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  for (const auto& [options, pointer] :
       std::vector<std::pair<std::string, std::string>>{{R"({"priority":101})", "/priority"},
                                                        {R"({"priority":1.5})", "/priority"},
                                                        {R"({"prio":1})", "/prio"},
                                                        {R"({"ttl_seconds":-1})", "/ttl_seconds"},
                                                        {R"({"dedupe":"no"})", "/dedupe"},
                                                        {R"({"labels":[]})", "/labels"},
                                                        {R"({"labels":{"a b":"c"}})", "/labels"},
                                                        {R"({"labels":{"a":1}})", "/labels/a"},
                                                        {R"({"labels":{"a":null}})", "/labels/a"},
                                                        {"[]", ""}}) {
    const Answer answer = post_options(live.port(), options);
    EXPECT_EQ(answer.status, 422) << options;
    EXPECT_EQ(member(answer.body, "code"), "invalid_request");
    EXPECT_NE(answer.body.find("\"pointer\": \"" + pointer + "\""), std::string::npos)
        << answer.body;
  }
}

TEST(Routes, EveryErrorCodeIsInTheDocumentation) {
  std::ifstream in(LIGHTKILN_SOURCE_DIR "/docs/http-api.md");
  const std::string text(std::istreambuf_iterator<char>(in), {});
  for (const auto& kind : proto::problem_kinds()) {
    const std::string row =
        "| `" + std::string(kind.code) + "` | " + std::to_string(kind.status) + " |";
    EXPECT_NE(text.find(row), std::string::npos) << row;
  }
}

}  // namespace
}  // namespace kiln::test
