#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <string_view>
#include <vector>

namespace kiln::output::lit {

/// The BIN chunk of a .glb while it grows: pieces that are written one after the other, so that a
/// source of a gigabyte is not copied. Every piece starts at a multiple of 4.
class GlbBinary {
 public:
  /// Offset of the piece. The bytes must outlive this object.
  std::uint64_t append_view(std::string_view bytes) {
    static constexpr std::string_view kZeros("\0\0\0", 3);
    const std::uint64_t at = size_;
    const std::size_t padding = (4 - bytes.size() % 4) % 4;
    pieces_.push_back(bytes);
    pieces_.push_back(kZeros.substr(0, padding));
    size_ += bytes.size() + padding;
    return at;
  }
  std::uint64_t append(std::string bytes) {
    return append_view(owned_.emplace_back(std::move(bytes)));
  }

  std::uint64_t size() const { return size_; }
  const std::vector<std::string_view>& pieces() const { return pieces_; }

 private:
  std::deque<std::string> owned_;  // never moves its elements
  std::vector<std::string_view> pieces_;
  std::uint64_t size_ = 0;
};

}  // namespace kiln::output::lit
