#pragma once

#include <algorithm>
#include <cstdint>

#include "baker/lightmap/word_plane.h"

namespace kiln::solver::pairwise {

/// Where the bits of pairs lie, one for each unordered pair of different texels [RTRad 5.2.1]. A
/// texel has those of its pairs with the texels that follow it in the circle of all texels, up to
/// the one opposite. So each has the same number of words, no pair has two bits, and the batch that
/// owns a texel writes its words alone. RTRad finds bits by a mirrored pairing function [eq. 5.4],
/// whose index its program computes in too few bits.
///
/// Where the words are too few for half the circle, only the pairs of nearer texels have a bit.
class PairLayout {
 public:
  struct Place {
    std::uint32_t texel = 0, bit = 0;
  };

  /// @param words of each texel
  PairLayout(std::uint32_t texels, std::uint32_t words)
      : texels_(texels),
        reach_(std::uint32_t(std::min<std::uint64_t>(texels / 2, 32ull * words))) {}

  /// Returns the words that each texel gets of so many bytes, at most as many as all pairs need.
  static std::uint32_t words_for(std::uint32_t texels, std::uint64_t bytes) {
    const std::uint64_t all = (texels / 2 + 31) / 32;
    const std::uint64_t most = bytes / (sizeof(std::uint32_t) * std::max(1u, texels));
    return std::uint32_t(std::min(all, most));
  }

  /// Returns how many of the texels that follow a texel have bits there.
  std::uint32_t reach() const { return reach_; }
  /// Returns the share of all pairs that have a bit.
  double coverage() const {
    return texels_ < 2 ? 1 : std::min(1.0, 2.0 * reach_ / (double(texels_) - 1));
  }
  /// Finds the place of a pair. Returns false when it has none. @param i, j different
  bool find(std::uint32_t i, std::uint32_t j, Place& place) const {
    const std::uint32_t forth = j > i ? j - i : j + texels_ - i, back = texels_ - forth;
    const bool of_i = forth < back || (forth == back && i < j);
    place = of_i ? Place{i, forth - 1} : Place{j, back - 1};
    return place.bit < reach_;
  }

 private:
  std::uint32_t texels_, reach_;
};

/// What is remembered of the pairs. Immutable; callable from many threads.
class SeenPairs {
 public:
  enum class Answer { kUnknown, kApart, kSeen };

  /// @param words outlives this; Lightmap::seen
  explicit SeenPairs(const lightmap::WordPlane& words)
      : words_(words), layout_(words.size(), words.words_per_texel()) {}

  /// kApart: something stands between the two texels, or they turn away from each other.
  Answer ask(std::uint32_t i, std::uint32_t j) const {
    PairLayout::Place at;
    if (!layout_.find(i, j, at)) return Answer::kUnknown;
    return words_.of(at.texel)[at.bit / 32] >> at.bit % 32 & 1 ? Answer::kSeen : Answer::kApart;
  }

 private:
  const lightmap::WordPlane& words_;
  const PairLayout layout_;
};

}  // namespace kiln::solver::pairwise
