#pragma once

#include <cstdint>
#include <stop_token>
#include <vector>

#include "baker/atlas/clip.h"
#include "baker/exec/stop.h"

namespace kiln::atlas {

inline constexpr std::uint32_t kBlock = 8;  ///< rows of a band, and side of a texel block

/// Cuts the triangles of an atlas into fragments, page by page, band of 8 rows by band. Memory is
/// bounded by the triangles and one band, whatever the page's size. After a stop its content is
/// undefined.
class BandSweep {
 public:
  BandSweep(const Atlas&, std::size_t max_fragments, std::stop_token);

  std::uint32_t bands() const { return bands_; }
  /// Returns the triangles without area on their page. They have no fragments.
  const std::vector<std::uint32_t>& flat_triangles() const { return flat_; }

  /// Moves on to the next band in (page, band) order. Its fragments are sorted by texel, then by
  /// the first row of their triangle and its index. Returns false when a band holds more than
  /// max_fragments, or when stopped.
  bool next();
  std::uint32_t page() const { return page_; }
  std::uint32_t band() const { return band_; }
  const std::vector<Fragment>& fragments() const { return sorted_; }

 private:
  void start_triangles();
  bool cut_active();
  void sort_by_texel();

  const Atlas& atlas_;
  exec::StopPoll stopped_;
  std::size_t max_fragments_ = 0;
  std::uint32_t bands_ = 0;  ///< per page
  std::uint32_t page_ = 0, band_ = 0, step_ = 0;
  std::vector<std::uint32_t> first_;   ///< per (page, band): the first entry in order_
  std::vector<std::uint32_t> order_;   ///< triangles by the band that they start in
  std::vector<std::uint32_t> active_;  ///< triangles that reach the current band
  std::vector<std::uint32_t> flat_;
  std::vector<Fragment> fragments_, sorted_;
  std::vector<std::uint32_t> offsets_;
};

}  // namespace kiln::atlas
