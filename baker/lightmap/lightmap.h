#pragma once

#include <cassert>
#include <cstdint>
#include <span>

#include "baker/atlas/texture_group.h"
#include "baker/lightmap/plane.h"
#include "baker/lightmap/planes.h"
#include "baker/lightmap/word_plane.h"
#include "baker/math/vec.h"

namespace kiln::lightmap {

/// A texel lies inside other geometry when a smaller share of its rays than this has no back face
/// behind it.
inline constexpr float kValidShare = 0.5f;

/// The number of times that the next round doubles the samples of a texel.
struct Doublings {
  std::uint8_t shadow_rays = 0, directions = 0;
};

/// The light on the texels of a TextureGroup, one entry per texel. It is all that one pass hands to
/// the next, and so the content of a checkpoint. Irradiance in lx, without albedo. Copies share
/// their planes.
struct Lightmap {
  /// Light by shadow rays: straight from emitters, lights and bright parts of the sky.
  Plane<math::Rgb> direct;
  Plane<math::Rgb> sky;       ///< gathered light straight from the sky, or from what is left of it
  Plane<math::Rgb> indirect;  ///< after one diffuse reflection or more
  /// Share of the footprint that is not inside or behind other geometry, 0..1: all rays from a
  /// hidden point meet back faces. The path method, which sends few rays from a point at a time,
  /// gives the share of the texel's rays that met no back face.
  Plane<float> validity;

  /// The half difference of two halves of the samples in luminance, see Estimate::half_difference.
  Plane<float> direct_difference, sky_difference, indirect_difference;
  /// Shadow rays towards area lights, and directions or paths, that the light was taken from.
  Plane<std::uint32_t> direct_samples, samples;
  /// The doublings of the next round; the same for all texels of a tile.
  Plane<Doublings> doublings;

  // Only some methods have the following planes; the others leave them empty.
  /// The radiosity that the last bounce read, lx: passes that only add samples read it again.
  Plane<math::Rgb> radiosity;
  /// 1 where rays of the texel's own gather, 0 where the light is interpolated from texels around.
  Plane<std::uint8_t> gathers;
  /// The texel that each direction met, or what else the ray met. Dropped once all bounces are
  /// there.
  WordPlane hits;
  /// Bits for pairs of texels: whether they see each other. Dropped like the hits.
  WordPlane seen;
  /// The light that clamps took from the last bounce, lx.
  Plane<float> clamped;

  Lightmap() = default;
  /// Makes a dark light. @param state the planes of a method's own
  explicit Lightmap(std::uint32_t texels, std::span<const PlaneSpec> state = {})
      : direct(texels),
        sky(texels),
        indirect(texels),
        validity(texels, 1.f),
        direct_difference(texels),
        sky_difference(texels),
        indirect_difference(texels),
        direct_samples(texels),
        samples(texels),
        doublings(texels) {
    for (const PlaneSpec& plane : state) {
      if (plane.id == PlaneId::kRadiosity) radiosity = Plane<math::Rgb>(texels);
      if (plane.id == PlaneId::kGathers) gathers = Plane<std::uint8_t>(texels, 1);
      if (plane.id == PlaneId::kHits) hits = WordPlane(texels, plane.words);
      if (plane.id == PlaneId::kSeen) seen = WordPlane(texels, plane.words);
      if (plane.id == PlaneId::kClamped) clamped = Plane<float>(texels);
    }
  }

  math::Rgb irradiance(std::uint32_t texel) const {
    return direct[texel] + sky[texel] + indirect[texel];
  }
  std::uint32_t size() const { return direct.size(); }
  /// Returns whether the texel's light comes from rays of its own.
  bool is_gathered(std::uint32_t texel) const { return gathers.size() == 0 || gathers[texel] != 0; }

  /// Calls `use(id, plane)` for every plane, in the order of the ids.
  template <class Light, class Use>
  static void for_planes(Light& light, const Use& use) {
    use(PlaneId::kDirect, light.direct), use(PlaneId::kSky, light.sky);
    use(PlaneId::kIndirect, light.indirect), use(PlaneId::kValidity, light.validity);
    use(PlaneId::kDirectDifference, light.direct_difference),
        use(PlaneId::kSkyDifference, light.sky_difference);
    use(PlaneId::kIndirectDifference, light.indirect_difference);
    use(PlaneId::kDirectSamples, light.direct_samples), use(PlaneId::kSamples, light.samples);
    use(PlaneId::kDoublings, light.doublings), use(PlaneId::kRadiosity, light.radiosity);
    use(PlaneId::kGathers, light.gathers), use(PlaneId::kHits, light.hits);
    use(PlaneId::kSeen, light.seen), use(PlaneId::kClamped, light.clamped);
  }
  template <class Light, class Use>
  static void for_planes(Light& light, const PlaneSet& some, const Use& use) {
    for_planes(light, [&](PlaneId id, auto& plane) {
      if (contains(some, id)) use(id, plane);
    });
  }

  /// Returns the planes that hold something.
  PlaneSet planes() const {
    PlaneSet all;
    for_planes(*this, [&](PlaneId id, const auto& p) { all.set(std::size_t(id), p.size() > 0); });
    return all;
  }
  /// Returns the bytes of one texel in some planes.
  std::size_t texel_bytes(const PlaneSet& some) const {
    std::size_t sum = 0;
    for_planes(*this, some, [&](PlaneId, const auto& plane) { sum += plane.texel_bytes(); });
    return sum;
  }
  /// Makes some planes ready for writing, see Plane::detach().
  void detach(const PlaneSet& some) {
    for_planes(*this, some, [](PlaneId, auto& plane) { plane.detach(); });
  }
  /// Gives up the planes that copies share without a copy, see shared_planes().
  void drop_shared() { hits.drop(), seen.drop(); }
  bool has_shared() const { return hits.size() > 0 || seen.size() > 0; }
  /// Returns the light as it is shown, without what only later passes read.
  Lightmap shown() const {
    Lightmap light = *this;
    light.radiosity = {}, light.gathers = {}, light.clamped = {};
    light.drop_shared();
    return light;
  }
};

/// The planes of a light that a batch may write, at the places of its texels. A pass that reaches
/// for a plane it did not declare fails at once.
class LightmapView {
 public:
  template <class T>
  class Column {
   public:
    Column() = default;
    Column(T* first, std::uint32_t begin) : first_(first), begin_(begin) {}
    T& operator[](std::uint32_t texel) const {
      assert(first_ && texel >= begin_);
      return first_[texel - begin_];
    }

   private:
    T* first_ = nullptr;
    std::uint32_t begin_ = 0;
  };
  class WordColumn {
   public:
    WordColumn() = default;
    WordColumn(std::uint32_t* first, std::uint32_t words, std::uint32_t begin)
        : first_(first), words_(words), begin_(begin) {}
    std::span<std::uint32_t> of(std::uint32_t texel) const {
      assert(first_ && texel >= begin_);
      return {first_ + std::size_t(texel - begin_) * words_, words_};
    }

   private:
    std::uint32_t* first_ = nullptr;
    std::uint32_t words_ = 0, begin_ = 0;
  };

  /// @param to outlives the view; detached from others in `writes`
  /// @param begin the texel that the first entry of `to` stands for
  LightmapView(Lightmap& to, const PlaneSet& writes, std::uint32_t begin = 0) {
    const auto open = [&](PlaneId id, auto& plane, auto& column) {
      if (contains(writes, id)) column = {plane.data(), begin};
    };
    open(PlaneId::kDirect, to.direct, direct), open(PlaneId::kSky, to.sky, sky);
    open(PlaneId::kIndirect, to.indirect, indirect);
    open(PlaneId::kValidity, to.validity, validity);
    open(PlaneId::kDirectDifference, to.direct_difference, direct_difference);
    open(PlaneId::kSkyDifference, to.sky_difference, sky_difference);
    open(PlaneId::kIndirectDifference, to.indirect_difference, indirect_difference);
    open(PlaneId::kDirectSamples, to.direct_samples, direct_samples);
    open(PlaneId::kSamples, to.samples, samples);
    open(PlaneId::kRadiosity, to.radiosity, radiosity),
        open(PlaneId::kGathers, to.gathers, gathers);
    open(PlaneId::kClamped, to.clamped, clamped);
    if (contains(writes, PlaneId::kHits))
      hits = WordColumn(to.hits.data(), to.hits.words_per_texel(), begin);
    if (contains(writes, PlaneId::kSeen))
      seen = WordColumn(to.seen.data(), to.seen.words_per_texel(), begin);
  }

  Column<math::Rgb> direct, sky, indirect, radiosity;
  Column<float> validity, direct_difference, sky_difference, indirect_difference, clamped;
  Column<std::uint32_t> direct_samples, samples;
  Column<std::uint8_t> gathers;
  WordColumn hits, seen;
};

}  // namespace kiln::lightmap
