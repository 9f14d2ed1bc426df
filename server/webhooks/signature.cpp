#include "server/webhooks/signature.h"

#include <openssl/evp.h>
#include <openssl/hmac.h>

#include <algorithm>
#include <array>
#include <stdexcept>
#include <vector>

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
  const auto padding = static_cast<std::size_t>(std::count(secret.begin(), secret.end(), '='));
  if (secret.size() % 4 != 0 || secret.size() > 2 * kMax || padding > 2) return refuse();
  std::vector<unsigned char> key(secret.size() / 4 * 3);
  const int size = EVP_DecodeBlock(key.data(), bytes_of(secret), static_cast<int>(secret.size()));
  if (size < static_cast<int>(padding)) return refuse();
  key.resize(static_cast<std::size_t>(size) - padding);
  if (key.size() < kMin || key.size() > kMax) return refuse();
  return std::string(key.begin(), key.end());
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
  std::array<unsigned char, 45> base64{};  // four characters for three bytes, and a zero
  const int length = EVP_EncodeBlock(base64.data(), digest.data(), static_cast<int>(size));
  return "v1," + std::string(base64.begin(), base64.begin() + length);
}

}  // namespace kiln::webhooks
