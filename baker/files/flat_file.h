#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "proto/expected.h"

namespace kiln::files {

/// A flat file holds arrays of plain records and can be mapped. A process hands it to another, or
/// keeps it for a later one. It is little-endian, like the machines that Lightkiln runs on:
///
///   - header: "LKILNFLT", kind u32, version u32, key (64 bytes), sections u32, 0 u32, bytes u64
///   - table, an entry for each section: record bytes u32, 0 u32, offset u64, count u64
///   - sections in the table's order, each at the next multiple of 64, with zeros between
///
/// The same arrays have only one valid encoding, and a reader accepts no other. So sections cannot
/// overlap, and their places follow from their sizes.
enum class FlatKind : std::uint32_t { kScene = 1, kLitRequest = 2 };

struct FlatHeader {
  FlatKind kind = FlatKind::kScene;
  std::uint32_t version = 0;
  std::string key;  ///< names what the content was made from: 64 characters
};

/// An array to write. The bytes must outlive the call that takes it.
struct FlatSection {
  std::uint32_t record_bytes = 1;
  std::string_view bytes;
};

template <class T>
FlatSection flat_section(const std::vector<T>& records) {
  static_assert(std::is_trivially_copyable_v<T> && std::endian::native == std::endian::little);
  return {sizeof(T), {reinterpret_cast<const char*>(records.data()), records.size() * sizeof(T)}};
}

/// Writes the file from the descriptor's current offset on. Errors: `storage_full`, `io_error`.
proto::Expected<void> write_flat(int fd, const FlatHeader&, std::span<const FlatSection>);

/// An open flat file, whose header and table were checked against its length. It refers to the
/// bytes and does not own them.
class FlatFile {
 public:
  /// Opens a flat file. Any bytes are safe to open. `record_bytes` has one entry per section that
  /// the file must have. Errors: `bad_document`.
  static proto::Expected<FlatFile> open(std::string_view bytes, const FlatHeader&,
                                        std::span<const std::uint32_t> record_bytes);

  std::string_view bytes(std::size_t section) const { return sections_[section]; }
  /// Returns a copy of a section's records, since those in the file may lie unaligned. Requires the
  /// record size that open() checked.
  template <class T>
  std::vector<T> records(std::size_t section) const {
    std::vector<T> out;
    copy_records(section, out, {});
    return out;
  }
  /// Copies the records of a section, which may hold gigabytes, into an empty vector. Returns false
  /// when stopped; the vector then holds the first of them.
  template <class T>
  bool copy_records(std::size_t section, std::vector<T>& out, const std::stop_token& stop) const {
    static_assert(std::is_trivially_copyable_v<T>);
    constexpr std::size_t kPiece = std::max<std::size_t>((std::size_t(1) << 20) / sizeof(T), 1);
    const std::string_view from = sections_[section];
    const std::size_t count = from.size() / sizeof(T);
    out.reserve(count);
    for (std::size_t done = 0; done < count;) {
      if (stop.stop_requested()) return false;
      const std::size_t piece = std::min(kPiece, count - done);
      out.resize(done + piece);  // the new records are still in the cache when the copy comes
      std::memcpy(static_cast<void*>(out.data() + done), from.data() + done * sizeof(T),
                  piece * sizeof(T));
      done += piece;
    }
    return true;
  }

 private:
  std::vector<std::string_view> sections_;
};

/// Returns the error for a file that a reader can't use. Its code is `bad_document`.
proto::Unexpected bad_flat_file(const std::string& why);

}  // namespace kiln::files
