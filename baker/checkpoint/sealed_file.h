#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <functional>
#include <span>
#include <stop_token>
#include <string>
#include <type_traits>
#include <vector>

#include "proto/expected.h"
#include "proto/sha256.h"

/// A file of a checkpoint has a header that names kind and bake, little-endian values, and a
/// SHA-256 over all of it.
namespace kiln::checkpoint {

using Magic = std::array<char, 8>;
inline constexpr std::uint32_t kMaxTextBytes = 4096;

/// Calls `use` for one piece after the other. Returns false when `use` refuses one, or on a stop
/// request.
template <std::size_t kPiece = 16 << 20, class T, class Use>
bool for_pieces(std::span<T> bytes, const std::stop_token& stop, const Use& use) {
  while (!bytes.empty()) {
    const auto piece = bytes.first(std::min(kPiece, bytes.size()));
    if (stop.stop_requested() || !use(piece)) return false;
    bytes = bytes.subspan(piece.size());
  }
  return true;
}

class SealedWriter {
 public:
  explicit SealedWriter(std::ofstream& out) : out_(out) {}
  void bytes(const void* data, std::size_t n) {
    out_.write(static_cast<const char*>(data), std::streamsize(n));
    hash_.update({static_cast<const char*>(data), n});
  }
  /// Writes the bytes; a stop request ends it early.
  void pieces(std::span<const std::byte> all, const std::stop_token& stop) {
    for_pieces(all, stop, [&](auto piece) {
      bytes(piece.data(), piece.size());
      return true;
    });
  }
  template <class T>
  void value(T v) {
    static_assert(std::is_arithmetic_v<T>);
    bytes(&v, sizeof v);
  }
  void text(const std::string& s) {
    value(std::uint32_t(s.size()));
    bytes(s.data(), s.size());
  }
  void seal() {
    const auto digest = hash_.digest();
    out_.write(reinterpret_cast<const char*>(digest.data()), std::streamsize(digest.size()));
  }

 private:
  std::ofstream& out_;
  proto::Sha256 hash_;
};

/// Reads what SealedWriter wrote. Its functions return false when the file ends or holds something
/// else.
class SealedReader {
 public:
  explicit SealedReader(std::ifstream& in) : in_(in) {}
  bool bytes(void* data, std::size_t n) {
    if (!in_.read(static_cast<char*>(data), std::streamsize(n))) return false;
    hash_.update({static_cast<const char*>(data), n});
    return true;
  }
  template <class T>
  bool value(T& v) {
    static_assert(std::is_arithmetic_v<T>);
    return bytes(&v, sizeof v);
  }
  bool text(std::string& s) {
    std::uint32_t n = 0;
    if (!value(n) || n > kMaxTextBytes) return false;
    s.resize(n);
    return bytes(s.data(), n);
  }
  bool magic(const Magic& expected) {
    Magic found;
    return bytes(found.data(), found.size()) && found == expected;
  }
  bool sealed() {
    const auto expected = hash_.digest();
    auto found = expected;
    in_.read(reinterpret_cast<char*>(found.data()), std::streamsize(found.size()));
    return in_ && found == expected;
  }

 private:
  std::ifstream& in_;
  proto::Sha256 hash_;
};

/// Writes a file: the header, what `fill` writes, and the check sum.
/// Errors: `storage_full`, `io_error`.
proto::Expected<void> write_sealed(const std::filesystem::path&, const Magic&,
                                   const std::string& key,
                                   const std::function<void(SealedWriter&)>& fill);

/// Returns the error of a file that can't be used.
proto::Unexpected unusable(const std::filesystem::path&, const char* what);

}  // namespace kiln::checkpoint
