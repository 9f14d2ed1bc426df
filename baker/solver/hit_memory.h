#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

namespace kiln::baker {

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
  /// The texel sends no rays: it is interpolated. Until of(texel) is written.
  void leave_out(std::uint32_t texel);
  bool gathers(std::uint32_t texel) const;

  /// All hits, for a checkpoint; empty once they are forgotten.
  std::span<std::byte> bytes();
  /// Gives the memory back. Which texels gather is still known.
  void forget();

 private:
  struct Free {
    void operator()(std::uint32_t*) const;
  };
  std::unique_ptr<std::uint32_t, Free> words_;
  std::uint32_t texels_ = 0, directions_ = 0;
  std::vector<bool> gathers_;  ///< once the hits are forgotten
};

}  // namespace kiln::baker
