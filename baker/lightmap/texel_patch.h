#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "baker/atlas/texture_group.h"
#include "baker/lightmap/lightmap.h"
#include "baker/lightmap/planes.h"
#include "proto/expected.h"

/// A texel patch holds the results of a batch as bytes. Another process returns it in this form,
/// and a checkpoint holds the parts of a pass under way in it. A head of fixed size comes first,
/// then the values of the texels, plane after plane in the order of their ids. Little-endian.
namespace kiln::lightmap {

/// The head of a patch.
struct PatchHead {
  std::uint32_t pass = 0;  ///< its index
  atlas::TexelRange texels{0, 0};
  PlaneSet writes;
  std::uint64_t rays = 0;   ///< traced for these texels
  double seconds = 0;       ///< time that they took
  std::uint64_t bytes = 0;  ///< size of the values that follow

  static constexpr std::size_t kBytes = 56;
  std::array<std::byte, kBytes> packed() const;
};

struct TexelPatch {
  PatchHead head;
  std::string values;

  /// Cuts the patch out of a light whose first entry stands for the texel `begin`. Sets head.bytes.
  static TexelPatch of(PatchHead head, const Lightmap& light, std::uint32_t begin);
  std::string serialized() const;
};

/// The form that a patch of a certain pass must have. Bytes from outside are checked against it.
struct PatchForm {
  std::uint32_t pass = 0;
  PlaneSet writes;
  std::uint32_t texels = 0;        ///< number in the whole light
  std::uint32_t batch_texels = 1;  ///< ranges are made of whole batches
  std::size_t texel_bytes = 0;     ///< size of the planes that are written
};

/// Reads a head. Errors: `invalid_patch`, when the bytes are no head, or one of another form.
proto::Expected<PatchHead> read_patch_head(std::span<const std::byte>, const PatchForm&);

/// Reads a patch. Errors: `invalid_patch`, also when the size is not what the head says.
proto::Expected<TexelPatch> parse_patch(std::string_view bytes, const PatchForm&);

/// Copies the values of a patch into `to`, whose planes are detached. Errors: `invalid_patch`, when
/// a value would lead a later pass astray (a hit that is no texel, say); `to` may have changed
/// then.
proto::Expected<void> apply_patch(const TexelPatch&, Lightmap& to);

/// Returns whether the values of a plane are safe for any pass to read: indices within `texels`,
/// flags 0 or 1. Light itself may have any value; the end of a pass checks it.
bool are_sane(PlaneId, std::span<const std::byte> values, std::uint32_t texels);

/// Copies the memory pages that differ. A page that was never written, and has to be zeros, costs
/// nothing and stays unwritten.
void copy_where_different(std::span<const std::byte> from, std::byte* to);

}  // namespace kiln::lightmap
