#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

namespace kiln::solver::gather {

/// What the gathering rays of each texel met, so that bounces look it up instead of tracing again:
/// a texel's index, kHitSky or kHitNothing per direction, 4 bytes each. Different texels may be
/// written from different threads.
class HitMemory {
 public:
  HitMemory() = default;
  HitMemory(std::uint32_t texels, std::uint32_t directions);

  std::span<std::uint32_t> of(std::uint32_t texel) {
    return {words_.get() + std::size_t(texel) * directions_, directions_};
  }

  /// All hits, for a checkpoint; empty once they are forgotten.
  std::span<std::byte> bytes();
  /// Gives the memory back.
  void forget() { words_.reset(); }

 private:
  struct Free {
    void operator()(std::uint32_t*) const;
  };
  std::unique_ptr<std::uint32_t, Free> words_;
  std::uint32_t texels_ = 0, directions_ = 0;
};

}  // namespace kiln::solver::gather
