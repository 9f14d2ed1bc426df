#include "server/base/ids.h"

#include <openssl/rand.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <ctime>
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

std::string rfc3339(std::int64_t ms) {
  const std::time_t seconds = static_cast<std::time_t>(ms / 1000);
  std::tm utc{};
  gmtime_r(&seconds, &utc);
  std::array<char, 40> text{};
  const std::size_t n = std::strftime(text.data(), text.size(), "%Y-%m-%dT%H:%M:%S", &utc);
  std::snprintf(text.data() + n, text.size() - n, ".%03dZ", static_cast<int>(ms % 1000));
  return text.data();
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

std::string now_rfc3339(std::chrono::seconds later) {
  return rfc3339(now_ms() + later.count() * 1000);
}

std::string seconds_after(const std::string& text, std::chrono::seconds later) {
  std::tm utc{};
  const char* rest = ::strptime(text.c_str(), "%Y-%m-%dT%H:%M:%S", &utc);
  if (rest == nullptr || *rest != '.' || std::strlen(rest) != 5) return {};
  const std::int64_t ms = std::strtol(rest + 1, nullptr, 10);
  return rfc3339((static_cast<std::int64_t>(::timegm(&utc)) + later.count()) * 1000 + ms);
}

}  // namespace kiln::base
