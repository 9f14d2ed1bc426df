#include "server/cli/config.h"

#include <gtest/gtest.h>

#include <set>

#include "tests/support/temp_files.h"

namespace kiln::cli {
namespace {

ConfigSources sources(const std::filesystem::path& file = {}) {
  ConfigSources s;
  s.environment = {{"HOME", "/home/u"}, {"PATH", "/bin"}};
  s.default_file = file.empty() ? "/nonexistent/lightkiln.toml" : file;
  return s;
}

std::set<std::string> places(const ConfigSources& s) {
  const auto loaded = load_config(s);
  EXPECT_FALSE(loaded);
  std::set<std::string> out;
  if (!loaded)
    for (const auto& d : loaded.error().details) out.insert(d.pointer);
  return out;
}

TEST(Config, Defaults) {
  const auto loaded = load_config(sources());
  ASSERT_TRUE(loaded);
  EXPECT_EQ(loaded->config.listen, "127.0.0.1");
  EXPECT_EQ(loaded->config.port, 8080);
  EXPECT_EQ(loaded->config.admin_port, 8081);
  EXPECT_EQ(loaded->config.data, "/home/u/.local/share/lightkiln");
  EXPECT_EQ(loaded->origin.at("port"), "default");
}

TEST(Config, FlagsBeatVariablesBeatTheFile) {
  const test::TempFolder dir;
  auto s = sources(dir.write("lightkiln.toml",
                             "port = 1000\nthreads = 3\nlog_level = 'warn'\n"
                             "max_upload_bytes = 2048\ndata = '/srv/x'\n"));
  s.environment["LIGHTKILN_PORT"] = "1001";
  s.environment["LIGHTKILN_THREADS"] = "4";
  s.flags = {{"port", "1002"}, {"log_format", "json"}};
  const auto loaded = load_config(s);
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(loaded->config.port, 1002);
  EXPECT_EQ(loaded->config.threads, 4u);
  EXPECT_EQ(loaded->config.log_level, "warn");
  EXPECT_EQ(loaded->config.max_upload_bytes, 2048u);
  EXPECT_EQ(loaded->config.data, "/srv/x");
  EXPECT_EQ(loaded->config.log_format, base::LogFormat::kJson);
  EXPECT_EQ(loaded->origin.at("port"), "flag");
  EXPECT_EQ(loaded->origin.at("threads"), "LIGHTKILN_THREADS");
  EXPECT_EQ(loaded->origin.at("log_level"), (dir.path() / "lightkiln.toml").string());
}

TEST(Config, UnknownNamesAreErrorsEverywhereAndAllAtOnce) {
  const test::TempFolder dir;
  const auto file = dir.write("c.toml", "prot = 1\n[section]\nx = 1\n");
  auto s = sources(file);
  s.environment["LIGHTKILN_PROT"] = "1";
  s.environment["LIGHTKILN_SERVER"] = "http://x";  // Of the client's commands: known.
  EXPECT_EQ(places(s), (std::set<std::string>{file.string() + ": prot", file.string() + ": section",
                                              "LIGHTKILN_PROT"}));
  EXPECT_NE(load_config(s).error().details[0].detail.find("\"port\""), std::string::npos);
}

TEST(Config, BadValues) {
  for (const auto& [name, text] :
       std::vector<std::pair<std::string, std::string>>{{"port", "65536"},
                                                        {"port", "-1"},
                                                        {"port", ""},
                                                        {"port", "80x"},
                                                        {"port", " 80"},
                                                        {"threads", "1025"},
                                                        {"http_threads", "1"},
                                                        {"max_queued_jobs", "0"},
                                                        {"max_upload_bytes", "1GB"},
                                                        {"max_upload_bytes", ""},
                                                        {"max_upload_bytes", "GiB"},
                                                        {"max_upload_bytes", "99999999999GiB"},
                                                        {"log_level", "loud"},
                                                        {"log_format", "xml"},
                                                        {"listen", ""},
                                                        {"listen", "a b"},
                                                        {"data", ""},
                                                        {"heartbeat_seconds", "0"}}) {
    auto s = sources();
    s.flags[name] = text;
    EXPECT_EQ(places(s), std::set<std::string>{flag_of(name)}) << name << "=" << text;
  }
  auto s = sources();
  s.flags = {{"port", "9000"}, {"admin_port", "9000"}};
  EXPECT_EQ(places(s), std::set<std::string>{"--admin-port"});
}

TEST(Config, ByteCounts) {
  for (const auto& [text, bytes] : std::vector<std::pair<std::string, std::uint64_t>>{
           {"1024", 1024}, {"1KiB", 1024}, {"512MiB", 512ull << 20}, {"3GiB", 3ull << 30}}) {
    auto s = sources();
    s.flags["max_upload_bytes"] = text;
    ASSERT_TRUE(load_config(s));
    EXPECT_EQ(load_config(s)->config.max_upload_bytes, bytes);
  }
}

TEST(Config, FilesThatCannotBeRead) {
  const test::TempFolder dir;
  auto s = sources();
  s.file = dir.path() / "none.toml";
  EXPECT_EQ(load_config(s).error().code, "missing_file");
  s.file = dir.write("bad.toml", "port = = 3\n");
  EXPECT_EQ(load_config(s).error().code, "invalid_config");
  EXPECT_NE(load_config(s).error().message.find("line 1"), std::string::npos);
  s.file = dir.write("twice.toml", "port = 1\nport = 2\n");
  EXPECT_EQ(load_config(s).error().code, "invalid_config");
  s.file = dir.write("types.toml", "port = '80'\nlisten = [1]\n");
  EXPECT_EQ(places(s).size(), 2u);
  s.file = dir.write("huge.toml", std::string(2u << 20, '#'));
  EXPECT_EQ(load_config(s).error().code, "invalid_config");
}

TEST(Config, WhatIsPrintedIsReadBack) {
  const test::TempFolder dir;
  auto s = sources();
  s.flags = {{"data", "/odd \"folder\"\\x"}, {"port", "81"}, {"max_upload_bytes", "1GiB"}};
  const auto first = load_config(s);
  ASSERT_TRUE(first);
  auto again = sources();
  again.file = dir.write("c.toml", config_text(*first));
  const auto second = load_config(again);
  ASSERT_TRUE(second) << second.error().message;
  for (const auto& row : config_rows())
    EXPECT_EQ(row.show(first->config), row.show(second->config)) << row.name;
}

TEST(Config, DataFolder) {
  EXPECT_EQ(default_data_folder({{"XDG_DATA_HOME", "/x"}, {"HOME", "/h"}}), "/x/lightkiln");
  EXPECT_EQ(default_data_folder({{"XDG_DATA_HOME", "relative"}, {"HOME", "/h"}}),
            "/h/.local/share/lightkiln");
  EXPECT_EQ(default_data_folder({}), "lightkiln-data");
}

}  // namespace
}  // namespace kiln::cli
