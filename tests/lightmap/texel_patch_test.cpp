// Patches come from other processes and from disks: what is not in order is refused.
#include "baker/lightmap/texel_patch.h"

#include <gtest/gtest.h>

#include <cstring>
#include <limits>

namespace kiln::lightmap {
namespace {

constexpr std::uint32_t kTexels = 100, kBatch = 32, kWords = 3;

class Patches : public testing::Test {
 protected:
  const std::vector<PlaneSpec> state_{{PlaneId::kGathers}, {PlaneId::kHits, kWords}};
  const PlaneSet writes_ =
      plane_set({PlaneId::kSky, PlaneId::kSamples, PlaneId::kGathers, PlaneId::kHits});
  Lightmap light_{kTexels, state_};
  PatchForm form_{4, writes_, kTexels, kBatch, light_.texel_bytes(writes_)};

  Patches() {
    for (std::uint32_t t = 0; t < kTexels; ++t) {
      light_.sky[t] = {float(t), 0.5f, -float(t)};
      light_.samples[t] = 1000 + t;
      light_.gathers[t] = t % 2;
      for (std::uint32_t w = 0; w < kWords; ++w)
        light_.hits.data()[t * kWords + w] = w == 2 ? kFirstMiss + t % 3 : (t + w) % kTexels;
    }
  }
  PatchHead head(std::uint32_t begin, std::uint32_t end) const {
    PatchHead h;
    h.pass = 4, h.texels = {begin, end}, h.writes = writes_, h.rays = 77, h.seconds = 0.25;
    return h;
  }
  std::string bytes(std::uint32_t begin, std::uint32_t end) const {
    return TexelPatch::of(head(begin, end), light_, 0).serialized();
  }
};

TEST_F(Patches, AreReadBackBitByBit) {
  Lightmap copy(kTexels, state_);
  for (const auto& [begin, end] : {std::pair(64u, 96u), std::pair(96u, 100u), std::pair(0u, 64u)}) {
    const std::string sent = bytes(begin, end);
    EXPECT_EQ(sent.size(), PatchHead::kBytes + (end - begin) * (12 + 4 + 1 + 4 * kWords));
    const auto patch = parse_patch(sent, form_);
    ASSERT_TRUE(patch) << patch.error().message;
    EXPECT_EQ(patch->head.rays, 77u);
    EXPECT_EQ(patch->head.seconds, 0.25);
    ASSERT_TRUE(apply_patch(*patch, copy));
  }
  Lightmap::for_planes(copy, writes_, [&](PlaneId id, const auto& plane) {
    Lightmap::for_planes(light_, plane_set({id}), [&](PlaneId, const auto& expected) {
      const auto a = plane.bytes(0, kTexels);
      if constexpr (std::is_same_v<decltype(plane), decltype(expected)>) {
        EXPECT_EQ(std::memcmp(a.data(), expected.bytes(0, kTexels).data(), a.size()), 0);
      }
    });
  });
  for (std::uint32_t t = 0; t < kTexels; ++t) EXPECT_TRUE(is_black(copy.direct[t])) << "not sent";
}

TEST_F(Patches, OfAnyOtherLengthAreRefused) {
  const std::string whole = bytes(32, 64);
  for (std::size_t n = 0; n < whole.size(); ++n)
    EXPECT_FALSE(parse_patch(whole.substr(0, n), form_)) << n;
  EXPECT_FALSE(parse_patch(whole + '\0', form_));
}

TEST_F(Patches, OfAnotherPassOrRangeAreRefused) {
  const auto refused = [&](const PatchHead& h) {
    TexelPatch patch = TexelPatch::of(head(32, 64), light_, 0);
    const std::uint64_t size = patch.head.bytes;
    patch.head = h;
    if (h.bytes == 0) patch.head.bytes = size;
    const auto parsed = parse_patch(patch.serialized(), form_);
    return !parsed && parsed.error().code == "invalid_patch";
  };
  ASSERT_FALSE(refused(head(32, 64))) << "as it should be";
  PatchHead h = head(32, 64);
  h.pass = 5;
  EXPECT_TRUE(refused(h));
  h = head(32, 64), h.writes.set(std::size_t(PlaneId::kDirect));
  EXPECT_TRUE(refused(h)) << "another plane";
  h = head(32, 64), h.writes = PlaneSet(~0ull);
  EXPECT_TRUE(refused(h)) << "planes that are none";
  for (const auto& [begin, end] :
       {std::pair(33u, 65u), std::pair(32u, 63u), std::pair(64u, 64u), std::pair(64u, 32u),
        std::pair(96u, 128u), std::pair(0xffffffe0u, 0xffffffffu), std::pair(0u, 64u)})
    EXPECT_TRUE(refused(head(begin, end))) << begin << " " << end;
  h = head(32, 64), h.bytes = std::numeric_limits<std::uint64_t>::max();
  EXPECT_TRUE(refused(h)) << "no memory is taken for what is not there";
  for (const double seconds : {-1.0, std::numeric_limits<double>::quiet_NaN(), 1e300}) {
    h = head(32, 64), h.seconds = seconds;
    EXPECT_TRUE(refused(h)) << seconds;
  }
  std::string foreign = bytes(32, 64);
  foreign[7] = '9';
  EXPECT_FALSE(parse_patch(foreign, form_)) << "another version";
}

TEST_F(Patches, ValuesThatWouldLeadAPassAstrayAreRefused) {
  const auto applied = [&](const Lightmap& light) {
    Lightmap copy(kTexels, state_);
    const auto patch = parse_patch(TexelPatch::of(head(32, 64), light, 0).serialized(), form_);
    return patch && apply_patch(*patch, copy).has_value();
  };
  ASSERT_TRUE(applied(light_));
  light_.hits.data()[40 * kWords] = kTexels - 1;
  EXPECT_TRUE(applied(light_)) << "the last texel";
  light_.hits.data()[40 * kWords] = kTexels;
  EXPECT_FALSE(applied(light_)) << "a hit behind the last texel";
  light_.hits.data()[40 * kWords] = kFirstMiss - 1;
  EXPECT_FALSE(applied(light_));
  light_.hits.data()[40 * kWords] = kFirstMiss;
  EXPECT_TRUE(applied(light_));
  light_.gathers[40] = 2;
  EXPECT_FALSE(applied(light_)) << "a flag that is none";
}

}  // namespace
}  // namespace kiln::lightmap
