#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>

#include "tests/http/live.h"
#include "tests/http/program.h"

/// Tokens, tenants and quotas on a live service.
namespace kiln::test {
namespace {

class Tenants : public testing::Test {
 protected:
  jobs::FakeBake fake_;

  struct Client {
    std::uint16_t port;
    std::string authorization;
    Answer operator()(const std::string& method, const std::string& target,
                      std::vector<std::string> headers = {}, const std::string& body = "") const {
      headers.push_back(authorization);
      return ask(port, method, target, headers, body);
    }
    Answer post_job(const std::string& scene = "glTF", const std::string& options = "{}") const {
      return (*this)(
          "POST", "/v1/jobs", {kForm},
          form({{"name=\"scene\"; filename=\"a.glb\"", scene}, {"name=\"options\"", options}}));
    }
  };
  static Client client(const Live& live, const std::string& tenant,
                       const std::vector<std::string>& scopes = {"read", "write"}) {
    return {live.port(), "Authorization: Bearer " +
                             live.service->tokens().create(tenant, scopes).value().secret};
  }
};

TEST_F(Tenants, SeeNothingOfEachOther) {
  const Live live(fake_.instant());
  const Client art = client(live, "art"), game = client(live, "game");
  const Client ops = client(live, "ops", {"admin"}), guest = client(live, "art", {"read"});
  const Answer made = art.post_job();
  ASSERT_EQ(made.status, 202) << made.body;
  EXPECT_EQ(member(made.body, "tenant"), "art");
  const std::string path = made.headers.at("location"), id = member(made.body, "id");
  EXPECT_EQ(member(art("GET", path + "?wait=20").body, "state"), "succeeded");

  for (const std::string below :
       {"", "?wait=1", "/events", "/results", "/results/page_00.exr", "/preview", "/view"})
    EXPECT_EQ(game("GET", path + below).status, 404) << below;
  EXPECT_EQ(game("DELETE", path).status, 404);
  EXPECT_EQ(game("PATCH", path, {}, "{}").status, 404);
  EXPECT_EQ(game("POST", path + "/cancel").status, 404);
  EXPECT_EQ(game("POST", path + "/retry").status, 404);
  EXPECT_EQ(member(game("GET", "/v1/jobs").body, "items"), "[]");
  const std::string foreign = game("GET", path).body, none = game("GET", "/v1/jobs/job_x").body;
  EXPECT_EQ(member(foreign, "code"), member(none, "code"));

  EXPECT_EQ(ops("GET", path).status, 200);
  EXPECT_NE(ops("GET", "/v1/jobs").body.find(id), std::string::npos);
  EXPECT_EQ(guest("GET", path).status, 200);
  const Answer forbidden = guest("DELETE", path);
  EXPECT_EQ(forbidden.status, 403);
  EXPECT_EQ(member(forbidden.body, "code"), "forbidden_scope");
  const Answer unknown = ask(live.port(), "GET", path);
  EXPECT_EQ(unknown.status, 401);
  EXPECT_EQ(unknown.headers.at("www-authenticate"), "Bearer realm=\"lightkiln\"");
  EXPECT_EQ(ask(live.port(), "POST", "/v1/jobs", {}, "glTF").status, 401);
  EXPECT_EQ(ask(live.port(), "GET", "/").status, 200);
  EXPECT_EQ(ask(live.service->admin_port(), "GET", "/healthz").status, 200);
}

TEST_F(Tenants, ShareNoScenesKeysAndTwins) {
  const Live live(fake_.instant());
  const Client art = client(live, "art"), game = client(live, "game");
  const Answer scene = art("POST", "/v1/scenes", {"Content-Type: model/gltf-binary"}, "glTF1");
  ASSERT_EQ(scene.status, 201);
  const std::string at = scene.headers.at("location");
  const std::string job = "{\"scene\":\"" + member(scene.body, "id") + "\"}";
  const std::vector<std::string> json{"Content-Type: application/json", "Idempotency-Key: k"};
  EXPECT_EQ(game("HEAD", at).status, 404) << "not even that it is there";
  EXPECT_EQ(game("POST", "/v1/jobs", json, job).status, 404);
  const Answer first = art("POST", "/v1/jobs", json, job);
  EXPECT_EQ(first.status, 202);
  art("GET", first.headers.at("location") + "?wait=20");
  EXPECT_EQ(game("POST", "/v1/scenes", {"Content-Type: model/gltf-binary"}, "glTF1").status, 200);
  EXPECT_EQ(game("HEAD", at).status, 200) << "it has the scene itself";
  const Answer second = game("POST", "/v1/jobs", json, job);
  EXPECT_EQ(second.status, 202) << "neither a replay nor a twin";
  EXPECT_EQ(art("POST", "/v1/jobs", json, job).status, 200);
}

TEST_F(Tenants, HaveQuotas) {
  base::ServerConfig config;
  config.max_running_jobs = 2;
  config.max_running_jobs_per_tenant = 1;
  config.max_queued_jobs_per_tenant = 1;
  config.max_bytes_per_tenant = 150'000;
  const Live live(fake_.holding(), config);
  const Client art = client(live, "art"), game = client(live, "game");
  const std::string options = R"({"dedupe":false})";
  const std::string first = member(art.post_job("glTF", options).body, "id");
  const auto state = [](const Client& who, const std::string& id) {
    return member(who("GET", "/v1/jobs/" + id).body, "state");
  };
  while (state(art, first) != "running") std::this_thread::sleep_for(std::chrono::milliseconds(5));
  const std::string second = member(art.post_job("glTF", options).body, "id");
  const Answer third = art.post_job("glTF", options);
  EXPECT_EQ(third.status, 429);
  EXPECT_EQ(member(third.body, "code"), "quota_exceeded");
  EXPECT_TRUE(third.headers.contains("retry-after"));
  const std::string other = member(game.post_job("glTF", options).body, "id");
  while (state(game, other) != "running") std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_EQ(state(art, second), "queued") << "there is a runner, but not for this tenant";
  fake_.go = true;
  for (const auto& id : {first, second}) art("GET", "/v1/jobs/" + id + "?wait=20");
  EXPECT_EQ(state(art, second), "succeeded");
  EXPECT_EQ(member(art.post_job("glTF", options).body, "code"), "quota_exceeded") << "200 kB";
  EXPECT_EQ(art("DELETE", "/v1/jobs/" + first).status, 204);
  EXPECT_EQ(art.post_job("glTF", options).status, 202);
}

TEST_F(Tenants, WithoutTokensTheServiceStaysOnLoopback) {
  const TempFolder folder;
  const std::string data = (folder.path() / "data").string();
  const std::string error = (folder.path() / "error").string();
  const std::string binary = LIGHTKILN_BINARY;
  const std::string serve =
      binary + " serve --port 0 --admin-port 0 --listen 0.0.0.0 --data " + data + " 2>" + error;
  EXPECT_EQ(WEXITSTATUS(std::system(serve.c_str())), 1);
  EXPECT_NE(read_bytes(error).find("lightkiln token create"), std::string::npos);

  const std::string secret_file = (folder.path() / "token").string();
  EXPECT_EQ(std::system((binary + " token create --tenant art --data " + data + " >" + secret_file +
                         " 2>/dev/null")
                            .c_str()),
            0);
  Program program(data, {"--listen", "0.0.0.0"});
  EXPECT_TRUE(program.logged("\"tokens\":\"required\""));
  const auto scene = write_small_scene(folder.path());
  const std::string submit = binary + " submit " + scene.string() + " --server " + program.url() +
                             " --set solver.samples=16 --wait -q -o " +
                             (folder.path() / "out").string() + " 2>/dev/null";
  EXPECT_NE(std::system(submit.c_str()), 0);
  EXPECT_EQ(std::system((submit + " --token-file " + secret_file).c_str()), 0);
  EXPECT_TRUE(std::filesystem::exists(folder.path() / "out" / "lit.glb"));
  const std::string list = (folder.path() / "list").string();
  EXPECT_EQ(std::system((binary + " token list --data " + data + " >" + list).c_str()), 0);
  const std::string id = read_bytes(list).substr(0, 30);
  EXPECT_EQ(std::system((binary + " token revoke " + id + " --data " + data).c_str()), 0);
  EXPECT_NE(std::system((submit + " --token-file " + secret_file).c_str()), 0);
}

}  // namespace
}  // namespace kiln::test
