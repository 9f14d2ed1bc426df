#pragma once

#include <cstddef>
#include <vector>

struct RTCRay16;

namespace kiln::bench {

/// Listens to the rays that the product hands to Embree: the program defines rtcIntersect16 and
/// rtcOccluded16 itself, notes the packet and passes it on. So the very rays of a pass can be
/// traced again by Embree alone, whatever the solver does to make them. Not thread-safe.
class EmbreeTap {
 public:
  EmbreeTap();
  ~EmbreeTap();
  EmbreeTap(const EmbreeTap&) = delete;
  EmbreeTap& operator=(const EmbreeTap&) = delete;

  void stop();  ///< listening

  std::size_t gather_rays() const;  ///< heard so far
  std::size_t shadow_rays() const;

  /// Traces all packets again, in their order and with their flags, by calls to Embree alone: the
  /// time for putting them where Embree changes them is not counted.
  /// @return CPU seconds of this thread
  double replay() const;

 private:
  struct Packet;
  std::vector<Packet> packets_;
  friend struct TapAccess;
};

/// CPU time of the calling thread, s: work of other programs doesn't count.
double thread_seconds();

}  // namespace kiln::bench
