#pragma once

#include <array>
#include <memory>
#include <string>
#include <string_view>

namespace kiln::proto {

/// Computes SHA-256 (FIPS 180-4) over bytes as they arrive.
class Sha256 {
 public:
  Sha256();
  Sha256(Sha256&&) noexcept;
  Sha256& operator=(Sha256&&) noexcept;
  ~Sha256();

  void update(std::string_view bytes);
  /// Returns the digest. digest() and hex() end the computation.
  std::array<unsigned char, 32> digest();
  std::string hex();  ///< 64 lower-case digits

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

/// Returns the SHA-256 of bytes in memory as 64 lower-case digits.
std::string sha256_hex(std::string_view bytes);

/// Returns whether `text` is a SHA-256 in lower-case hexadecimal.
bool is_sha256(std::string_view text);

}  // namespace kiln::proto
