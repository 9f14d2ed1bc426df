#include "server/cli/toml_values.h"

#include <toml++/toml.h>

#include <fstream>
#include <iterator>
#include <sstream>

namespace kiln::cli {
namespace {

constexpr std::size_t kMaxBytes = 1u << 20;

proto::Expected<std::string> read_text(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::string text(kMaxBytes + 1, '\0');
  in.read(text.data(), static_cast<std::streamsize>(text.size()));
  text.resize(static_cast<std::size_t>(in.gcount()));
  if (in.bad() || (text.empty() && !in.eof()))
    return proto::fail("missing_file",
                       "The configuration file " + path.string() + " can't be read.");
  if (text.size() > kMaxBytes)
    return proto::fail("invalid_config", path.string() + " is larger than 1 MiB.");
  return text;
}

TomlValue value_of(const toml::node& node) {
  if (const auto* integer = node.as_integer())
    return {TomlValue::Kind::kInteger, std::to_string(integer->get())};
  if (const auto* text = node.as_string()) return {TomlValue::Kind::kString, text->get()};
  return {};
}

}  // namespace

proto::Expected<std::map<std::string, TomlValue>> read_toml(const std::filesystem::path& path) {
  const auto text = read_text(path);
  if (!text) return proto::Unexpected(text.error());
  try {
    const toml::table table = toml::parse(*text, path.string());
    std::map<std::string, TomlValue> out;
    for (const auto& [key, node] : table) out.emplace(std::string(key.str()), value_of(node));
    return out;
  } catch (const toml::parse_error& e) {  // the library reports bad input so
    const auto at = e.source().begin;
    return proto::fail("invalid_config", path.string() + ", line " + std::to_string(at.line) +
                                             ", column " + std::to_string(at.column) + ": " +
                                             std::string(e.description()));
  }
}

std::string toml_string(std::string_view text) {
  std::ostringstream out;
  out << toml::value<std::string>(std::string(text));
  return out.str();
}

}  // namespace kiln::cli
