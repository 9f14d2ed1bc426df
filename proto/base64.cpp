#include "proto/base64.h"

#include <openssl/evp.h>

namespace kiln::proto {
namespace {

// OpenSSL counts in int; pieces of these lengths end at whole groups of 3 bytes and 4 characters.
constexpr std::size_t kBytes = std::size_t{3} << 20, kCharacters = std::size_t{4} << 20;

const unsigned char* unsigned_bytes(std::string_view text) {
  return reinterpret_cast<const unsigned char*>(text.data());
}

}  // namespace

std::string base64_encode(std::string_view bytes) {
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t at = 0; at < bytes.size(); at += kBytes) {
    const std::string_view piece = bytes.substr(at, kBytes);
    std::basic_string<unsigned char> out((piece.size() + 2) / 3 * 4 + 1, 0);  // and its zero
    const int size =
        EVP_EncodeBlock(out.data(), unsigned_bytes(piece), static_cast<int>(piece.size()));
    text.append(out.begin(), out.begin() + size);
  }
  return text;
}

std::optional<std::string> base64_decode(std::string_view text) {
  constexpr std::string_view kAlphabet =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  // OpenSSL takes blanks at both ends, and padding anywhere.
  const std::size_t padding = text.ends_with("==") ? 2 : text.ends_with("=") ? 1 : 0;
  if (text.size() % 4 != 0 ||
      text.substr(0, text.size() - padding).find_first_not_of(kAlphabet) != std::string_view::npos)
    return std::nullopt;
  std::string bytes;
  bytes.reserve(text.size() / 4 * 3);
  for (std::size_t at = 0; at < text.size(); at += kCharacters) {
    const std::string_view piece = text.substr(at, kCharacters);
    std::basic_string<unsigned char> out(piece.size() / 4 * 3, 0);
    if (EVP_DecodeBlock(out.data(), unsigned_bytes(piece), static_cast<int>(piece.size())) < 0)
      return std::nullopt;
    bytes.append(out.begin(), out.end());
  }
  bytes.resize(bytes.size() - padding);
  return bytes;
}

}  // namespace kiln::proto
