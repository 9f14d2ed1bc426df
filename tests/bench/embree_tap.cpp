#include "tests/bench/embree_tap.h"

#include <dlfcn.h>
#include <embree3/rtcore.h>

#include <algorithm>
#include <cstring>
#include <ctime>
#include <stdexcept>

namespace kiln::bench {

struct EmbreeTap::Packet {
  alignas(64) int valid[16];
  RTCRay16 rays;
  RTCScene scene;
  RTCIntersectContextFlags flags;
  bool shadow;
};

namespace {

EmbreeTap* listener = nullptr;

template <class Function>
Function embree(const char* name) {
  const auto found = dlsym(RTLD_NEXT, name);
  if (!found) throw std::runtime_error(std::string("Embree has no ") + name);
  return reinterpret_cast<Function>(found);
}
using Intersect = void (*)(const int*, RTCScene, RTCIntersectContext*, RTCRayHit16*);
using Occluded = void (*)(const int*, RTCScene, RTCIntersectContext*, RTCRay16*);
const auto intersect = embree<Intersect>("rtcIntersect16");
const auto occluded = embree<Occluded>("rtcOccluded16");

}  // namespace

struct TapAccess {
  static void note(const int* valid, RTCScene scene, const RTCIntersectContext& context,
                   const RTCRay16& rays, bool shadow) {
    EmbreeTap::Packet& p = listener->packets_.emplace_back();
    std::memcpy(p.valid, valid, sizeof p.valid);
    p.rays = rays;
    p.scene = scene;
    p.flags = context.flags;
    p.shadow = shadow;
  }
  static std::size_t count(const EmbreeTap& tap, bool shadow) {
    std::size_t rays = 0;
    for (const auto& p : tap.packets_)
      if (p.shadow == shadow) rays += std::size_t(std::count(p.valid, p.valid + 16, -1));
    return rays;
  }
};

EmbreeTap::EmbreeTap() {
  listener = this;
}
EmbreeTap::~EmbreeTap() {
  stop();
}
void EmbreeTap::stop() {
  if (listener == this) listener = nullptr;
}
std::size_t EmbreeTap::gather_rays() const {
  return TapAccess::count(*this, false);
}
std::size_t EmbreeTap::shadow_rays() const {
  return TapAccess::count(*this, true);
}

double EmbreeTap::replay() const {
  // As many as stay in the second-level cache, as the product's own packet does.
  constexpr std::size_t kAtOnce = 256;
  std::vector<RTCRayHit16> queries(kAtOnce);
  double seconds = 0;
  for (std::size_t first = 0; first < packets_.size(); first += kAtOnce) {
    const std::size_t count = std::min(kAtOnce, packets_.size() - first);
    for (std::size_t i = 0; i < count; ++i) {
      queries[i].ray = packets_[first + i].rays;
      std::memset(&queries[i].hit, 0xff, sizeof queries[i].hit);
    }
    const double start = thread_seconds();
    for (std::size_t i = 0; i < count; ++i) {
      const Packet& p = packets_[first + i];
      RTCIntersectContext context;
      rtcInitIntersectContext(&context);
      context.flags = p.flags;
      if (p.shadow)
        occluded(p.valid, p.scene, &context, &queries[i].ray);
      else
        intersect(p.valid, p.scene, &context, &queries[i]);
    }
    seconds += thread_seconds() - start;
  }
  return seconds;
}

double thread_seconds() {
  timespec now{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return double(now.tv_sec) + double(now.tv_nsec) * 1e-9;
}

}  // namespace kiln::bench

// The names that the product's calls are linked to, before Embree's own.
void rtcIntersect16(const int* valid, RTCScene scene, RTCIntersectContext* context,
                    RTCRayHit16* query) {
  using namespace kiln::bench;
  if (listener) TapAccess::note(valid, scene, *context, query->ray, false);
  intersect(valid, scene, context, query);
}
void rtcOccluded16(const int* valid, RTCScene scene, RTCIntersectContext* context,
                   RTCRay16* query) {
  using namespace kiln::bench;
  if (listener) TapAccess::note(valid, scene, *context, *query, true);
  occluded(valid, scene, context, query);
}
