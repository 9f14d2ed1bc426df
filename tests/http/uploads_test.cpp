#include <gtest/gtest.h>
#include <signal.h>

#include <fstream>

#include <nlohmann/json.hpp>

#include "clients/client.h"
#include "proto/sha256.h"
#include "tests/http/live.h"
#include "tests/http/program.h"

/// Uploads in pieces, over HTTP.
namespace kiln::test {
namespace {

using Headers = std::vector<std::string>;

const std::string kPartial = "Content-Type: application/partial-upload";

class Resumable : public testing::Test {
 protected:
  jobs::FakeBake fake_;
  const std::string scene_ = "glTF" + std::string(100'000, 's');
  const std::string id_ = "sha256:" + proto::sha256_hex(scene_);

  static std::string begin(std::uint16_t port, std::size_t length, const Headers& more = {}) {
    Headers headers{"Upload-Length: " + std::to_string(length), "Content-Type: model/gltf-binary"};
    headers.insert(headers.end(), more.begin(), more.end());
    const Answer made = ask(port, "POST", "/v1/uploads", headers);
    EXPECT_EQ(made.status, 201) << made.body;
    EXPECT_EQ(made.headers.at("upload-offset"), "0");
    EXPECT_EQ(made.headers.at("upload-complete"), "?0");
    return made.headers.at("location");
  }
  static Answer patch(std::uint16_t port, const std::string& path, std::size_t offset,
                      const std::string& bytes, const Headers& more = {}) {
    Headers headers{kPartial, "Upload-Offset: " + std::to_string(offset)};
    headers.insert(headers.end(), more.begin(), more.end());
    return ask(port, "PATCH", path, headers, bytes);
  }
};

TEST_F(Resumable, PiecesBecomeAScene) {
  const Live live(fake_.instant());
  const std::string path = begin(live.port(), scene_.size());
  const Answer first = patch(live.port(), path, 0, scene_.substr(0, 60'000));
  EXPECT_EQ(first.status, 204);
  EXPECT_EQ(first.headers.at("upload-offset"), "60000");
  const Answer wrong = patch(live.port(), path, 0, scene_);
  EXPECT_EQ(wrong.status, 409);
  EXPECT_EQ(member(wrong.body, "code"), "offset_mismatch");
  EXPECT_EQ(wrong.headers.at("upload-offset"), "60000") << "the right one";
  EXPECT_EQ(ask(live.port(), "HEAD", path).headers.at("upload-offset"), "60000");
  const Answer last = patch(live.port(), path, 60'000, scene_.substr(60'000));
  EXPECT_EQ(last.status, 201) << last.body;
  EXPECT_EQ(last.headers.at("upload-complete"), "?1");
  EXPECT_EQ(last.headers.at("location"), "/v1/scenes/" + id_);
  EXPECT_EQ(member(last.body, "id"), id_);
  EXPECT_EQ(ask(live.port(), "HEAD", "/v1/scenes/" + id_).status, 200);
  const Answer after = ask(live.port(), "GET", path);
  EXPECT_EQ(member(after.body, "scene"), id_);
  EXPECT_EQ(member(after.body, "complete"), "true");
  const Answer again = patch(live.port(), path, scene_.size(), "");
  EXPECT_EQ(again.status, 200) << "for a client that did not hear the answer";
  EXPECT_EQ(member(again.body, "id"), id_);
  EXPECT_EQ(ask(live.port(), "DELETE", path).status, 204);
  EXPECT_EQ(ask(live.port(), "HEAD", path).status, 404);
}

TEST_F(Resumable, WhatArrivedBeforeTheConnectionBrokeIsKept) {
  const Live live(fake_.instant());
  const std::string path = begin(live.port(), scene_.size());
  {
    const Wire wire(live.port());
    wire.send("PATCH " + path + " HTTP/1.1\r\nHost: x\r\nUpload-Offset: 0\r\n" + kPartial +
              "\r\nContent-Length: " + std::to_string(scene_.size()) + "\r\n\r\n" +
              scene_.substr(0, 33'333));
  }
  std::string offset;
  for (int i = 0; i < 500 && offset != "33333"; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    offset = ask(live.port(), "HEAD", path).headers["upload-offset"];
  }
  EXPECT_EQ(offset, "33333");
  EXPECT_EQ(patch(live.port(), path, 33'333, scene_.substr(33'333)).status, 201);
}

TEST_F(Resumable, AWholeBodyMayComeAtOnceAndAFormHasSideFiles) {
  const Live live(fake_.instant());
  const Answer whole = ask(live.port(), "POST", "/v1/uploads",
                           {"Upload-Length: " + std::to_string(scene_.size())}, scene_);
  EXPECT_EQ(whole.status, 201) << whole.body;
  EXPECT_EQ(member(whole.body, "id"), id_);
  const std::string body = form(
      {{"name=\"scene\"; filename=\"a.gltf\"", "{}"}, {"name=\"f\"; filename=\"b.bin\"", "1234"}});
  const Answer made = ask(live.port(), "POST", "/v1/uploads",
                          {"Upload-Length: " + std::to_string(body.size()), kForm});
  const Answer scene = patch(live.port(), made.headers.at("location"), 0, body);
  EXPECT_EQ(scene.status, 201) << scene.body;
  EXPECT_EQ(member(scene.body, "side_files"), "1");
}

TEST_F(Resumable, TheSameKeyFindsTheUploadAgain) {
  const Live live(fake_.instant());
  const std::string path = begin(live.port(), scene_.size(), {"Idempotency-Key: yard"});
  patch(live.port(), path, 0, "glTF");
  const Answer again = ask(live.port(), "POST", "/v1/uploads",
                           {"Upload-Length: " + std::to_string(scene_.size()),
                            "Content-Type: model/gltf-binary", "Idempotency-Key: yard"});
  EXPECT_EQ(again.status, 200) << again.body;
  EXPECT_EQ(again.headers.at("location"), path);
  EXPECT_EQ(again.headers.at("upload-offset"), "4");
  EXPECT_EQ(ask(live.port(), "POST", "/v1/uploads",
                {"Upload-Length: 5", "Content-Type: model/gltf-binary", "Idempotency-Key: yard"})
                .status,
            422);
}

TEST_F(Resumable, RefusesWhatCanNotBecomeAScene) {
  base::ServerConfig config;
  config.max_upload_bytes = 200'000;
  const Live live(
      fake_.instant(), config, {}, [](const files::SceneFiles& files, const proto::BakeSettings&) {
        if (std::filesystem::file_size(files.main) > 10) return proto::Expected<void>();
        return proto::Expected<void>(proto::fail("invalid_scene", "Short.", "scene", ""));
      });
  const auto post = [&](const Headers& headers, const std::string& body = "") {
    return ask(live.port(), "POST", "/v1/uploads", headers, body);
  };
  EXPECT_EQ(post({}).status, 400) << "no length";
  EXPECT_EQ(post({"Upload-Length: many"}).status, 400);
  EXPECT_EQ(post({"Upload-Length: -1"}).status, 400);
  EXPECT_EQ(post({"Upload-Length: 0"}).status, 422);
  EXPECT_EQ(post({"Upload-Length: 200001"}).status, 413);
  EXPECT_EQ(post({"Upload-Length: 18446744073709551616"}).status, 400);
  EXPECT_EQ(post({"Upload-Length: 9", "Content-Type: text/html"}).status, 415);

  const std::string path = begin(live.port(), 5);
  EXPECT_EQ(ask(live.port(), "PATCH", path, {kPartial}, "glTF").status, 400) << "no offset";
  EXPECT_EQ(patch(live.port(), path, 0, "glTFglTF").status, 413);
  EXPECT_EQ(ask(live.port(), "HEAD", path).headers.at("upload-offset"), "0");
  EXPECT_EQ(patch(live.port(), "/v1/uploads/upl_" + std::string(26, 'x'), 0, "g").status, 404);
  EXPECT_EQ(patch(live.port(), "/v1/uploads/../jobs", 0, "g").status, 404);
  const Answer invalid = patch(live.port(), path, 0, "glTF!");
  EXPECT_EQ(invalid.status, 422);
  EXPECT_EQ(member(invalid.body, "code"), "invalid_scene");
  EXPECT_EQ(ask(live.port(), "HEAD", path).status, 404) << "nothing would mend it";

  const std::string digest =
      begin(live.port(), scene_.size(),
            {"Repr-Digest: sha-256=:AAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAAA=:"});
  EXPECT_EQ(member(patch(live.port(), digest, 0, scene_).body, "code"), "digest_mismatch");
}

TEST_F(Resumable, UploadsCountInTheQuotaOfTheirTenant) {
  base::ServerConfig config;
  config.max_bytes_per_tenant = 150'000;
  const Live live(fake_.instant(), config);
  const auto authorize = [&](const std::string& tenant) {
    return "Authorization: Bearer " +
           live.service->tokens().create(tenant, {"read", "write"}).value().secret;
  };
  const std::string art = authorize("art"), game = authorize("game");
  const std::string path = begin(live.port(), 100'000, {art});
  const Answer more = ask(live.port(), "POST", "/v1/uploads", {art, "Upload-Length: 60000"});
  EXPECT_EQ(more.status, 429);
  EXPECT_EQ(member(more.body, "code"), "quota_exceeded");
  EXPECT_EQ(ask(live.port(), "POST", "/v1/uploads", {game, "Upload-Length: 60000"}).status, 201);
  for (const char* method : {"HEAD", "DELETE"})
    EXPECT_EQ(ask(live.port(), method, path, {game}).status, 404) << method;
  EXPECT_EQ(patch(live.port(), path, 0, "glTF", {game}).status, 404);
  EXPECT_EQ(ask(live.port(), "DELETE", path, {art}).status, 204);
  EXPECT_EQ(ask(live.port(), "POST", "/v1/uploads", {art, "Upload-Length: 60000"}).status, 201);
}

/// A scene that is large enough for the client to send it by an upload.
std::filesystem::path large_scene(const std::filesystem::path& folder) {
  const auto small = write_small_scene(folder);
  std::string bytes = read_bytes(small);
  // One more chunk, of a type that glTF readers skip.
  const std::uint32_t pad = clients::Client::kResumableBytes;
  const auto word = [](std::uint32_t v) {
    return std::string{char(v & 255), char(v >> 8 & 255), char(v >> 16 & 255), char(v >> 24 & 255)};
  };
  bytes += word(pad) + "PADX" + std::string(pad, '\0');
  bytes.replace(8, 4, word(static_cast<std::uint32_t>(bytes.size())));
  const auto path = folder / "large.glb";
  std::ofstream(path, std::ios::binary) << bytes;
  return path;
}

TEST_F(Resumable, TheClientGoesOnWithAnUploadThatAKilledServiceHad) {
  const TempFolder folder;
  const auto scene = large_scene(folder.path());
  const std::string bytes = read_bytes(scene), key = proto::sha256_hex(bytes);
  std::string path;
  {
    Program killed(folder.path() / "data");
    const Answer made =
        ask(killed.port(), "POST", "/v1/uploads",
            {"Upload-Length: " + std::to_string(bytes.size()),
             "Content-Type: application/octet-stream", "Idempotency-Key: scene-" + key});
    ASSERT_EQ(made.status, 201) << made.body;
    path = made.headers.at("location");
    EXPECT_EQ(patch(killed.port(), path, 0, bytes.substr(0, 3'000'000)).status, 204);
    killed.signal(SIGKILL);
    killed.wait_exit();
  }
  Program program(folder.path() / "data");
  EXPECT_EQ(ask(program.port(), "HEAD", path).headers["upload-offset"], "3000000");
  clients::Client client(clients::parse_server_url(program.url()).value());
  const auto job = client.submit({scene, {}, R"({"solver":{"samples":16}})", {}});
  ASSERT_TRUE(job) << job.error().message;
  EXPECT_EQ(job->scene_sha256, key);
  const Answer upload = ask(program.port(), "GET", path);
  EXPECT_EQ(member(upload.body, "scene"), "sha256:" + key) << "it went on with this one";
  const Answer done = ask(program.port(), "GET", "/v1/jobs/" + job->id + "?wait=60");
  EXPECT_EQ(member(done.body, "state"), "succeeded") << done.body;
  ASSERT_TRUE(client.submit({scene, {}, "", {}}));
  EXPECT_EQ(program.log().find("\"method\":\"POST\",\"path\":\"/v1/uploads/"), std::string::npos);
}

}  // namespace
}  // namespace kiln::test
