#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <sstream>

#include "tests/http/program.h"

/// What the log says of requests and jobs.
namespace kiln::test {
namespace {

using std::chrono::milliseconds;

class Log : public testing::Test {
 protected:
  TempFolder folder;

  /// The lines with this request id, once one of them ends the request.
  static std::vector<nlohmann::json> lines(Program& program, const std::string& request_id) {
    program.logged("\"own_ms\":");  // any
    std::vector<nlohmann::json> found;
    for (int i = 0; i < 100; ++i) {
      found.clear();
      std::istringstream log(program.log());
      bool ended = false;
      for (std::string line; std::getline(log, line);) {
        const auto entry = nlohmann::json::parse(line, nullptr, false);
        if (entry.is_discarded() || entry.value("request_id", "") != request_id) continue;
        ended = ended || entry.contains("own_ms");
        found.push_back(entry);
      }
      if (ended) break;
      std::this_thread::sleep_for(milliseconds(20));
    }
    return found;
  }
  static const nlohmann::json& last(const std::vector<nlohmann::json>& lines) {
    static const nlohmann::json none = nlohmann::json::object();
    return lines.empty() ? none : lines.back();
  }
};

TEST_F(Log, EveryLineOfARequestHasItsId) {
  Program program(folder.path() / "data");
  const Answer posted = curl(job_form(write_small_scene(folder.path())) + program.url("/v1/jobs"));
  ASSERT_EQ(posted.status, 202) << posted.body;
  const auto found = lines(program, posted.headers.at("x-request-id"));
  ASSERT_EQ(found.size(), 2u);
  EXPECT_EQ(found[0].value("event", ""), "job");
  EXPECT_EQ(found[0].value("job", ""), member(posted.body, "id"));
  EXPECT_EQ(found[1].value("event", ""), "request");
}

TEST_F(Log, WarnsOfWorkThatTookLong) {
  Program program(folder.path() / "data", {"--slow-request-ms", "1"});
  // Hashed, checked and flushed to the disk: more than a millisecond on any machine.
  const Answer slow =
      curl("-H 'Content-Type: model/gltf-binary' --data-binary @" +
           write_scene(folder.path(), "room_textured").string() + " " + program.url("/v1/scenes"));
  ASSERT_EQ(slow.status, 201) << slow.body;
  const auto line = last(lines(program, slow.headers.at("x-request-id")));
  EXPECT_EQ(line.value("event", ""), "request.slow");
  EXPECT_EQ(line.value("level", ""), "warn");
  EXPECT_GE(line.value("own_ms", 0.0), 1);
}

TEST_F(Log, ASlowClientIsNoSlowRequest) {
  Program program(folder.path() / "data", {"--slow-request-ms", "250"});
  const Wire wire(program.port());
  wire.send(
      "POST /v1/jobs HTTP/1.1\r\nHost: x\r\nContent-Type: application/json\r\n"
      "Content-Length: 2\r\n\r\n{");
  std::this_thread::sleep_for(milliseconds(600));
  wire.send("}");
  const std::string answer = wire.read("\r\n\r\n");
  const auto at = answer.find("X-Request-Id: ");
  ASSERT_NE(at, std::string::npos) << answer;
  const auto late = last(lines(program, answer.substr(at + 14, answer.find('\r', at) - at - 14)));
  EXPECT_EQ(late.value("event", ""), "request");
  EXPECT_GE(late.value("ms", 0.0), 400) << "our clock starts before the service's";
  EXPECT_LT(late.value("own_ms", 1e9), 250);
  // Nor is one that its client asked to wait.
  const std::string id = post_job(program, write_scene(folder.path(), "cornell"), kLongBake);
  const Answer waited = ask(program.port(), "GET", "/v1/jobs/" + id + "?wait=1");
  const auto asleep = last(lines(program, waited.headers.at("x-request-id")));
  EXPECT_EQ(asleep.value("event", ""), "request");
  EXPECT_GE(asleep.value("ms", 0.0), 1000);
  EXPECT_LT(asleep.value("own_ms", 1e9), 250);
}

}  // namespace
}  // namespace kiln::test
