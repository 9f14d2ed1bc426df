#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>

#include "proto/json.h"
#include "tests/http/live.h"
#include "tests/proto/schema_check.h"

/// /openapi.json says what the code does: same routes, same documents.
namespace kiln::test {
namespace {

using nlohmann::json;

json resolved(const json& node, const json& document) {
  if (node.is_object() && node.contains("$ref")) {
    const auto name = node["$ref"].get<std::string>();
    return resolved(document.at(json::json_pointer(name.substr(1))), document);
  }
  if (!node.is_structured()) return node;
  json out = node;
  for (auto& child : out) child = resolved(child, document);
  return out;
}

class Openapi : public testing::Test {
 protected:
  jobs::FakeBake fake_;
  const Live live_{fake_.instant()};
  const json document_ = json::parse(ask(live_.port(), "GET", "/openapi.json").body);

  json get(const std::string& target) { return json::parse(ask(live_.port(), "GET", target).body); }
  void expect_fits(const std::string& schema, const json& value) {
    const json rule = resolved(document_.at("components").at("schemas").at(schema), document_);
    EXPECT_TRUE(proto::accepts(rule, value)) << schema << "\n" << value.dump(2);
  }
};

TEST_F(Openapi, NamesEveryRouteAndNoOther) {
  std::set<std::pair<std::string, std::string>> described, routed;
  for (const auto& [path, item] : document_["paths"].items()) {
    std::string pattern = path;
    for (std::size_t at = 0; (at = pattern.find('{', at)) != std::string::npos; ++at)
      pattern.erase(at + 1, pattern.find('}', at) - at - 1);
    for (const char* method : {"get", "put", "post", "patch", "delete"}) {
      if (!item.contains(method)) continue;
      std::string upper = method;
      for (char& c : upper) c = static_cast<char>(std::toupper(static_cast<unsigned char>(c)));
      described.emplace(upper, pattern);
    }
  }
  for (const auto& route : api::api_routes()) routed.insert(route);
  EXPECT_EQ(described, routed);
}

// For openapi/lint, which runs a linter over it.
TEST_F(Openapi, IsWrittenForTheLinter) {
  const char* path = std::getenv("LIGHTKILN_OPENAPI");
  if (path == nullptr) GTEST_SKIP() << "LIGHTKILN_OPENAPI names no file";
  std::ofstream out(path);
  out << document_.dump(2);
  EXPECT_TRUE(out.flush());
}

TEST_F(Openapi, RefersOnlyToWhatIsThereAndNamesOperationsOnce) {
  std::set<std::string> ids;
  for (const auto& [path, item] : document_["paths"].items())
    for (const auto& [method, operation] : item.items()) {
      if (method == "parameters") continue;
      EXPECT_TRUE(ids.insert(operation["operationId"]).second) << path;
      EXPECT_TRUE(operation["responses"].contains("4XX")) << path;
    }
  EXPECT_NO_THROW(resolved(document_, document_));
}

TEST_F(Openapi, DescribesWhatTheServiceAnswers) {
  const std::string id = post_job(live_.port()), path = "/v1/jobs/" + id;
  expect_fits("Job", get(path + "?wait=20"));
  expect_fits("JobList", get("/v1/jobs?limit=1"));
  expect_fits("Results", get(path + "/results"));
  expect_fits("Problem", get("/v1/jobs/none"));
  expect_fits("Problem", get("/v1/jobs?state=odd"));
  const Answer scene = ask(live_.port(), "POST", "/v1/scenes", {}, "glTF");
  expect_fits("Scene", json::parse(scene.body));
}

TEST_F(Openapi, DescribesFailedJobs) {
  const Live failing(jobs::FakeBake::throwing([] { throw std::bad_alloc(); }));
  const std::string id = post_job(failing.port());
  const json job = json::parse(ask(failing.port(), "GET", "/v1/jobs/" + id + "?wait=20").body);
  EXPECT_EQ(job["state"], "failed");
  expect_fits("Job", job);
}

TEST_F(Openapi, DescribesRequestsAsTheyAreRead) {
  const json patch{{"priority", 1}, {"labels", {{"a", nullptr}}}, {"ttl_seconds", 0}};
  const json options{
      {"priority", 1}, {"labels", {{"a", "b"}}}, {"ttl_seconds", 0}, {"dedupe", true}};
  expect_fits("JobPatch", patch);
  expect_fits("Options", options);
  EXPECT_TRUE(proto::job_patch_from_json(patch));
  EXPECT_TRUE(proto::job_options_from_json(options));
  for (const json& wrong :
       {json{{"priority", 101}}, json{{"prio", 1}}, json{{"ttl_seconds", -1}}}) {
    const json rule = document_["components"]["schemas"]["Options"];
    EXPECT_FALSE(proto::accepts(rule, wrong));
    EXPECT_FALSE(proto::job_options_from_json(wrong));
  }
}

}  // namespace
}  // namespace kiln::test
