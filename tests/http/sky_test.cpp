#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/http/program.h"
#include "tests/support/sky_files.h"

/// Jobs whose sky is a file of the upload.
namespace kiln::test {
namespace {

using nlohmann::json;

class Skies : public testing::Test {
 protected:
  TempFolder folder;
  Program program{folder.path() / "data"};
  const std::string scene = write_small_scene(folder.path()).string();
  const std::string sky =
      folder
          .write("noon.exr",
                 exr_file(
                     {32,
                      [](math::Vec3 d) -> math::Rgb {
                        return d.y > 0.9f ? math::Rgb{500, 500, 400} : math::Rgb{0.2f, 0.3f, 0.5f};
                      }}))
          .string();

  /// A form for curl: the scene, a sky map named noon.exr unless its path is empty, settings.
  std::string form(const std::string& map, const json& settings) const {
    return "-F scene=@" + scene + (map.empty() ? "" : " -F 'sky=@" + map + ";filename=noon.exr'") +
           " -F 'settings=" + settings.dump() + "' ";
  }
  static json settings(double rotation = 0) {
    return {{"sky", {{"map", "noon.exr"}, {"scale", 100}, {"rotation", rotation}}},
            {"atlas", {{"page_size", 64}}},
            {"solver", {{"samples", 16}}}};
  }
  Answer job_end(const std::string& arguments) const {
    const Answer posted = curl(arguments + program.url("/v1/jobs"));
    EXPECT_EQ(posted.status, 202) << posted.body;
    return curl("'" + program.url("/v1/jobs/" + member(posted.body, "id") + "?wait=60") + "'");
  }
  /// Digest of the page of a job that has to succeed.
  std::string page_of(const std::string& arguments) const {
    const Answer end = job_end(arguments);
    EXPECT_EQ(member(end.body, "state"), "succeeded") << end.body;
    const Answer page =
        curl(program.url("/v1/jobs/" + member(end.body, "id") + "/results/page_00.exr"));
    EXPECT_EQ(page.status, 200);
    return page.headers.at("etag");
  }
  /// A refusal for reasons of the map.
  static void expect_refused(const Answer& answer, const std::string& code) {
    EXPECT_EQ(answer.status, 422);
    const json problem = json::parse(answer.body);
    EXPECT_EQ(problem["code"], code) << answer.body;
    EXPECT_EQ(problem["errors"][0]["source"], "settings");
    EXPECT_EQ(problem["errors"][0]["pointer"], "/sky/map");
  }
};

TEST_F(Skies, AreASideFileThatTheSettingsName) {
  const std::string with = page_of(form(sky, settings())),
                    turned = page_of(form(sky, settings(90)));
  json without = settings();
  without["sky"].erase("map");
  EXPECT_NE(page_of(form(sky, without)), with);
  EXPECT_NE(turned, with);

  // The same by the scene's digest, once uploaded.
  const Answer put =
      curl("-F scene=@" + scene + " -F noon.exr=@" + sky + " " + program.url("/v1/scenes"));
  EXPECT_EQ(put.status, 200) << "it is known: " << put.body;
  const json job{{"scene", member(put.body, "id")}, {"settings", settings()}, {"dedupe", false}};
  EXPECT_EQ(page_of("-H 'Content-Type: application/json' -d '" + job.dump() + "' "), with);
}

TEST_F(Skies, AreCheckedBeforeTheAnswer) {
  const std::string jobs = program.url("/v1/jobs");
  expect_refused(curl(form("", settings()) + jobs), "missing_file");
  expect_refused(curl(form(scene, settings()) + jobs), "invalid_image");
  std::ifstream in(sky, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(in), {}};
  const std::string head = folder.write("head.exr", bytes.substr(0, 300)).string();
  expect_refused(curl(form(head, settings()) + jobs), "invalid_image");
  // What only decoding can tell fails the job.
  const std::string cut = folder.write("cut.exr", bytes.substr(0, bytes.size() - 50)).string();
  const Answer end = job_end(form(cut, settings()));
  EXPECT_EQ(member(end.body, "state"), "failed");
  const json error = json::parse(end.body)["error"];
  EXPECT_EQ(error["code"], "invalid_image");
  EXPECT_EQ(error["errors"][0]["pointer"], "/sky/map");
}

TEST_F(Skies, TheCommandsSendThem) {
  const auto run = [&](const std::string& arguments) {
    return std::system((std::string(LIGHTKILN_BINARY) + " " + arguments +
                        " --set sky.scale=100 --set atlas.page_size=64 --set solver.samples=16 "
                        ">/dev/null 2>&1 </dev/null")
                           .c_str());
  };
  const auto page = [&](const char* out) {
    return proto::digest_file(folder.path() / out / "page_00.exr").value().sha256;
  };
  const std::string a = (folder.path() / "a").string(), b = (folder.path() / "b").string(),
                    c = (folder.path() / "c").string();
  ASSERT_EQ(
      run("submit " + scene + " --sky " + sky + " --wait -o " + a + " --server " + program.url()),
      0);
  ASSERT_EQ(run("bake " + scene + " --sky " + sky + " -o " + b), 0);
  ASSERT_EQ(run("bake " + scene + " --set sky.map=noon.exr -o " + c), 0) << "it lies beside";
  EXPECT_EQ(page("a"), page("b"));
  EXPECT_EQ(page("a"), page("c"));
  EXPECT_NE(run("bake " + scene + " --sky " + sky + "x -o " + b), 0);
}

}  // namespace
}  // namespace kiln::test
