#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>

#include "proto/sha256.h"
#include "tests/http/event_stream.h"
#include "tests/http/program.h"
#include "tests/http/receiver.h"
#include "tests/proto/schema_check.h"

/// Every example of /openapi.json: requests are sent to a live service and have to be answered as
/// the document says; example answers have to fit their schemas.
namespace kiln::test {
namespace {

using nlohmann::json;
using namespace nlohmann::literals;

json resolved(const json& node, const json& document) {
  if (node.is_object() && node.contains("$ref"))
    return resolved(document.at(json::json_pointer(node["$ref"].get<std::string>().substr(1))),
                    document);
  if (!node.is_structured()) return node;
  json out = node;
  for (auto& child : out) child = resolved(child, document);
  return out;
}

void replace_all(std::string& text, const std::string& from, const std::string& to) {
  for (std::size_t at = 0; (at = text.find(from, at)) != std::string::npos; at += to.size())
    text.replace(at, from.size(), to);
}

std::string text_of(const json& value) {
  return value.is_string() ? value.get<std::string>() : value.dump();
}

/// One request, made of the examples of an operation.
struct Example {
  std::string operation, method, path, query, media, body;
  std::vector<std::string> headers;
  json responses;
};

class OpenapiExamples : public testing::Test {
 protected:
  TempFolder folder_;
  Receiver receiver_;
  const std::filesystem::path scene_ = write_small_scene(folder_.path());
  const std::string bytes_ = read_bytes(scene_);
  const Program program_{
      folder_.path() / "data",
      {"--webhook-networks", "127.0.0.0/8", "--webhook-secrets",
       folder_.write("secrets", "ci = whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw\n").string()}};
  const json document_ = json::parse(ask(program_.port(), "GET", "/openapi.json").body);
  const std::string example_job_ = find_example("^job_"), example_upload_ = find_example("^upl_"),
                    example_digest_ = find_example("^[0-9a-f]{64}$");
  int made_ = 0;

  std::string find_example(const std::string& pattern) const {
    for (const auto& [path, item] : document_["paths"].items())
      if (item.contains("parameters"))
        for (const auto& parameter : item["parameters"])
          if (parameter["schema"]["pattern"].get<std::string>().starts_with(pattern))
            return parameter["example"].get<std::string>();
    ADD_FAILURE() << "no example of " << pattern;
    return {};
  }

  std::string finished_job() const {
    const std::string id = post_job(program_, scene_, R"({"solver":{"samples":16}})");
    const Answer job = ask(program_.port(), "GET", "/v1/jobs/" + id + "?wait=60");
    EXPECT_EQ(member(job.body, "state"), "succeeded") << job.body;
    return id;
  }
  std::string canceled_job() const {
    const std::string id = post_job(program_, write_scene(folder_.path(), "cornell"), kLongBake);
    ask(program_.port(), "POST", "/v1/jobs/" + id + "/cancel");
    ask(program_.port(), "GET", "/v1/jobs/" + id + "?wait=60");
    return id;
  }
  std::string new_upload() const {
    const Answer made =
        ask(program_.port(), "POST", "/v1/uploads",
            {"Upload-Length: " + std::to_string(bytes_.size()), "Content-Type: model/gltf-binary"});
    return member(made.body, "id");
  }

  /// The examples name things that are not there: puts what is there in their places.
  void make_true(Example& e) {
    std::map<std::string, std::string> truth{
        {example_digest_, proto::sha256_hex(bytes_)},
        {"https://ci.example.com/baked", receiver_.url()},
        {"Upload-Length: 2524", "Upload-Length: " + std::to_string(bytes_.size())},
        {"yard-1", "yard-" + std::to_string(++made_)}};
    if (e.path.find(example_job_) != std::string::npos)
      truth[example_job_] = e.operation == "retryJob" ? canceled_job() : finished_job();
    if (e.path.find(example_upload_) != std::string::npos) truth[example_upload_] = new_upload();
    for (const auto& [from, to] : truth) {
      replace_all(e.path, from, to);
      replace_all(e.query, from, to);
      replace_all(e.body, from, to);
      for (auto& header : e.headers) replace_all(header, from, to);
    }
  }

  void give_body(Example& e, const std::string& media, const json& content) {
    e.media = media;
    if (e.operation == "postVisibility") {
      e.body = std::string(3 * 24, '\0');  // three pairs of the origin
    } else if (!content.contains("example")) {
      e.body = bytes_;  // a file
    } else if (media == "multipart/form-data") {
      std::vector<std::pair<std::string, std::string>> parts;
      for (const auto& [name, value] : content["example"].items())
        parts.emplace_back(
            name == "scene" ? "name=\"scene\"; filename=\"yard.glb\"" : "name=\"" + name + "\"",
            name == "scene" ? bytes_ : value.dump());
      e.body = form(parts);
      e.media += "; boundary=B";
    } else {
      e.body = content["example"].dump();
    }
  }

  Example request_of(const std::string& path, const std::string& method, const json& item) const {
    const json& operation = item[method];
    Example e{operation["operationId"], method, path, {}, {}, {}, {}, operation["responses"]};
    std::transform(e.method.begin(), e.method.end(), e.method.begin(),
                   [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
    for (const json* parameters : {&item, &operation}) {
      if (!parameters->contains("parameters")) continue;
      for (const auto& p : (*parameters)["parameters"]) {
        const bool needed = p.value("required", false);
        EXPECT_TRUE(!needed || p.contains("example")) << e.operation << " " << p["name"];
        if (!p.contains("example")) continue;
        const std::string name = p["name"], value = text_of(p["example"]);
        if (p["in"] == "path") replace_all(e.path, "{" + name + "}", value);
        if (p["in"] == "query") e.query += (e.query.empty() ? "?" : "&") + name + "=" + value;
        if (p["in"] == "header") e.headers.push_back(name + ": " + value);
      }
    }
    return e;
  }

  void run(Example e) {
    SCOPED_TRACE(e.operation + " " + e.media);
    make_true(e);
    if (!e.media.empty()) e.headers.push_back("Content-Type: " + e.media);
    if (e.responses.contains("/200/content/text~1event-stream"_json_pointer)) {
      EventStream stream(program_.port(), e.path + e.query, e.headers);
      EXPECT_EQ(stream.status(), 200);
      EXPECT_TRUE(stream.wait_first());
      return;
    }
    const Answer answer = ask(program_.port(), e.method, e.path + e.query, e.headers, e.body);
    if (e.operation == "retryJob") {  // it would bake for a minute
      const std::string cancel = e.path.substr(0, e.path.rfind('/')) + "/cancel";
      EXPECT_EQ(ask(program_.port(), "POST", cancel).status, 202);
    }
    const std::string status = std::to_string(answer.status);
    ASSERT_TRUE(e.responses.contains(status)) << status << " " << answer.body.substr(0, 2'000);
    EXPECT_LT(answer.status, 400);
    const json& told = e.responses[status];
    if (!told.contains("content")) {
      EXPECT_EQ(answer.body, "");
      return;
    }
    const std::string type = answer.headers.at("content-type");
    const std::string plain = type.substr(0, type.find(';'));
    const bool file = told["content"].contains("application/octet-stream");
    ASSERT_TRUE(file || told["content"].contains(plain)) << plain;
    if (file || !told["content"][plain].contains("schema")) return;
    const json value = json::parse(answer.body);
    EXPECT_TRUE(proto::accepts(resolved(told["content"][plain]["schema"], document_), value))
        << value.dump(2);
  }
};

TEST_F(OpenapiExamples, OfRequestsAreAnsweredAsTheDocumentSays) {
  ASSERT_EQ(ask(program_.port(), "POST", "/v1/scenes", {"Content-Type: model/gltf-binary"}, bytes_)
                .status,
            201);
  std::set<std::string> run_operations;
  for (const auto& [path, item] : document_["paths"].items())
    for (const char* method : {"get", "put", "post", "patch", "delete"}) {
      if (!item.contains(method)) continue;
      const Example plain = request_of(path, method, item);
      run_operations.insert(plain.operation);
      if (!item[method].contains("requestBody")) {
        run(plain);
        continue;
      }
      for (const auto& [media, content] : item[method]["requestBody"]["content"].items()) {
        Example with_body = plain;
        if (media == "multipart/form-data" && !content.contains("example")) continue;
        if (plain.operation == "postUpload")
          with_body.media = media;  // the bytes come later
        else
          give_body(with_body, media, content);
        run(with_body);
      }
    }
  EXPECT_GE(run_operations.size(), 24u);
}

TEST_F(OpenapiExamples, OfAnswersFitTheirSchemas) {
  int found = 0;
  const auto check = [&](const json& content, const std::string& where) {
    for (const auto& [type, media] : content.items()) {
      if (!media.contains("example")) continue;
      ++found;
      EXPECT_TRUE(proto::accepts(resolved(media["schema"], document_), media["example"]))
          << where << "\n"
          << media["example"].dump(2);
    }
  };
  for (const auto& [path, item] : document_["paths"].items())
    for (const auto& [method, operation] : item.items()) {
      if (!operation.is_object()) continue;
      if (operation.contains("requestBody")) check(operation["requestBody"]["content"], path);
      for (const auto& [status, answer] : operation["responses"].items())
        if (answer.contains("content")) check(answer["content"], path + " " + status);
    }
  EXPECT_GE(found, 20);
}

}  // namespace
}  // namespace kiln::test
