#include "baker/lightmap/texel_patch.h"

#include <algorithm>
#include <cstring>

namespace kiln::lightmap {
namespace {

constexpr std::array<char, 8> kMagic{'K', 'I', 'L', 'N', 'P', 'A', 'T', '1'};

proto::Unexpected invalid(const char* why) {
  return proto::fail("invalid_patch", std::string("The patch of a batch ") + why + ".");
}

/// Writes or reads the members of a head, one after the other.
template <class Byte>
class Cursor {
 public:
  explicit Cursor(Byte* at) : at_(at) {}
  template <class T>
  void put(const T& value) {
    std::memcpy(at_, &value, sizeof value);
    at_ += sizeof value;
  }
  template <class T>
  T get() {
    T value{};
    std::memcpy(&value, at_, sizeof value);
    at_ += sizeof value;
    return value;
  }

 private:
  Byte* at_;
};

}  // namespace

std::array<std::byte, PatchHead::kBytes> PatchHead::packed() const {
  std::array<std::byte, kBytes> out{};
  Cursor<std::byte> cursor(out.data());
  cursor.put(kMagic);
  cursor.put(pass), cursor.put(texels.begin), cursor.put(texels.end), cursor.put(std::uint32_t(0));
  cursor.put(std::uint64_t(writes.to_ullong()));
  cursor.put(rays), cursor.put(seconds), cursor.put(bytes);
  return out;
}

TexelPatch TexelPatch::of(PatchHead head, const Lightmap& light, std::uint32_t begin) {
  TexelPatch patch{head, {}};
  patch.values.reserve(light.texel_bytes(head.writes) * head.texels.size());
  Lightmap::for_planes(light, head.writes, [&](PlaneId, const auto& plane) {
    const auto bytes = plane.bytes(head.texels.begin - begin, head.texels.end - begin);
    patch.values.append(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  });
  patch.head.bytes = patch.values.size();
  return patch;
}

std::string TexelPatch::serialized() const {
  const auto bytes = head.packed();
  std::string out(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  return out += values;
}

proto::Expected<PatchHead> read_patch_head(std::span<const std::byte> bytes,
                                           const PatchForm& form) {
  if (bytes.size() < PatchHead::kBytes) return invalid("is cut short");
  Cursor<const std::byte> cursor(bytes.data());
  if (cursor.get<std::array<char, 8>>() != kMagic) return invalid("is no patch");
  PatchHead head;
  head.pass = cursor.get<std::uint32_t>();
  head.texels.begin = cursor.get<std::uint32_t>();
  head.texels.end = cursor.get<std::uint32_t>();
  const auto reserved = cursor.get<std::uint32_t>();
  head.writes = PlaneSet(cursor.get<std::uint64_t>());
  head.rays = cursor.get<std::uint64_t>();
  head.seconds = cursor.get<double>();
  head.bytes = cursor.get<std::uint64_t>();
  if (head.pass != form.pass || head.writes != form.writes || reserved != 0)
    return invalid("is of another pass");
  const atlas::TexelRange texels = head.texels;
  const bool whole_batches = texels.begin % form.batch_texels == 0 &&
                             (texels.end % form.batch_texels == 0 || texels.end == form.texels);
  if (texels.begin >= texels.end || texels.end > form.texels || !whole_batches)
    return invalid("names texels that make no batch");
  if (head.bytes != std::uint64_t(form.texel_bytes) * texels.size())
    return invalid("does not hold the values of its texels");
  if (!(head.seconds >= 0) || head.seconds > 1e9) return invalid("says an impossible time");
  return head;
}

proto::Expected<TexelPatch> parse_patch(std::string_view bytes, const PatchForm& form) {
  auto head = read_patch_head(std::as_bytes(std::span(bytes)), form);
  if (!head) return proto::Unexpected(head.error());
  if (bytes.size() - PatchHead::kBytes != head->bytes)
    return invalid("does not hold the values of its texels");
  return TexelPatch{*head, std::string(bytes.substr(PatchHead::kBytes))};
}

proto::Expected<void> apply_patch(const TexelPatch& patch, Lightmap& to) {
  const auto values = std::as_bytes(std::span(patch.values));
  std::size_t at = 0;
  bool sane = true;
  Lightmap::for_planes(to, patch.head.writes, [&](PlaneId id, auto& plane) {
    const auto target = plane.bytes(patch.head.texels.begin, patch.head.texels.end);
    const auto source = values.subspan(at, target.size());
    at += target.size();
    sane = sane && are_sane(id, source, to.size());
    if (sane) copy_where_different(source, target.data());
  });
  if (!sane) return invalid("holds values that no pass may read");
  return {};
}

bool are_sane(PlaneId id, std::span<const std::byte> values, std::uint32_t texels) {
  if (id == PlaneId::kGathers)
    return std::ranges::all_of(values, [](std::byte b) { return b <= std::byte{1}; });
  if (id != PlaneId::kHits) return true;
  for (std::size_t at = 0; at + sizeof(std::uint32_t) <= values.size();
       at += sizeof(std::uint32_t)) {
    std::uint32_t hit = 0;
    std::memcpy(&hit, values.data() + at, sizeof hit);
    if (hit >= texels && hit < kFirstMiss) return false;
  }
  return true;
}

void copy_where_different(std::span<const std::byte> from, std::byte* to) {
  constexpr std::size_t kMemoryPage = 4096;
  for (std::size_t at = 0; at < from.size(); at += kMemoryPage) {
    const auto page = from.subspan(at, std::min(kMemoryPage, from.size() - at));
    if (std::memcmp(page.data(), to + at, page.size()) != 0)
      std::memcpy(to + at, page.data(), page.size());
  }
}

}  // namespace kiln::lightmap
