#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "tests/http/live.h"

/// `lightkiln doctor`, as the built program.
namespace kiln::test {
namespace {

struct Report {
  int code = -1;
  std::string text;
  nlohmann::json document;
  /// Of one check: "ok", "warn", "fail"; "" when there is no such check.
  std::string health(const std::string& name) const { return member_of(name, "health"); }
  std::string advice(const std::string& name) const { return member_of(name, "advice"); }

 private:
  std::string member_of(const std::string& name, const char* key) const {
    if (!document.contains("checks")) return {};
    for (const auto& check : document["checks"])
      if (check["name"] == name) return check[key];
    return {};
  }
};

class Doctor : public testing::Test {
 protected:
  TempFolder folder;

  Report ask_it(const std::string& flags) const {
    const auto output = folder.path() / "output";
    const std::string command = std::string(LIGHTKILN_BINARY) + " doctor " + flags + " >" +
                                output.string() + " 2>&1 </dev/null";
    const int status = std::system(command.c_str());
    std::ifstream in(output, std::ios::binary);
    Report report{WEXITSTATUS(status), std::string(std::istreambuf_iterator<char>(in), {}), {}};
    report.document = nlohmann::json::parse(report.text, nullptr, false);
    return report;
  }
  std::string data() const { return "--data " + (folder.path() / "data").string(); }
};

TEST_F(Doctor, LooksAtEverything) {
  const Report report = ask_it(data() + " --port 0 --admin-port 0 --json");
  for (const char* name : {"processor", "memory", "image_module", "data_fsync", "disk_free",
                           "descriptors", "port", "admin_port", "tokens", "clock", "sqlite"})
    EXPECT_NE(report.health(name), "") << name << report.text;
  EXPECT_EQ(report.health("port"), "ok");
  EXPECT_EQ(report.health("image_module"), "ok");
  EXPECT_NE(report.health("data_fsync"), "fail");
  EXPECT_EQ(report.code, report.document["health"] == "fail" ? 1 : 0) << report.text;
  EXPECT_TRUE(std::filesystem::is_empty(folder.path() / "data"));
  const Report lines = ask_it(data() + " --port 0 --admin-port 0");
  EXPECT_NE(lines.text.find("data_fsync"), std::string::npos) << lines.text;
}

TEST_F(Doctor, SaysWhatToDo) {
  jobs::FakeBake fake;
  const Live live(fake.instant());
  std::ofstream(folder.path() / "file") << "x";
  const Report report =
      ask_it("--data " + (folder.path() / "file" / "data").string() + " --listen 0.0.0.0 --port " +
             std::to_string(live.port()) + " --admin-port 0 --max-connections 1000000 --json");
  EXPECT_EQ(report.code, 1);
  for (const char* name : {"data_fsync", "port", "tokens"}) {
    EXPECT_EQ(report.health(name), "fail") << name << report.text;
    EXPECT_NE(report.advice(name), "") << name;
  }
  EXPECT_NE(report.advice("tokens").find("lightkiln token create"), std::string::npos);
  EXPECT_EQ(ask_it("--port odd").code, 2);
}

}  // namespace
}  // namespace kiln::test
