#include "baker/checkpoint/parts.h"

#include <algorithm>
#include <array>
#include <fstream>
#include <optional>
#include <utility>
#include <vector>

#include "baker/checkpoint/sealed_file.h"
#include "proto/files.h"

namespace kiln::checkpoint {
namespace {

namespace fs = std::filesystem;
using lightmap::Lightmap;
using lightmap::PatchHead;
using lightmap::PlaneId;

constexpr Magic kMagic{'K', 'I', 'L', 'N', 'P', 'R', 'T', '2'};

constexpr const char* kName = "part_";

fs::path part_file(const fs::path& dir, std::uint32_t number) {
  return dir / (kName + std::to_string(number) + ".bin");
}

/// Puts the light before the pass back into some texels. Shared planes keep what is there: the pass
/// writes them anew before it reads them.
void take_back(const Lightmap& before, Lightmap& after, const PatchHead& head) {
  std::vector<std::span<const std::byte>> from;
  const auto planes = head.writes & ~lightmap::shared_planes();
  Lightmap::for_planes(before, planes, [&](PlaneId, const auto& plane) {
    from.push_back(plane.bytes(head.texels.begin, head.texels.end));
  });
  std::size_t i = 0;
  Lightmap::for_planes(after, planes, [&](PlaneId, auto& plane) {
    std::ranges::copy(from[i++], plane.bytes(head.texels.begin, head.texels.end).begin());
  });
}

/// Reads the head of the part that follows the first `done` texels.
std::optional<PatchHead> read_head(SealedReader& in, const std::string& key, std::uint32_t number,
                                   std::uint32_t done, const lightmap::PatchForm& form) {
  std::string found;
  std::uint32_t found_number = 0;
  std::array<std::byte, PatchHead::kBytes> bytes{};
  const bool whole = in.magic(kMagic) && in.text(found) && found == key && in.value(found_number) &&
                     found_number == number && in.bytes(bytes.data(), bytes.size());
  if (!whole) return std::nullopt;
  const auto head = lightmap::read_patch_head(bytes, form);
  if (!head || head->texels.begin != done) return std::nullopt;
  return *head;
}

/// Reads the values of a part. Returns false when the part is not whole. @param keep false: only
/// looks at the values
bool read_values(SealedReader& in, const PatchHead& head, Lightmap& after, bool keep,
                 const std::stop_token& stop) {
  constexpr std::size_t kPiece = 1 << 20;
  std::vector<std::byte> buffer(kPiece);
  bool whole = true;
  Lightmap::for_planes(after, head.writes, [&](PlaneId id, auto& plane) {
    const auto target = plane.bytes(head.texels.begin, head.texels.end);
    whole = whole && for_pieces<kPiece>(target, stop, [&](auto piece) {
              const auto read = std::span(buffer).first(piece.size());
              if (!in.bytes(read.data(), read.size())) return false;
              if (!are_sane(id, read, after.size())) return false;
              if (keep) lightmap::copy_where_different(read, piece.data());
              return true;
            });
  });
  return whole && in.sealed();
}

}  // namespace

proto::Expected<void> write_part(const fs::path& dir, const std::string& key, std::uint32_t number,
                                 PatchHead head, const Lightmap& after, std::stop_token stop) {
  head.bytes = after.texel_bytes(head.writes) * head.texels.size();
  return proto::write_whole(part_file(dir, number), [&](const fs::path& temporary) {
    auto done = write_sealed(temporary, kMagic, key, [&](SealedWriter& w) {
      w.value(number);
      const auto bytes = head.packed();
      w.bytes(bytes.data(), bytes.size());
      Lightmap::for_planes(after, head.writes, [&](PlaneId, const auto& plane) {
        w.pieces(plane.bytes(head.texels.begin, head.texels.end), stop);
      });
    });
    if (stop.stop_requested()) return proto::Expected<void>(proto::canceled());
    return done;
  });
}

StoredParts read_parts(const fs::path& dir, const std::string& key, const solver::PassPlan& plan,
                       const Lightmap& before, Lightmap& after, std::stop_token stop) {
  StoredParts stored;
  const lightmap::PatchForm form = patch_form(plan, after);
  // The part is read twice, since nothing of a damaged part may reach the light.
  const auto read = [&](bool keep) -> std::optional<PatchHead> {
    std::ifstream file(part_file(dir, stored.count), std::ios::binary);
    SealedReader in(file);
    const auto head = read_head(in, key, stored.count, stored.progress.texels, form);
    if (!head || !read_values(in, *head, after, keep, stop)) return std::nullopt;
    return head;
  };
  while (const auto head = read(false)) {
    if (!read(true)) {  // the disk gave another answer
      take_back(before, after, *head);
      break;
    }
    ++stored.count;
    stored.progress.texels = head->texels.end;
    stored.progress.rays += head->rays;
    stored.progress.seconds += head->seconds;
  }
  return stored;
}

void remove_parts(const fs::path& dir) {
  std::error_code ignored;  // what can't be removed is of an earlier pass, and so never read
  std::vector<fs::path> parts;
  for (fs::directory_iterator at(dir, ignored), end; !ignored && at != end; at.increment(ignored))
    if (at->path().filename().string().starts_with(kName)) parts.push_back(at->path());
  for (const auto& part : parts) fs::remove(part, ignored);
}

}  // namespace kiln::checkpoint
