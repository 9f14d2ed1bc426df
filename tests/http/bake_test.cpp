#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "baker/image/image.h"
#include "clients/client.h"
#include "proto/bake_settings.h"
#include "tests/http/event_stream.h"
#include "tests/http/program.h"

/// Real bakes by the built program, through curl and through our client.
namespace kiln::test {
namespace {

class Bakes : public testing::Test {
 protected:
  TempFolder folder;
  Program program{folder.path() / "data"};

  std::string job_url(const std::string& id, const std::string& rest = "") const {
    return program.url("/v1/jobs/" + id + rest);
  }
};

TEST_F(Bakes, ASceneWithoutSettingsBecomesVerifiedFiles) {
  const std::string id = post_job(program, write_small_scene(folder.path()));
  const Answer done = curl("'" + job_url(id, "?wait=60") + "'");
  ASSERT_EQ(member(done.body, "state"), "succeeded") << done.body;
  const Answer list = curl(job_url(id, "/results"));
  ASSERT_EQ(list.status, 200);
  const auto manifest = nlohmann::json::parse(list.body);
  std::set<std::string> names;
  for (const auto& file : manifest["files"]) {
    const std::string name = file["name"];
    names.insert(name);
    const Answer got = curl(program.url(file["href"]));
    EXPECT_EQ(got.status, 200) << name;
    EXPECT_EQ(got.headers.at("content-type"), file["media_type"]) << name;
    EXPECT_EQ(got.body.size(), file["bytes"].get<std::size_t>()) << name;
    const std::string digest = proto::sha256_hex(got.body);
    EXPECT_EQ(file["sha256"], digest) << name;
    EXPECT_EQ(got.headers.at("etag"), "\"" + digest + "\"") << name;
  }
  EXPECT_EQ(names, (std::set<std::string>{"lit.glb", "log.txt", "manifest.json", "page_00.exr",
                                          "page_00.png"}));
  EXPECT_EQ(curl("-X DELETE " + job_url(id)).status, 204);
  EXPECT_EQ(curl(job_url(id, "/results")).status, 404);
}

TEST_F(Bakes, EveryMethodOfTheSettings) {
  const auto scene = write_small_scene(folder.path());
  for (const proto::Word& method : proto::kMethodNames) {
    const nlohmann::json settings{{"atlas", {{"page_size", 256}}},
                                  {"solver", {{"method", method.name}, {"samples", 16}}}};
    const std::string id = post_job(program, scene, settings.dump());
    const Answer done = curl("'" + job_url(id, "?wait=60") + "'");
    ASSERT_EQ(member(done.body, "state"), "succeeded") << done.body;
    const auto manifest = nlohmann::json::parse(curl(job_url(id, "/results/manifest.json")).body);
    EXPECT_EQ(manifest["settings"]["solver"]["method"], method.name);
    EXPECT_GT(manifest["statistics"]["passes"].size(), 0u);
  }
}

TEST_F(Bakes, ARadiosityMapTellsWhatItsSeriesLacks) {
  const std::string id =
      post_job(program, write_small_scene(folder.path()),
               R"({"atlas":{"page_size":128},"solver":{"method":"radiosity_map","samples":100,
          "direct_samples":40,"initial_samples":8,"light_sampling":"stratified",
          "same_directions":true,"ambient_term":true}})");
  const Answer done = curl("'" + job_url(id, "?wait=60") + "'");
  ASSERT_EQ(member(done.body, "state"), "succeeded") << done.body;
  const auto manifest = nlohmann::json::parse(curl(job_url(id, "/results/manifest.json")).body);
  const auto& passes = manifest["statistics"]["passes"];
  EXPECT_EQ(passes.front()["name"], "direct");
  EXPECT_EQ(passes[1]["name"], "trace");
  EXPECT_EQ(passes.back()["name"], "iterations");
  EXPECT_TRUE(passes.back().contains("standard_error"));
  const bool told = std::ranges::any_of(manifest["warnings"], [](const auto& warning) {
    return warning["code"] == "series_short_of_light";
  });
  EXPECT_TRUE(told) << manifest["warnings"];
}

TEST_F(Bakes, AMethodThatCantFinishFailsAndSaysWhatItWouldTake) {
  const std::string id = post_job(program, write_scene(folder.path(), "cornell"),
                                  R"({"solver":{"method":"pairwise"}})");
  const Answer done = curl("'" + job_url(id, "?wait=60") + "'");
  ASSERT_EQ(member(done.body, "state"), "failed") << done.body;
  EXPECT_NE(done.body.find("too_expensive"), std::string::npos) << done.body;
  EXPECT_NE(done.body.find("/solver/method"), std::string::npos) << done.body;
}

TEST_F(Bakes, DirectionsOfAHemicube) {
  const std::string id = post_job(program, write_small_scene(folder.path()), R"({
    "atlas": {"page_size": 256},
    "solver": {"method": "directional", "samples": 64, "direction_set": "hemicube"},
    "output": {"layers": ["irradiance", "indirect", "samples"]}})");
  const Answer done = curl("'" + job_url(id, "?wait=60") + "'");
  ASSERT_EQ(member(done.body, "state"), "succeeded") << done.body;
  const auto manifest = nlohmann::json::parse(curl(job_url(id, "/results/manifest.json")).body);
  EXPECT_EQ(manifest["settings"]["solver"]["direction_set"], "hemicube");
  const auto& passes = manifest["statistics"]["passes"];
  EXPECT_EQ(passes[0]["name"], "direct");
  EXPECT_EQ(passes[1]["name"], "bounce");
  EXPECT_EQ(passes[1]["rays"].get<std::uint64_t>() % 48, 0u) << "cells of a hemicube of 4 x 4";
}

TEST_F(Bakes, ADownloadIsResumedByRange) {
  const std::string id = post_job(program, write_small_scene(folder.path()));
  ASSERT_EQ(member(curl("'" + job_url(id, "?wait=60") + "'").body, "state"), "succeeded");
  const std::string url = job_url(id, "/results/lit.glb");
  const Answer whole = curl(url);
  ASSERT_GT(whole.body.size(), 1000u);
  const std::string size = std::to_string(whole.body.size());
  const std::string etag = whole.headers.at("etag");
  const Answer rest = curl("-r 500- -H 'If-Range: " + etag + "' " + url);
  EXPECT_EQ(rest.status, 206);
  EXPECT_EQ(rest.body, whole.body.substr(500));
  EXPECT_EQ(rest.headers.at("content-range"),
            "bytes 500-" + std::to_string(whole.body.size() - 1) + "/" + size);
  EXPECT_EQ(curl("-r -10 " + url).body, whole.body.substr(whole.body.size() - 10));
  EXPECT_EQ(curl("-r 500- -H 'If-Range: \"other\"' " + url).body, whole.body);
  EXPECT_EQ(curl("-H 'If-None-Match: " + etag + "' " + url).status, 304);
  const Answer beyond = curl("-r " + size + "- " + url);
  EXPECT_EQ(beyond.status, 416);
  EXPECT_EQ(beyond.headers.at("content-range"), "bytes */" + size);
  // curl's own way to go on with a file that was cut.
  const std::string part = (folder.path() / "part").string();
  std::ofstream(part, std::ios::binary) << whole.body.substr(0, 700);
  EXPECT_EQ(std::system(("curl -s -C - -o " + part + " " + url).c_str()), 0);
  EXPECT_EQ(proto::digest_file(part)->sha256, whole.headers.at("etag").substr(1, 64));
}

TEST_F(Bakes, OurClientSubmitsFollowsAndFetches) {
  clients::Client client(clients::parse_server_url(program.url()).value());
  const auto scene = write_small_scene(folder.path());
  const auto job = client.submit({scene, {}, R"({"solver":{"samples":16}})", {}});
  ASSERT_TRUE(job) << job.error().message;
  std::vector<std::string> types;
  std::uint64_t last = 0;
  const auto followed = client.follow(job->id, 0, [&](const proto::Event& event) {
    EXPECT_EQ(event.id, ++last);
    types.push_back(event.type);
    return true;
  });
  ASSERT_TRUE(followed) << followed.error().message;
  EXPECT_EQ(types.back(), "job.end");
  for (const char* type : {"job.state", "job.progress", "pass.completed", "result.ready"})
    EXPECT_NE(std::find(types.begin(), types.end(), type), types.end()) << type;
  const auto files = client.results(job->id);
  ASSERT_TRUE(files);
  for (const auto& file : *files)
    EXPECT_TRUE(client.download(job->id, file, folder.path())) << file.name;
  EXPECT_EQ(proto::digest_file(folder.path() / "lit.glb")->sha256,
            std::find_if(files->begin(), files->end(), [](const auto& f) {
              return f.name == "lit.glb";
            })->sha256);
}

TEST_F(Bakes, APreviewWhileItRunsAndAfterwards) {
  const std::string settings = R"({"atlas":{"page_size":128},"solver":{"samples":64}})";
  const std::string id = post_job(program, write_scene(folder.path(), "cornell"), settings);
  EventStream stream(program.port(), id);
  ASSERT_TRUE(stream.wait_for("pass.completed"));
  // The snapshot follows its event; the job goes on for longer than one request takes.
  Answer early;
  do {
    early = ask(program.port(), "GET", "/v1/jobs/" + id + "/preview?page=0&pass=latest");
  } while (early.status == 425 && stream.count("job.end") == 0);
  EXPECT_EQ(early.status, 200) << early.body;
  EXPECT_EQ(early.headers.at("content-type"), "image/png");
  EXPECT_TRUE(early.body.starts_with("\x89PNG\r\n"));
  ASSERT_TRUE(stream.wait_for("job.end"));
  ASSERT_EQ(member(curl("'" + job_url(id, "?wait=10") + "'").body, "state"), "succeeded");
  const Answer late = curl(job_url(id, "/preview"));
  EXPECT_EQ(late.status, 200);
  EXPECT_TRUE(late.body.starts_with("\x89PNG\r\n"));
  EXPECT_NE(late.headers.at("etag"), early.headers.at("etag"));
  const std::string tag = "-H 'If-None-Match: " + late.headers.at("etag") + "' ";
  EXPECT_EQ(curl(tag + job_url(id, "/preview")).status, 304);
  const Answer dark = curl("'" + job_url(id, "/preview?exposure=1e-9") + "'");
  EXPECT_EQ(dark.status, 200);
  EXPECT_NE(dark.body, late.body);
  EXPECT_EQ(curl("'" + job_url(id, "/preview?page=7") + "'").status, 404);
  for (const char* query : {"?exposure=0", "?exposure=nan", "?page=x", "?pass=first"})
    EXPECT_EQ(curl("'" + job_url(id, std::string("/preview") + query) + "'").status, 400) << query;
}

/// Returns the bytes of the colors of a PNG.
std::vector<std::uint8_t> pixels(const std::string& png) {
  const auto header = image::read_header(png);
  if (!header) return {};
  std::vector<std::array<std::uint8_t, 4>> texels(std::size_t(header->size.width) *
                                                  header->size.height);
  if (!image::decode_rgba8(*header, texels, {})) return {};
  std::vector<std::uint8_t> rgb;
  for (const auto& texel : texels) rgb.insert(rgb.end(), texel.begin(), texel.begin() + 3);
  return rgb;
}

TEST_F(Bakes, PreviewsHaveTheToneCurveOfTheSettings) {
  const std::string id =
      post_job(program, write_scene(folder.path(), "cornell"),
               R"({"atlas":{"page_size":64},"solver":{"samples":8},"output":{"tone_curve":0.05}})");
  ASSERT_EQ(member(curl("'" + job_url(id, "?wait=30") + "'").body, "state"), "succeeded");
  const auto brightest = [&](const std::string& rest) {
    const auto rgb = pixels(curl("'" + job_url(id, rest) + "'").body);
    return rgb.empty() ? 0 : int(*std::ranges::max_element(rgb));
  };
  for (const char* picture : {"/preview", "/results/page_00.png"})
    EXPECT_EQ(brightest(picture), 243) << picture << ": 255 / 1.05, not scaled to white";
  EXPECT_EQ(brightest("/view?size=64x64"), 243);
  EXPECT_EQ(brightest("/preview?exposure=1000"), 255) << "the usual curve";
}

TEST_F(Bakes, PreviewsOfARunningBakeFade) {
  // Pictures after some passes; the jobs would go on for long.
  const auto picture = [&](const char* fade) {
    const std::string settings =
        R"({"atlas":{"page_size":128},"solver":{"method":"radiosity_map","samples":65536},
            "output":{"preview_fade":)" +
        std::string(fade) + "}}";
    const std::string id = post_job(program, write_scene(folder.path(), "cornell"), settings);
    Answer seen;
    // The ETag is "attempt-pass".
    const auto pass = [&] {
      return seen.status == 200 ? std::atoi(seen.headers.at("etag").c_str() + 3) : 0;
    };
    do {
      seen = ask(program.port(), "GET", "/v1/jobs/" + id + "/preview?exposure=1e-3");
    } while (seen.status == 425 || (seen.status == 200 && pass() < 8));
    EXPECT_EQ(seen.status, 200) << seen.body;
    EXPECT_LT(pass(), 30);
    const Answer state = ask(program.port(), "GET", "/v1/jobs/" + id);
    EXPECT_EQ(member(state.body, "state"), "running");
    ask(program.port(), "POST", "/v1/jobs/" + id + "/cancel");
    return pixels(seen.body);
  };
  const auto faded = picture("0.01"), plain = picture("1");
  ASSERT_EQ(faded.size(), plain.size());
  double sums[2] = {};
  for (std::size_t i = 0; i < plain.size(); ++i)
    sums[0] += double(faded[i]), sums[1] += double(plain[i]);
  EXPECT_GT(sums[0], 0.1 * sums[1]) << "it begins with the direct light";
  EXPECT_LT(sums[0], 0.9 * sums[1]) << "it has little of the bounces yet";
}

TEST_F(Bakes, LayersThatNeedTheSolverOnThePageAndOnTheModel) {
  const std::string id = post_job(program, write_scene(folder.path(), "cornell"), R"({
    "atlas": {"page_size": 64},
    "solver": {"method": "pairwise", "direct_samples": 16, "bounces": 1,
               "undersampling": "monte_carlo", "window": 4, "voxel_march": "fixed_steps"},
    "output": {"layers": ["irradiance", "mip", "tree", "senders", "voxels", "error"]},
    "report": {"against": "path", "samples": 16}})");
  ASSERT_EQ(member(curl("'" + job_url(id, "?wait=60") + "'").body, "state"), "succeeded");
  std::set<std::string> pictures;
  for (const char* layer : {"irradiance", "mip", "tree", "senders", "voxels", "error"}) {
    const Answer view =
        curl("'" + job_url(id, "/view?size=80x60&layer=" + std::string(layer)) + "'");
    EXPECT_EQ(view.status, 200) << layer << view.body;
    pictures.insert(view.body);
    if (layer == std::string("irradiance")) continue;
    const Answer page = curl(job_url(id, "/results/page_00." + std::string(layer) + ".png"));
    EXPECT_EQ(page.status, 200) << layer << page.body;
    EXPECT_TRUE(page.body.starts_with("\x89PNG")) << layer;
  }
  EXPECT_EQ(pictures.size(), 6u) << "each shows something else";
}

TEST_F(Bakes, AViewOfTheFinishedJob) {
  const std::string settings =
      R"({"atlas":{"page_size":64},"solver":{"samples":8},"output":{"layers":["irradiance","normal"]}})";
  const std::string id = post_job(program, write_scene(folder.path(), "cornell"), settings);
  ASSERT_EQ(member(curl("'" + job_url(id, "?wait=30") + "'").body, "state"), "succeeded");
  const Answer light = curl("'" + job_url(id, "/view?size=80x60") + "'");
  EXPECT_EQ(light.status, 200) << light.body;
  EXPECT_EQ(light.headers.at("content-type"), "image/png");
  EXPECT_TRUE(light.body.starts_with("\x89PNG\r\n"));
  const Answer again = curl("'" + job_url(id, "/view?size=80x60") + "'");
  EXPECT_EQ(again.body, light.body) << "the same request, the same picture";
  const Answer normal = curl("'" + job_url(id, "/view?size=80x60&layer=normal") + "'");
  EXPECT_EQ(normal.status, 200) << normal.body;
  EXPECT_NE(normal.body, light.body);
  const Answer none = curl("'" + job_url(id, "/view?layer=albedo") + "'");
  EXPECT_EQ(none.status, 404);
  EXPECT_NE(none.body.find("/query/layer"), std::string::npos) << none.body;
  EXPECT_EQ(curl("'" + job_url(id, "/view?camera=door") + "'").status, 404);
}

TEST_F(Bakes, ACancelTakesLessThanASecond) {
  const std::string id = post_job(program, write_scene(folder.path(), "cornell"), kLongBake);
  EventStream stream(program.port(), id);
  while (stream.events().empty() ||
         stream.events().back().data.find("\"solve\"") == std::string::npos)
    ASSERT_TRUE(stream.wait_next());
  const auto began = std::chrono::steady_clock::now();
  EXPECT_EQ(ask(program.port(), "POST", "/v1/jobs/" + id + "/cancel").status, 202);
  ASSERT_TRUE(stream.wait_for("job.end"));
  EXPECT_LT(std::chrono::steady_clock::now() - began, std::chrono::seconds(1) * kSlowdown);
  EXPECT_NE(stream.events().back().data.find("\"canceled\""), std::string::npos);
  EXPECT_EQ(curl("-X POST " + job_url(id, "/cancel")).status, 200);
}

TEST_F(Bakes, WhatIsWrongWithTheInputIsNamedBeforeAJobExists) {
  const auto scene = write_small_scene(folder.path());
  const auto expect = [&](const std::string& arguments, int status, const std::string& code,
                          const std::string& source, const std::string& pointer) {
    const Answer answer = curl(arguments + program.url("/v1/jobs"));
    ASSERT_EQ(answer.status, status) << arguments << answer.body;
    EXPECT_EQ(answer.headers.at("content-type"), "application/problem+json");
    const auto problem = nlohmann::json::parse(answer.body);
    EXPECT_EQ(problem["code"], code) << answer.body;
    EXPECT_EQ(problem["status"], status);
    EXPECT_EQ(problem["request_id"], answer.headers.at("x-request-id"));
    if (source.empty()) return;
    ASSERT_FALSE(problem["errors"].empty()) << answer.body;
    EXPECT_EQ(problem["errors"][0]["source"], source) << answer.body;
    EXPECT_EQ(problem["errors"][0]["pointer"], pointer) << answer.body;
  };
  const auto text = [&](const char* name, const std::string& content) {
    std::ofstream(folder.path() / name, std::ios::binary) << content;
    return "-F scene=@" + (folder.path() / name).string() + " ";
  };
  const auto settings = [&](const char* json) { return job_form(scene, json); };
  const std::string glb = [&] {
    std::ifstream in(scene, std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(in), {});
  }();
  expect(settings(R"({"solver":{"samples":"many"}})"), 422, "invalid_settings", "settings",
         "/solver/samples");
  expect(settings(R"({"atlas":{"gutter":-1}})"), 422, "invalid_settings", "settings",
         "/atlas/gutter");
  expect(settings(R"({"output":{"layers":["error"]}})"), 422, "invalid_settings", "settings",
         "/output/layers");
  expect(settings(R"({"output":{"tone_curve":0.1,"exposure":2}})"), 422, "invalid_settings",
         "settings", "/output/tone_curve");
  expect(settings(R"({"a/b":1})"), 422, "invalid_settings", "settings", "/a~1b");
  expect(settings("{"), 400, "invalid_json", "", "");
  expect(text("no.glb", "PNG is no scene"), 422, "invalid_scene", "scene", "");
  expect(text("cut.glb", glb.substr(0, glb.size() - 100)), 422, "invalid_scene", "scene", "");
  expect(
      text("uri.gltf", R"({"asset":{"version":"2.0"},"buffers":[{"uri":"../x","byteLength":4}]})"),
      422, "invalid_scene", "scene", "/buffers/0/uri");
  expect(text("loop.gltf", R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],
         "nodes":[{"children":[1]},{"children":[0]}]})"),
         422, "invalid_scene", "scene", "/nodes/0/children");
  expect(text("new.gltf", R"({"asset":{"version":"2.0"},"extensionsUsed":["EXT_new"],
         "extensionsRequired":["EXT_new"]})"),
         422, "unsupported_extension", "scene", "/extensionsRequired/0");
  const auto dark = write_scene(folder.path(), "tilted_plane");
  expect(job_form(dark), 422, "no_light", "", "");
  EXPECT_EQ(nlohmann::json::parse(curl(program.url("/v1/jobs")).body)["items"].size(), 0u);
  EXPECT_EQ(ask(program.admin_port(), "GET", "/readyz").status, 200);
}

}  // namespace
}  // namespace kiln::test
