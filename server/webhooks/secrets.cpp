#include "server/webhooks/secrets.h"

#include <algorithm>
#include <sstream>

#include "proto/files.h"
#include "server/http/head.h"
#include "server/webhooks/signature.h"

namespace kiln::webhooks {
namespace {

constexpr std::uint64_t kMaxFileBytes = 1 << 20;

bool is_name(std::string_view text) {
  return !text.empty() && std::count(text.begin(), text.end(), '/') <= 1 &&
         std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                  std::string_view("._-/").find(c) != std::string_view::npos;
         });
}

}  // namespace

proto::Expected<WebhookSecrets> WebhookSecrets::parse(const std::string& text) {
  WebhookSecrets out;
  std::istringstream lines(text);
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    const std::string_view content =
        http::trim_blanks(std::string_view(line).substr(0, line.find('\r')));
    if (content.empty() || content.front() == '#') continue;
    const auto equals = content.find('=');
    const std::string name(http::trim_blanks(content.substr(0, equals)));
    const auto at = [&] { return "line " + std::to_string(number) + ": "; };
    if (equals == std::string_view::npos || !is_name(name))
      return proto::fail("invalid_config",
                         at() + "it must be NAME = SECRET or TENANT/NAME = SECRET");
    auto key = webhook_key(http::trim_blanks(content.substr(equals + 1)));
    if (!key) return proto::fail("invalid_config", at() + key.error().message);
    out.keys_[name].push_back(std::move(*key));
  }
  return out;
}

proto::Expected<WebhookSecrets> WebhookSecrets::read(const std::filesystem::path& path) {
  auto text = proto::read_file(path, kMaxFileBytes);
  if (!text) return proto::Unexpected(text.error());
  auto secrets = parse(*text);
  if (secrets) return secrets;
  return proto::fail(secrets.error().code, path.string() + ", " + secrets.error().message);
}

std::vector<std::string> WebhookSecrets::keys(const std::string& tenant,
                                              const std::string& name) const {
  for (const std::string& full : {tenant + "/" + name, name})
    if (const auto found = keys_.find(full); found != keys_.end()) return found->second;
  return {};
}

}  // namespace kiln::webhooks
