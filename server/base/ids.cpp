#include "server/base/ids.h"

#include <openssl/rand.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <stdexcept>

namespace kiln::base {
namespace {

// Crockford's base 32 in lower case: no i, l, o, u, which are misread.
constexpr std::string_view kDigits = "0123456789abcdefghjkmnpqrstvwxyz";

std::int64_t now_ms() {
  using namespace std::chrono;
  return duration_cast<milliseconds>(system_clock::now().time_since_epoch()).count();
}

template <std::size_t Count>
void add_random_digits(std::string& text) {
  std::array<unsigned char, Count> random{};
  if (RAND_bytes(random.data(), static_cast<int>(random.size())) != 1)
    throw std::runtime_error("no random bytes");
  for (const unsigned char b : random) text += kDigits[b & 31];
}

}  // namespace

std::string new_id(std::string_view prefix) {
  std::string id(prefix);
  auto time = static_cast<std::uint64_t>(now_ms());
  for (int shift = 45; shift >= 0; shift -= 5) id += kDigits[(time >> shift) & 31];
  add_random_digits<16>(id);
  return id;
}

std::string new_secret(std::string_view prefix) {
  std::string secret(prefix);
  add_random_digits<52>(secret);
  return secret;
}

bool is_id(std::string_view text, std::string_view prefix) {
  return text.size() == prefix.size() + 26 && text.starts_with(prefix) &&
         std::all_of(text.begin() + static_cast<std::ptrdiff_t>(prefix.size()), text.end(),
                     [](char c) { return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z'); });
}

}  // namespace kiln::base
