#include "baker/solver/gather.h"

#include <array>
#include <bit>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <limits>
#include <memory>
#include <new>
#include <numeric>
#include <vector>

#include "baker/solver/coarse_sites.h"
#include "baker/solver/direct.h"
#include "baker/solver/footprint.h"
#include "baker/solver/sobol.h"

namespace kiln::baker {
namespace {

/// Fewest directions that feed the bounces before a final gather.
constexpr std::uint32_t kMinFeedbackSamples = 16;
/// Texels with less of their footprint in view than this borrow their neighbours' radiosity.
constexpr float kHiddenShare = 0.1f;
/// Bounces after which most scenes have converged; for the estimate of progress only.
constexpr double kTypicalBounces = 8;
/// From this many samples on, sixteen neighbouring strata make a narrow cone of rays.
constexpr std::uint32_t kCoherentSamples = 256;

/// Radiosity as the look-ups read it: one aligned load.
struct alignas(16) Radiosity {
  float r = 0, g = 0, b = 0, pad = 0;
};

/// Groups the points of a (0,2)-net by elementary cells of 16 points each, as square as can be.
/// Owen scrambling maps cells to cells, so the groups stay narrow for every texel's own scramble.
std::vector<std::uint32_t> cell_order(std::uint32_t count) {
  std::vector<std::uint32_t> order(count);
  std::iota(order.begin(), order.end(), 0u);
  if (!std::has_single_bit(count) || count < kCoherentSamples) return order;
  const int bits = std::countr_zero(count) - 4, x_bits = (bits + 1) / 2, y_bits = bits / 2;
  const auto cell = [&](std::uint32_t i) {
    const SobolPoint p = sobol(i);
    const std::uint32_t y = y_bits > 0 ? p.y >> (32 - y_bits) : 0;
    return (p.x >> (32 - x_bits)) << y_bits | y;
  };
  std::stable_sort(order.begin(), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return cell(a) < cell(b); });
  return order;
}

/// The directions of a gather, in the order in which they are traced.
struct DirectionSet {
  std::vector<std::uint32_t> x, y;  ///< Sobol points, fractions of 2^32, padded to whole packets
  std::uint32_t count = 0;
  bool coherent = false;

  explicit DirectionSet(std::uint32_t n)
      : count(n), coherent(std::has_single_bit(n) && n >= kCoherentSamples) {
    for (std::uint32_t i : cell_order(n)) {
      x.push_back(sobol(i).x);
      y.push_back(sobol(i).y);
    }
    x.resize((n + 15) / 16 * 16);
    y.resize(x.size());
  }
  std::uint32_t size() const { return count; }
};

/// Rays that a point needs before it can be called hidden.
constexpr std::uint32_t kProbeRays = 4;

/// What the rays from each point of a footprint met. Points from which every ray met a back face
/// are hidden.
struct PointCensus {
  std::uint32_t rays[Footprint::kPoints] = {}, behind[Footprint::kPoints] = {};

  bool met_backs() const {
    return std::any_of(behind, behind + Footprint::kPoints, std::identity());
  }
  float visible_share() const {
    std::uint32_t hidden = 0;
    for (std::uint32_t i = 0; i < Footprint::kPoints; ++i)
      hidden += rays[i] > 0 && behind[i] == rays[i];
    return 1 - float(hidden) / Footprint::kPoints;
  }
};

/// A texel that lies hidden, whose radiosity for look-ups comes from the texels around it: a ray
/// that meets the surface beside it must not read the dark beneath a block that stands there.
struct Repair {
  std::uint32_t texel = 0;
  std::uint32_t count = 0;
  std::array<std::uint32_t, 8> neighbour{};
};

/// Zeroed words whose pages the system gives when they are first written, which is in the batches,
/// where a cancel is seen: clearing a gigabyte at once takes a second.
class LazyWords {
 public:
  LazyWords() = default;
  explicit LazyWords(std::size_t count)
      : words_(static_cast<std::uint32_t*>(std::calloc(count, sizeof(std::uint32_t)))),
        count_(count) {
    if (count > 0 && !words_) throw std::bad_alloc();
  }
  std::span<std::uint32_t> all() { return {words_.get(), count_}; }

 private:
  struct Free {
    void operator()(std::uint32_t* p) const { std::free(p); }
  };
  std::unique_ptr<std::uint32_t, Free> words_;
  std::size_t count_ = 0;
};

void set_plane(const float (&from)[3][16], float (&x)[16], float (&y)[16], float (&z)[16]) {
  std::memcpy(x, from[0], sizeof x);
  std::memcpy(y, from[1], sizeof y);
  std::memcpy(z, from[2], sizeof z);
}

class GatherSolver final : public Solver {
 public:
  GatherSolver(const SolverInput& in, std::uint64_t hit_budget)
      : in_(in),
        direct_(in_),
        sites_(in.texels),
        feedback_(feedback_samples(in, hit_budget)),
        full_(in.settings.samples),
        probe_(kProbeRays * Footprint::kPoints),
        kernels_(kernels()),
        final_gather_(feedback_.size() < full_.size()),
        needs_rays_(in.settings.bounces > 0 || !is_black(in.scene.sky)),
        coarse_(in.settings.coarse_indirect) {
    if (needs_rays_) hits_ = LazyWords(std::size_t(in.texels.size()) * feedback_.size());
  }

  std::uint32_t max_passes() const override {
    return needs_rays_ ? first_bounce() + in_.settings.bounces : 1;
  }

  double total_work() const override {
    if (!needs_rays_) return direct_work();
    const double trace = trace_work(feedback_) + (coarse_ ? refine_work() : 0);
    const double final = final_gather_ ? trace_work(full_) : 0;
    return direct_work() + trace + final + kTypicalBounces * look_up_work();
  }

  std::optional<Pass> next(std::span<const proto::PassReport> done) const override {
    Pass pass;
    pass.index = static_cast<std::uint32_t>(done.size());
    if (done.empty()) {
      pass.name = "direct";
      pass.work = direct_work();
      return pass;
    }
    if (!needs_rays_) return std::nullopt;
    if (done.size() == 1) {
      pass.name = kTrace;
      pass.work = trace_work(feedback_);
      pass.fills_state = true;
      return pass;
    }
    if (done.size() < first_bounce()) {
      pass.name = kRefine;
      pass.work = refine_work();
      pass.fills_state = true;
      return pass;
    }
    if (done.back().name == kFinal) return std::nullopt;
    const std::uint32_t bounces = bounces_in(done);
    const std::uint32_t limit = in_.settings.bounces;
    if (!final_gather_) {
      const bool converged = bounces > 0 && done.back().residual <= in_.settings.tolerance;
      if (converged || bounces == limit) return std::nullopt;
    } else if (bounces + 1 >= limit ||
               (bounces > 1 && tail(done) * done.back().residual <= in_.settings.tolerance)) {
      pass.name = kFinal;
      pass.work = trace_work(full_);
      return pass;
    }
    pass.name = "bounce";
    pass.work = look_up_work();
    pass.batch_texels = 4096;
    return pass;
  }

  void begin(const Pass& pass, const Lightmap& before) override;

  std::uint64_t run(const Pass& pass, const Lightmap& before, TexelRange range,
                    Lightmap& after) override {
    if (pass.name == "direct") return direct_.run(range, after.direct);
    if (pass.name == kTrace) return trace(range, after);
    if (pass.name == kRefine) return refine(range, before, after);
    if (pass.name == kFinal) return gather(range, after);
    for (std::uint32_t t = range.begin; t < range.end; ++t)
      if (gathers(t)) after.indirect[t] = look_up(hits_of(t));
    return 0;
  }

  void finish(const Pass& pass, const Lightmap&, Lightmap& after) override {
    if (pass.name == "direct" || !coarse_) return;
    for (std::uint32_t t = 0; t < in_.texels.size(); ++t) {
      // What the sites were compared by is no bounce yet.
      if (pass.name == kRefine) after.indirect[t] = {};
      if (gathers(t)) continue;
      const CoarseSites::Sites sites = sites_.around(t);
      interpolate(sites, after.sky, t);
      if (pass.name != kRefine) interpolate(sites, after.indirect, t);
    }
  }

  std::span<std::byte> state() override { return std::as_writable_bytes(hits_.all()); }

  double extrapolate(std::span<const proto::PassReport> done, const Lightmap& before_last,
                     Lightmap& last) const override;

 private:
  static constexpr const char* kTrace = "trace";
  static constexpr const char* kRefine = "refine";
  static constexpr const char* kFinal = "final gather";

  /// Passes before the first bounce.
  std::uint32_t first_bounce() const { return coarse_ ? 3 : 2; }
  std::uint32_t bounces_in(std::span<const proto::PassReport> done) const {
    return static_cast<std::uint32_t>(done.size()) - first_bounce();
  }

  double direct_work() const {
    return double(in_.lights.area().empty() ? 0 : in_.settings.direct_samples) +
           double(in_.lights.punctual().size() * Footprint::kPoints);
  }
  /// Every fourth texel is a site, and charts are edged by texels without sites around them.
  double trace_work(const DirectionSet& set) const { return set.size() * (coarse_ ? 0.35 : 1); }
  double refine_work() const { return feedback_.size() * 0.1; }
  /// A look-up costs about a fortieth of a ray.
  double look_up_work() const { return trace_work(feedback_) / 40; }

  void find_repairs(const Lightmap&);

  static std::uint32_t feedback_samples(const SolverInput& in, std::uint64_t budget) {
    const std::uint32_t wanted = in.settings.samples;
    const std::uint64_t affordable =
        budget / (sizeof(std::uint32_t) * std::max(1u, in.texels.size()));
    if (wanted <= affordable) return wanted;
    const std::uint64_t fitting = std::bit_floor(std::max<std::uint64_t>(1, affordable));
    return std::min(wanted, std::max(kMinFeedbackSamples, std::uint32_t(fitting)));
  }

  /// Sum of the updates that the bounces after the last one would add, as a factor on the last
  /// update: they form a geometric series whose ratio the last two updates tell.
  double tail(std::span<const proto::PassReport> done) const {
    const auto update = [](const proto::PassReport& p) { return p.residual * p.mean_lx; };
    const std::uint32_t left = in_.settings.bounces - bounces_in(done);
    const double ratio = update(done.back()) / update(done[done.size() - 2]);
    if (!(ratio > 0) || !(ratio < 1)) return 0;
    return ratio * (1 - std::pow(ratio, left)) / (1 - ratio);
  }

  /// Follows the directions of one texel. `hits` receives one entry per direction.
  PointCensus follow(std::uint32_t texel, const DirectionSet& set,
                     std::span<std::uint32_t> hits) const;

  /// Follows the directions, and tells the share of the footprint's points that are not hidden;
  /// with more rays than asked for where few of them met back faces.
  float visible_share(std::uint32_t texel, const DirectionSet& set,
                      std::span<std::uint32_t> hits) const {
    const PointCensus census = follow(texel, set, hits);
    if (!census.met_backs()) return 1;
    if (set.size() >= probe_.size()) return census.visible_share();
    std::array<std::uint32_t, kProbeRays * Footprint::kPoints> ignored;
    return follow(texel, probe_, ignored).visible_share();
  }

  Rgb look_up(std::span<const std::uint32_t> hits) const {
    float sum[4] = {0, 0, 0, 0};
    for (const std::uint32_t h : hits) {
      if (h >= kHitSky) continue;  // or kHitNothing
      const Radiosity& b = radiosity_[h];
      sum[0] += b.r, sum[1] += b.g, sum[2] += b.b;
    }
    const float scale = 1 / float(hits.size());
    return Rgb{sum[0], sum[1], sum[2]} * scale;
  }

  /// E = π · mean L over cosine-distributed directions.
  Rgb sky_light(std::span<const std::uint32_t> hits) const {
    std::uint32_t open = 0;
    for (const std::uint32_t h : hits) open += h == kHitSky;
    return in_.scene.sky * (kPi * float(open) / float(hits.size()));
  }

  std::span<std::uint32_t> hits_of(std::uint32_t texel) {
    const std::size_t n = feedback_.size();
    return hits_.all().subspan(texel * n, n);
  }
  /// Whether the texel has hits of its own; otherwise it is interpolated.
  bool gathers(std::uint32_t texel) { return hits_of(texel).front() != kHitNone; }

  void trace_texel(std::uint32_t t, Lightmap& after) {
    const std::span<std::uint32_t> hits = hits_of(t);
    after.validity[t] = visible_share(t, feedback_, hits);
    after.sky[t] = sky_light(hits);
  }

  std::uint64_t trace(TexelRange range, Lightmap& after) {
    std::uint64_t traced = 0;
    for (std::uint32_t t = range.begin; t < range.end; ++t) {
      if (coarse_ && sites_.around(t).count > 0) {
        hits_of(t).front() = kHitNone;
        continue;
      }
      trace_texel(t, after);
      // The first bounce of direct light, for refine() to compare the sites by.
      if (coarse_) after.indirect[t] = look_up(hits_of(t));
      ++traced;
    }
    return traced * feedback_.size();
  }

  /// Traces the texels whose sites do not agree.
  std::uint64_t refine(TexelRange range, const Lightmap& before, Lightmap& after) {
    std::uint64_t traced = 0;
    for (std::uint32_t t = range.begin; t < range.end; ++t) {
      const CoarseSites::Sites sites = sites_.around(t);
      if (sites.count == 0 || sites_.agree(sites, before)) continue;
      trace_texel(t, after);
      ++traced;
    }
    return traced * feedback_.size();
  }

  std::uint64_t gather(TexelRange range, Lightmap& after) {
    std::vector<std::uint32_t> hits(full_.size());
    std::uint64_t traced = 0;
    for (std::uint32_t t = range.begin; t < range.end; ++t) {
      if (!gathers(t)) continue;
      follow(t, full_, hits);
      after.sky[t] = sky_light(hits);
      after.indirect[t] = in_.settings.bounces > 0 ? look_up(hits) : Rgb{};
      ++traced;
    }
    return traced * full_.size();
  }

  static void interpolate(const CoarseSites::Sites& sites, std::vector<Rgb>& plane,
                          std::uint32_t texel) {
    Rgb sum;
    for (const std::uint32_t s : sites.all()) sum += plane[s];
    plane[texel] = sum * (1 / float(sites.count));
  }

  const SolverInput in_;
  DirectLight direct_;
  const CoarseSites sites_;
  DirectionSet feedback_, full_, probe_;
  const Kernels& kernels_;
  bool final_gather_, needs_rays_, coarse_;
  LazyWords hits_;  ///< feedback_.size() per texel; kHitNone: interpolated
  std::vector<Repair> repairs_;
  bool knows_repairs_ = false;        ///< from the first bounce on
  std::vector<Radiosity> radiosity_;  ///< B of the pass before, lx
};

void GatherSolver::find_repairs(const Lightmap& light) {
  repairs_.clear();
  for (std::uint32_t t = 0; t < in_.texels.front_count; ++t) {
    if (light.validity[t] >= kHiddenShare) continue;
    Repair repair;
    repair.texel = t;
    const TextureGroup::Page& page = in_.texels.pages[in_.texels.page[t]];
    for (int k = 0; k < 9; ++k) {
      const int x = in_.texels.x[t] + k % 3 - 1, y = in_.texels.y[t] + k / 3 - 1;
      if (x < 0 || y < 0 || x >= int(page.width) || y >= int(page.height)) continue;
      const std::int32_t n = page.texel_at[std::size_t(y) * page.width + x];
      if (n == kNoTexel || in_.texels.chart[n] != in_.texels.chart[t]) continue;
      if (light.validity[n] >= kHiddenShare) repair.neighbour[repair.count++] = std::uint32_t(n);
    }
    if (repair.count > 0) repairs_.push_back(repair);
  }
}

void GatherSolver::begin(const Pass& pass, const Lightmap& before) {
  if (pass.name == "direct" || pass.name == kRefine) return;
  if (pass.name == kTrace && !coarse_) return;
  if (pass.name != kTrace && !knows_repairs_) {
    find_repairs(before);
    knows_repairs_ = true;
  }
  radiosity_.resize(in_.texels.size());
  for (std::uint32_t t = 0; t < in_.texels.size(); ++t) {
    // E is the mean over the footprint; rays from outside meet its visible part only.
    const float visible = before.validity[t];
    const Rgb b =
        in_.texels.albedo[t] * before.irradiance(t) * (visible >= kHiddenShare ? 1 / visible : 1.f);
    radiosity_[t] = {b.r, b.g, b.b, 0};
  }
  for (const Repair& repair : repairs_) {
    Radiosity sum;
    for (std::uint32_t i = 0; i < repair.count; ++i) {
      const Radiosity& b = radiosity_[repair.neighbour[i]];
      sum.r += b.r, sum.g += b.g, sum.b += b.b;
    }
    const float scale = 1 / float(repair.count);
    radiosity_[repair.texel] = {sum.r * scale, sum.g * scale, sum.b * scale, 0};
  }
}

PointCensus GatherSolver::follow(std::uint32_t texel, const DirectionSet& set,
                                 std::span<std::uint32_t> hits) const {
  const PointFrames frames = Footprint(in_, texel).frames();
  const TexelGrid grid = in_.lookup.grid();
  const std::uint32_t seed = texel_seed(in_, texel, Purpose::kGather), seed_y = hash(seed);
  PointCensus census;
  RayPacket rays;
  HitPacket met;
  Directions to;
  alignas(64) std::uint32_t found[16];
  alignas(64) float pick[16];
  set_plane(frames.origin, rays.org_x, rays.org_y, rays.org_z);
  std::fill_n(rays.t_far, 16, std::numeric_limits<float>::infinity());
  for (std::uint32_t first = 0; first < set.size(); first += 16) {
    // Lane i is point i of the footprint, with direction i ^ flip of the packet: which point goes
    // with which direction differs from packet to packet.
    const std::uint32_t key = hash(seed, first), flip = key % 16;
    kernels_.directions(&set.x[first], &set.y[first], flip, seed, seed_y, frames, to);
    set_plane(to.direction, rays.dir_x, rays.dir_y, rays.dir_z);
    rays.active = 0;
    for (std::uint32_t i = 0; i < 16; ++i)
      rays.active |= std::uint32_t(to.above[i] > 0 && first + (i ^ flip) < set.size()) << i;
    in_.rays.closest(rays, met, set.coherent);
    // Stratified over the packet, whose rays meet neighbouring texels when it is coherent.
    const float jitter = to_unit(hash(key, 1));
    for (std::uint32_t i = 0; i < 16; ++i)
      pick[i] = (float(i ^ (key >> 4) % 16) + jitter) * (1.f / 16);
    kernels_.look_up(grid, met.triangle, met.u, met.v, met.back, pick, found);
    for (std::uint32_t i = 0; i < 16; ++i) {
      const std::uint32_t sample = first + (i ^ flip);
      if (sample >= set.size()) continue;
      const bool active = rays.active >> i & 1;
      if (active && found[i] == kHitUnclear) {
        const std::int32_t t =
            in_.lookup.pick(met.triangle[i], {met.u[i], met.v[i]}, met.back[i] != 0, pick[i]);
        found[i] = t != kNoTexel ? static_cast<std::uint32_t>(t) : kHitNothing;
      }
      hits[sample] = active ? found[i] : kHitNothing;
      census.rays[i] += active;
      census.behind[i] += active && found[i] == kHitNothing && met.back[i];
    }
  }
  return census;
}

double GatherSolver::extrapolate(std::span<const proto::PassReport> done,
                                 const Lightmap& before_last, Lightmap& last) const {
  if (final_gather_ || done.size() < first_bounce() + 2) return 0;
  if (bounces_in(done) == in_.settings.bounces) return 0;
  const double scale = tail(done);
  for (std::uint32_t t = 0; t < last.size(); ++t)
    last.indirect[t] += (last.indirect[t] - before_last.indirect[t]) * float(scale);
  return scale;
}

}  // namespace

std::unique_ptr<Solver> make_gather_solver(const SolverInput& in, std::uint64_t hit_budget_bytes) {
  return std::make_unique<GatherSolver>(in, hit_budget_bytes);
}

}  // namespace kiln::baker
