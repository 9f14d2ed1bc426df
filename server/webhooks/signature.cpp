#include "server/webhooks/signature.h"

#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <array>
#include <stdexcept>
#include <utility>

#include "proto/text_codes.h"

namespace kiln::webhooks {
namespace {

const unsigned char* bytes_of(std::string_view text) {
  return reinterpret_cast<const unsigned char*>(text.data());
}

}  // namespace

proto::Expected<std::string> webhook_key(std::string_view secret) {
  constexpr std::string_view kPrefix = "whsec_";
  constexpr std::size_t kMin = 24, kMax = 64;
  const auto refuse = [] {
    return proto::fail("invalid_config",
                       "a webhook's secret is whsec_ and 24 to 64 bytes in base64, for instance "
                       "of: openssl rand -base64 32");
  };
  if (!secret.starts_with(kPrefix)) return refuse();
  secret.remove_prefix(kPrefix.size());
  if (secret.size() % 4 != 0 || secret.find_first_of("-_") != std::string_view::npos)
    return refuse();
  auto key = proto::base64_decode(secret);
  if (!key || key->size() < kMin || key->size() > kMax) return refuse();
  return std::move(*key);
}

std::string webhook_signature(std::string_view key, std::string_view id, std::int64_t timestamp,
                              std::string_view body) {
  std::string text(id);
  text.append(".").append(std::to_string(timestamp)).append(".").append(body);
  std::array<unsigned char, 32> digest{};
  unsigned size = digest.size();
  if (HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()), bytes_of(text), text.size(),
           digest.data(), &size) == nullptr)
    throw std::runtime_error("HMAC failed");
  return "v1," + proto::base64_encode({reinterpret_cast<const char*>(digest.data()), size});
}

}  // namespace kiln::webhooks
