#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace kiln::lightmap {

/// Hits below this value name a texel; the values from here on say what else a ray has met
/// (Lightmap::hits).
inline constexpr std::uint32_t kFirstMiss = 0xfffffffdu;

/// Holds several words per texel: what its rays met, so that bounces look it up instead of tracing
/// again. The words are zero, and take no memory, until they are first written.
///
/// Copies share the words, and writers do not detach them: a copy would double what is by far the
/// largest plane. Each texel is therefore written by one pass only, and is read by later ones.
/// Different texels may be written from different threads.
class WordPlane {
 public:
  WordPlane() = default;
  WordPlane(std::uint32_t texels, std::uint32_t words);

  /// Returns the number of texels; 0 after drop().
  std::uint32_t size() const { return words_ ? texels_ : 0; }
  std::uint32_t words_per_texel() const { return per_texel_; }
  std::span<const std::uint32_t> of(std::uint32_t texel) const {
    return {words_.get() + std::size_t(texel) * per_texel_, per_texel_};
  }
  std::uint32_t* data() { return words_.get(); }

  /// Returns the bytes of the texels [first, last).
  std::size_t texel_bytes() const { return words_ ? per_texel_ * sizeof(std::uint32_t) : 0; }
  std::span<const std::byte> bytes(std::uint32_t first, std::uint32_t last) const {
    return std::as_bytes(words(first, last));
  }
  std::span<std::byte> bytes(std::uint32_t first, std::uint32_t last) {
    return std::as_writable_bytes(words(first, last));
  }

  /// Keeps the shared words.
  void detach() {}
  /// Gives up this copy of the plane; the memory is free when no other copy is left.
  void drop() { words_.reset(); }

 private:
  std::span<std::uint32_t> words(std::uint32_t first, std::uint32_t last) const {
    return {words_.get() + std::size_t(first) * per_texel_, std::size_t(last - first) * per_texel_};
  }

  std::shared_ptr<std::uint32_t[]> words_;
  std::uint32_t texels_ = 0, per_texel_ = 0;
};

}  // namespace kiln::lightmap
