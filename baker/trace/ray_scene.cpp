#include "baker/trace/ray_scene.h"

#include <embree3/rtcore.h>

#include <algorithm>
#include <atomic>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <string>

#include "baker/simd/kernels.h"

namespace kiln::trace {
namespace {

/// The build calls this now and then; returning false ends it.
bool keep_building(void* stop, double) {
  return !static_cast<std::stop_token*>(stop)->stop_requested();
}

/// Embree calls this with what it takes, and below 0 with what it gives back.
bool count_bytes(void* bytes, ssize_t more, bool) {
  *static_cast<std::atomic<std::int64_t>*>(bytes) += more;
  return true;
}

struct LaneMask {
  alignas(64) std::int32_t lane[16];
  explicit LaneMask(std::uint32_t active) {
    for (std::uint32_t i = 0; i < 16; ++i) lane[i] = -std::int32_t(active >> i & 1);
  }
};

/// Sets what is the same for all rays.
void set_usual(RTCRay16& out) {
  std::memset(out.tnear, 0, sizeof out.tnear);
  std::memset(out.time, 0, sizeof out.time);
  std::memset(out.mask, 0xff, sizeof out.mask);
  std::memset(out.flags, 0, sizeof out.flags);
}

void load_rays(const RayPacket& in, RTCRay16& out) {
  std::memcpy(out.org_x, in.org_x, sizeof out.org_x);
  std::memcpy(out.org_y, in.org_y, sizeof out.org_y);
  std::memcpy(out.org_z, in.org_z, sizeof out.org_z);
  std::memcpy(out.dir_x, in.dir_x, sizeof out.dir_x);
  std::memcpy(out.dir_y, in.dir_y, sizeof out.dir_y);
  std::memcpy(out.dir_z, in.dir_z, sizeof out.dir_z);
  std::memcpy(out.tfar, in.t_far, sizeof out.tfar);
  set_usual(out);
}

/// Returns the lanes that met something. Embree may write to lanes that are not valid, too.
std::uint32_t blocked_lanes(const RTCRay16& query, const std::int32_t (&valid)[16]) {
  std::uint32_t blocked = 0;
  for (std::uint32_t i = 0; i < 16; ++i)
    if (valid[i] != 0 && query.tfar[i] < 0) blocked |= 1u << i;
  return blocked;
}

RTCIntersectContext make_context(bool coherent) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags =
      coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  return context;
}

}  // namespace

struct RayScene::Impl {
  std::atomic<std::int64_t> bytes{0};  ///< that the device holds; it outlives the device
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  const simd::Kernels& kernels = simd::kernels();
  float least_offset = 0;  ///< m

  Impl() = default;
  Impl(const Impl&) = delete;
  Impl& operator=(const Impl&) = delete;
  ~Impl() {
    if (scene) rtcReleaseScene(scene);
    if (device) rtcReleaseDevice(device);
  }
};

void RayPacket::set(std::uint32_t i, math::Vec3 origin, math::Vec3 direction, float far) {
  org_x[i] = origin.x, org_y[i] = origin.y, org_z[i] = origin.z;
  dir_x[i] = direction.x, dir_y[i] = direction.y, dir_z[i] = direction.z;
  t_far[i] = far;
}

RayScene::RayScene(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RayScene::RayScene(RayScene&&) noexcept = default;
RayScene& RayScene::operator=(RayScene&&) noexcept = default;
RayScene::~RayScene() = default;

proto::Expected<RayScene> RayScene::build(const scene::Scene& scene, std::stop_token stop) {
  auto impl = std::make_unique<Impl>();
  // One thread: jobs build side by side on the pool's threads, not on a second pool behind it.
  impl->device = rtcNewDevice("threads=1");
  if (!impl->device) throw std::runtime_error("Embree gave no device");
  rtcSetDeviceMemoryMonitorFunction(impl->device, count_bytes, &impl->bytes);
  impl->scene = rtcNewScene(impl->device);
  rtcSetSceneFlags(impl->scene, RTC_SCENE_FLAG_ROBUST);
  const RTCGeometry mesh = rtcNewGeometry(impl->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<math::Vec3*>(
      rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                              sizeof(math::Vec3), scene.positions.size()));
  auto* indices = static_cast<std::array<std::uint32_t, 3>*>(
      rtcSetNewGeometryBuffer(mesh, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                              sizeof(std::uint32_t) * 3, scene.triangles.size()));
  if (!vertices || !indices) {
    rtcReleaseGeometry(mesh);
    throw std::bad_alloc();
  }
  std::copy(scene.positions.begin(), scene.positions.end(), vertices);
  std::copy(scene.triangles.begin(), scene.triangles.end(), indices);
  rtcCommitGeometry(mesh);
  rtcAttachGeometryByID(impl->scene, mesh, 0);
  rtcReleaseGeometry(mesh);
  rtcSetSceneProgressMonitorFunction(impl->scene, keep_building, &stop);
  rtcCommitScene(impl->scene);
  if (stop.stop_requested()) return proto::canceled();
  if (const RTCError error = rtcGetDeviceError(impl->device); error != RTC_ERROR_NONE) {
    if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
    throw std::runtime_error("Embree error " + std::to_string(error));
  }
  rtcSetSceneProgressMonitorFunction(impl->scene, nullptr, nullptr);

  math::Vec3 low = scene.positions.front(), high = low;
  for (const math::Vec3& p : scene.positions) {
    low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
    high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
  }
  impl->least_offset = max_abs(high - low) * kOffset;
  return RayScene(std::move(impl));
}

void RayScene::closest(const RayPacket& rays, HitPacket& hits, bool coherent) const {
  RTCRayHit16 query;
  load_rays(rays, query.ray);
  std::memset(query.hit.geomID, 0xff, sizeof query.hit.geomID);
  std::memset(query.hit.instID, 0xff, sizeof query.hit.instID);
  std::memset(query.hit.u, 0, sizeof query.hit.u);
  std::memset(query.hit.v, 0, sizeof query.hit.v);
  const LaneMask valid(rays.active);
  RTCIntersectContext context = make_context(coherent);
  rtcIntersect16(valid.lane, impl_->scene, &context, &query);
  for (std::uint32_t i = 0; i < 16; ++i) {
    // There is one geometry, so its number is either 0 or RTC_INVALID_GEOMETRY_ID, all ones.
    hits.triangle[i] = query.hit.geomID[i] == 0 ? query.hit.primID[i] : kNoHit;
    hits.u[i] = query.hit.u[i];
    hits.v[i] = query.hit.v[i];
    hits.t[i] = query.ray.tfar[i];
    // Embree's normal follows the right-hand rule, as ours does.
    hits.back[i] = query.hit.Ng_x[i] * rays.dir_x[i] + query.hit.Ng_y[i] * rays.dir_y[i] +
                       query.hit.Ng_z[i] * rays.dir_z[i] >
                   0;
  }
}

std::uint32_t RayScene::occluded(const RayPacket& rays, bool coherent) const {
  RTCRay16 query;
  load_rays(rays, query);
  const LaneMask valid(rays.active);
  RTCIntersectContext context = make_context(coherent);
  rtcOccluded16(valid.lane, impl_->scene, &context, &query);
  return blocked_lanes(query, valid.lane);
}

std::uint32_t RayScene::blocked(const SegmentPacket& segments, bool coherent) const {
  simd::SegmentRays rays;
  impl_->kernels.shorten(segments.from, segments.to, impl_->least_offset, kOffset, rays);
  std::fill(rays.valid + segments.count, rays.valid + 16, 0);
  RTCRay16 query;
  std::memcpy(query.org_x, rays.origin[0], sizeof query.org_x);
  std::memcpy(query.org_y, rays.origin[1], sizeof query.org_y);
  std::memcpy(query.org_z, rays.origin[2], sizeof query.org_z);
  std::memcpy(query.dir_x, rays.direction[0], sizeof query.dir_x);
  std::memcpy(query.dir_y, rays.direction[1], sizeof query.dir_y);
  std::memcpy(query.dir_z, rays.direction[2], sizeof query.dir_z);
  std::memcpy(query.tfar, rays.far, sizeof query.tfar);
  set_usual(query);
  RTCIntersectContext context = make_context(coherent);
  rtcOccluded16(rays.valid, impl_->scene, &context, &query);
  return blocked_lanes(query, rays.valid);
}

std::uint64_t RayScene::memory_bytes() const {
  return std::uint64_t(std::max<std::int64_t>(impl_->bytes, 0));
}

std::uint64_t RayScene::build_bytes(const scene::Scene& scene) {
  constexpr std::uint64_t kVertex = 12, kTriangle = 300, kLeast = std::uint64_t{1} << 20;
  return kLeast + scene.positions.size() * kVertex + scene.triangles.size() * kTriangle;
}

float RayScene::offset(math::Vec3 position) const {
  return std::max(impl_->least_offset, max_abs(position) * kOffset);
}

math::Vec3 RayScene::offset_origin(math::Vec3 position, math::Vec3 geometric_normal,
                                   math::Vec3 centroid) const {
  const float offset = this->offset(position);
  const math::Vec3 inwards = centroid - position;
  const float to_centroid = length(inwards);
  const float share = to_centroid > offset ? offset / to_centroid : 1.f;
  return position + geometric_normal * offset + inwards * share;
}

}  // namespace kiln::trace
