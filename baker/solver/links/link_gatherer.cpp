#include "baker/solver/links/link_gatherer.h"

#include <algorithm>
#include <cmath>

#include "baker/sampling/sobol.h"
#include "baker/solver/footprint.h"
namespace kiln::solver::links {

using math::Rgb;
using math::Vec3;
using pairwise::Sender;
using Bounds = LinkTree::Bounds;

namespace {

constexpr std::uint32_t kPairs = 16;  // of texels, for one look

}  // namespace

LinkGatherer::LinkGatherer(const pairwise::Parts& parts, const LinkTree& tree,
                           const LinkLight& light, atlas::TexelRange range)
    : parts_(parts),
      tree_(tree),
      light_(light),
      range_(range),
      scale_(1 / (math::kPi * parts.world.settings.distance_factor *
                  parts.world.settings.distance_factor)),
      seed_(texel_seed(parts.world, 0, SampleStream::kLinks)),
      received_(range.size()),
      sums_(range.size()) {}

void LinkGatherer::gather() {
  for (const Id receiver : tree_.receivers(range_)) {
    refine(receiver, tree_.root());
    for (std::uint32_t i = 0; i < size(receiver); ++i)
      if (const std::uint32_t t = texel(receiver, i); is_inside(t)) settle(t);
  }
}

/// Finds the light of a texel whose links are known.
void LinkGatherer::settle(std::uint32_t texel) {
  Received& received = received_[texel - range_.begin];
  pairwise::Senders from;
  for (const std::uint32_t j : received.texels)
    from.list.push_back({j, Sender::kTexelsOwn, parts_.patches.area_m2(j), light_.texels[j]});
  from.gather(parts_.patches);
  pairwise::Sum own;
  rays_ += parts_.factors.row(texel, from, nullptr, [&](std::uint32_t s, float factor) {
    own += from.list[s].radiosity * factor;
  });
  if (!is_black(own.rgb()) || sees_any(texel))
    received.light += own.rgb();
  else
    received.light = {};
  sums_[texel - range_.begin] = received.light.rgb();
  received = {};
}

/// Returns whether a texel sees one of some lit texels of the groups that have sent it light. One
/// that does not is dark: it has got light for others of its own group, from behind a wall maybe.
bool LinkGatherer::sees_any(std::uint32_t texel) {
  trace::SegmentPacket packet;
  const auto sees = [&] {
    const std::uint32_t all = (1u << packet.count) - 1;
    const bool seen = packet.count > 0 && (parts_.visibility->blocked(packet) & all) != all;
    rays_ += packet.count;
    packet.count = 0;
    return seen;
  };
  const auto from = parts_.patches.point(texel, 0);
  for (const Id sender : received_[texel - range_.begin].groups) {
    const auto draw = sampling::hash(seed_, texel, sender) % kPairs;
    const std::uint32_t j = sample(sender, draw, sampling::hash(seed_, texel));
    const auto to = parts_.patches.point(j, 0);
    if (is_black(light_.texels[j])) continue;
    if (!(pairwise::ViewFactors::unoccluded(from, to).forth > 0)) continue;
    packet.add(from.origin, to.origin);
    if (packet.is_full() && sees()) return true;
  }
  return sees();
}

void LinkGatherer::refine(Id receiver, Id sender) {
  const Rgb b = radiosity(sender);
  if (!is_wanted(receiver) || is_black(b)) return;
  const Bounds to = bounds(receiver), from = bounds(sender);
  if (!may_face(to, from)) return;
  if (std::uint64_t(size(receiver)) * size(sender) <= kPairs) return link_texels(receiver, sender);
  const Look seen = look(receiver, sender);
  if (seen.is_dark) {
    if (may_matter(to, from, b)) split(receiver, sender, sender_is_larger(receiver, sender));
    return;
  }
  const float worse = std::max(seen.at_sender, seen.at_receiver);
  if (worse > light_.most_error) return split(receiver, sender, seen.at_sender == worse);
  if (seen.is_large) return split(receiver, sender, sender_is_larger(receiver, sender));
  link(receiver, sender, seen);
}

bool LinkGatherer::sender_is_larger(Id receiver, Id sender) const {
  return bounds(sender).radius >= bounds(receiver).radius;
}

void LinkGatherer::split(Id receiver, Id sender, bool at_sender) {
  if (tree_.is_texel(at_sender ? sender : receiver)) at_sender = !at_sender;
  const Id group = at_sender ? sender : receiver;
  for (std::uint32_t k = 0; k < tree_.children(group); ++k)
    at_sender ? refine(receiver, tree_.child(group, k)) : refine(tree_.child(group, k), sender);
}

void LinkGatherer::link(Id receiver, Id sender, const Look& seen) {
  const Rgb b = radiosity(sender);
  const std::uint32_t count = size(receiver);
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint32_t t = texel(receiver, i);
    const float factor = seen.factor[4 * i / count];
    if (!is_inside(t) || !(factor > 0)) continue;
    received_[t - range_.begin].light += b * factor;
    received_[t - range_.begin].groups.push_back(sender);
  }
}

void LinkGatherer::link_texels(Id receiver, Id sender) {
  for (std::uint32_t i = 0; i < size(receiver); ++i) {
    const std::uint32_t t = texel(receiver, i);
    if (!is_inside(t)) continue;
    for (std::uint32_t j = 0; j < size(sender); ++j) {
      const std::uint32_t from = texel(sender, j);
      if (from != t && !is_black(light_.texels[from]))
        received_[t - range_.begin].texels.push_back(from);
    }
  }
}

LinkGatherer::Look LinkGatherer::look(Id receiver, Id sender) {
  trace::SegmentPacket packet;
  float kernel[kPairs], area[kPairs];
  std::uint32_t lane[kPairs] = {};
  Look out;
  const std::uint32_t key = sampling::hash(seed_, receiver, sender);
  for (std::uint32_t k = 0; k < kPairs; ++k) {
    const std::uint32_t quarter = k / 4, of_sender = k % 4;
    const std::uint32_t i = sample(receiver, 4 * quarter + of_sender, key),
                        j = sample(sender, 4 * of_sender + quarter, key);
    const auto at_i = parts_.patches.point(i, 0), at_j = parts_.patches.point(j, 0);
    area[k] = parts_.patches.area_m2(j);
    kernel[k] = i == j ? 0
                       : pairwise::ViewFactors::unoccluded(at_i, at_j).forth *
                             parts_.patches.visible_pairs(i, j);
    if (!(kernel[k] > 0)) continue;
    out.is_dark = false;
    lane[k] = packet.count;
    packet.add(at_i.origin, at_j.origin);
  }
  if (out.is_dark) return out;
  const std::uint32_t blocked = parts_.visibility->blocked(packet);
  rays_ += packet.count;
  const float sender_area = bounds(sender).area_m2, by_area = scale_ * sender_area;
  // All pairs count as bright as the mean: where the light of the group is bunched, sixteen texels
  // of it may miss it.
  const float light = by_area * max_channel(radiosity(sender));
  const float most_factor = std::min(1.f, sender_area / bounds(receiver).area_m2);
  float least = 0, most = 0, variance = 0, brightest = 0;
  for (std::uint32_t quarter = 0; quarter < 4; ++quarter) {
    float sum = 0, all_area = 0, lit = 0, square = 0;
    for (std::uint32_t k = 4 * quarter; k < 4 * quarter + 4; ++k) {
      brightest = std::max(brightest, kernel[k]);
      const float v = kernel[k] > 0 && !(blocked >> lane[k] & 1) ? kernel[k] : 0;
      sum += v * area[k], all_area += area[k];
      lit += v / 4, square += v * v / 4;
    }
    out.factor[quarter] = std::min(by_area * (all_area > 0 ? sum / all_area : 0), most_factor);
    variance += std::max(0.f, square - lit * lit) / 4;
    least = quarter == 0 ? lit : std::min(least, lit);
    most = std::max(most, lit);
  }
  out.at_receiver = light * (most - least) / 2;
  out.at_sender = light * std::sqrt(variance) / 2;
  out.is_large = light * brightest > kMostLight * light_.most_error;
  return out;
}

/// Returns whether some point of the one may lie before the plane of the other, both ways.
bool LinkGatherer::may_face(const Bounds& a, const Bounds& b) const {
  constexpr float kRounding = 1e-5f;
  const auto before = [](const Bounds& plane, const Bounds& other) {
    if (!plane.is_flat) return true;
    float reach = other.radius;
    if (other.is_flat) {
      const float c = std::min(1.f, std::abs(dot(plane.normal, other.normal)));
      reach = other.radius * std::sqrt(1 - c * c) + other.thickness;
    }
    const float highest = dot(plane.normal, other.center - plane.center) + reach + plane.thickness;
    return highest > kRounding * (other.radius + plane.radius);
  };
  return before(a, b) && before(b, a);
}

/// Returns whether two members of which no pair has faced each other may exchange more light than a
/// link may be off by.
bool LinkGatherer::may_matter(const Bounds& receiver, const Bounds& sender, Rgb light) const {
  const float apart = length(receiver.center - sender.center) - receiver.radius - sender.radius;
  const float r2 = std::max(apart > 0 ? apart * apart : 0.f, sender.area_m2);
  return scale_ * sender.area_m2 / r2 * max_channel(light) > kMostLight * light_.most_error;
}

Bounds LinkGatherer::bounds(Id id) const {
  if (!tree_.is_texel(id)) return tree_.bounds(id);
  const auto at = parts_.patches.point(tree_.texel(id), 0);
  return {at.position, 0, at.geometric_normal, 0, true, parts_.patches.area_m2(tree_.texel(id))};
}

Rgb LinkGatherer::radiosity(Id id) const {
  return tree_.is_texel(id) ? light_.texels[tree_.texel(id)] : light_.groups[id];
}

std::uint32_t LinkGatherer::size(Id id) const {
  return tree_.is_texel(id) ? 1 : std::uint32_t(tree_.texels(id).size());
}

std::uint32_t LinkGatherer::texel(Id id, std::uint32_t i) const {
  return tree_.is_texel(id) ? tree_.texel(id) : tree_.texels(id)[i];
}

/// Returns a random texel of the k-th sixteenth of a member. Their middles would miss the light
/// that is more than proportional near the ends. @param key of the pair
std::uint32_t LinkGatherer::sample(Id id, std::uint32_t k, std::uint32_t key) const {
  constexpr std::uint32_t kHalfWord = 1u << 16;
  const std::uint32_t within = sampling::hash(key, id, k) % kHalfWord;
  return texel(id, std::uint32_t((std::uint64_t(k) * kHalfWord + within) * size(id) /
                                 (kPairs * std::uint64_t(kHalfWord))));
}

/// Returns whether a receiver has a texel of the range.
bool LinkGatherer::is_wanted(Id receiver) const {
  const auto inside = [&](std::uint32_t t) { return is_inside(t); };
  return tree_.is_texel(receiver) ? inside(tree_.texel(receiver))
                                  : std::ranges::any_of(tree_.texels(receiver), inside);
}

}  // namespace kiln::solver::links
