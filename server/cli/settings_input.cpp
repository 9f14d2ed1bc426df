#include "server/cli/settings_input.h"

#include <CLI/CLI.hpp>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

#include "proto/json.h"

namespace kiln::cli {
namespace {

constexpr std::size_t kMaxBytes = 16u << 20;

proto::Expected<std::string> read_all(const std::string& file) {
  std::ifstream opened;
  if (file != "-") opened.open(file, std::ios::binary);
  std::istream& in = file == "-" ? std::cin : opened;
  std::string text(kMaxBytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (!in.eof() && text.size() <= kMaxBytes)
    return proto::fail("missing_file", "The settings file " + file + " can't be read.");
  if (text.size() > kMaxBytes)
    return proto::fail("invalid_settings", "The settings file is larger than 16 MiB.");
  return text;
}

}  // namespace

void SettingsInput::add_flags(CLI::App& app) {
  app.add_option("--settings", file, "JSON file with settings of the bake (- for stdin)")
      ->type_name("FILE");
  app.add_option("--set", sets,
                 "One setting, over those of the file: --set solver.samples=64\n"
                 "(`lightkiln settings` lists them); may be given many times")
      ->type_name("NAME=VALUE")
      ->take_all();
}

proto::Expected<std::string> SettingsInput::document() const {
  if (file.empty() && sets.empty()) return std::string();
  nlohmann::json doc = nlohmann::json::object();
  if (!file.empty()) {
    auto text = read_all(file);
    if (!text) return text;
    auto parsed = proto::parse_json(*text, "settings");
    if (!parsed) return proto::Unexpected(std::move(parsed.error()));
    doc = std::move(*parsed);
  }
  for (const auto& assignment : sets)
    if (auto ok = proto::set_by_path(doc, assignment); !ok)
      return proto::Unexpected(std::move(ok.error()));
  if (auto checked = proto::settings_from_json(doc); !checked)
    return proto::Unexpected(std::move(checked.error()));
  return proto::to_text(doc);
}

proto::Expected<proto::BakeSettings> SettingsInput::settings() const {
  return document().and_then([](const std::string& text) { return proto::parse_settings(text); });
}

}  // namespace kiln::cli
