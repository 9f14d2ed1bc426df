#include "baker/checkpoint/pass_part.h"

#include <algorithm>
#include <fstream>
#include <optional>
#include <utility>
#include <vector>

#include "baker/checkpoint/sealed_file.h"
#include "proto/files.h"

namespace kiln::checkpoint {
namespace {

namespace fs = std::filesystem;

constexpr Magic kMagic{'K', 'I', 'L', 'N', 'P', 'R', 'T', '1'};

constexpr const char* kName = "part_";

fs::path part_file(const fs::path& dir, std::uint32_t number) {
  return dir / (kName + std::to_string(number) + ".bin");
}

/// Values, so many bytes for each texel.
template <class Byte>
struct Values {
  std::span<Byte> all;
  std::size_t texel_bytes;

  std::span<Byte> of(atlas::TexelRange texels) const {
    return all.subspan(texels.begin * texel_bytes, texels.size() * texel_bytes);
  }
};

template <class Byte, class T>
Values<Byte> values_of(const std::vector<T>& values) {
  // Of a plane that is the pass's own where Byte is not const.
  auto* data = const_cast<T*>(values.data());
  return {{reinterpret_cast<Byte*>(data), values.size() * sizeof(T)}, sizeof(T)};
}

/// What a pass changes: planes that it does not share with the light before, then the state.
template <class Byte>
std::vector<Values<Byte>> changed(const lightmap::Lightmap& before, const lightmap::Lightmap& after,
                                  std::span<Byte> state) {
  std::vector<const void*> shared;
  lightmap::Lightmap::for_planes(before,
                                 [&](const auto& p) { shared.push_back(p.values().data()); });
  std::vector<Values<Byte>> all;
  std::size_t i = 0;
  lightmap::Lightmap::for_planes(after, [&](const auto& p) {
    if (p.values().data() != shared[i++]) all.push_back(values_of<Byte>(p.values()));
  });
  if (!state.empty()) all.push_back({state, state.size() / after.size()});
  return all;
}

/// Puts the light before the pass back into some texels.
void take_back(const lightmap::Lightmap& before, lightmap::Lightmap& after,
               atlas::TexelRange texels) {
  std::vector<Values<const std::byte>> from;
  lightmap::Lightmap::for_planes(
      before, [&](const auto& p) { from.push_back(values_of<const std::byte>(p.values())); });
  std::size_t i = 0;
  lightmap::Lightmap::for_planes(std::as_const(after), [&](const auto& p) {
    const auto origin = from[i++];
    if (static_cast<const void*>(p.values().data()) == origin.all.data()) return;
    std::ranges::copy(origin.of(texels), values_of<std::byte>(p.values()).of(texels).begin());
  });
}

std::optional<PassPart> read_head(SealedReader& in, const std::string& key) {
  PassPart part;
  std::string found;
  const bool whole = in.magic(kMagic) && in.text(found) && found == key && in.value(part.pass) &&
                     in.value(part.number) && in.value(part.texels.begin) &&
                     in.value(part.texels.end) && in.value(part.rays) && in.value(part.seconds);
  if (!whole) return std::nullopt;
  return part;
}

/// Reads a part; whether it is whole. `take(values, bytes)` gets the texels' bytes in order.
template <class Take>
bool read_values(SealedReader& in, const std::vector<Values<std::byte>>& values,
                 atlas::TexelRange texels, const std::stop_token& stop, const Take& take) {
  constexpr std::size_t kPiece = 1 << 20;
  std::vector<std::byte> buffer(kPiece);
  for (const auto& v : values) {
    std::uint64_t bytes = 0;
    const auto target = v.of(texels);
    if (!in.value(bytes) || bytes != target.size()) return false;
    const bool whole = for_pieces<kPiece>(target, stop, [&](auto piece) {
      if (!in.bytes(buffer.data(), piece.size())) return false;
      take(piece, std::span(buffer).first(piece.size()));
      return true;
    });
    if (!whole) return false;
  }
  return in.sealed();
}

/// Whether these are batches of the pass that come after the first `done` texels.
bool follows(atlas::TexelRange part, std::uint32_t done, const solver::Pass& pass,
             std::uint32_t texels) {
  const bool whole_batches = part.end % pass.batch_texels == 0 || part.end == texels;
  return part.begin == done && part.begin < part.end && part.end <= texels && whole_batches;
}

}  // namespace

proto::Expected<void> write_part(const fs::path& dir, const std::string& key, const PassPart& part,
                                 const lightmap::Lightmap& before, const lightmap::Lightmap& after,
                                 std::span<const std::byte> state, std::stop_token stop) {
  return proto::write_whole(part_file(dir, part.number), [&](const fs::path& temporary) {
    auto done = write_sealed(temporary, kMagic, key, [&](SealedWriter& w) {
      w.value(part.pass), w.value(part.number);
      w.value(part.texels.begin), w.value(part.texels.end);
      w.value(part.rays), w.value(part.seconds);
      for (const auto& values : changed(before, after, state)) {
        const auto bytes = values.of(part.texels);
        w.value(std::uint64_t(bytes.size()));
        w.pieces(bytes, stop);
      }
    });
    if (stop.stop_requested()) return proto::Expected<void>(stopped());
    return done;
  });
}

StoredParts read_parts(const fs::path& dir, const std::string& key, const solver::Pass& pass,
                       const lightmap::Lightmap& before, lightmap::Lightmap& after,
                       std::span<std::byte> state, std::stop_token stop) {
  StoredParts stored;
  const auto filled = pass.fills_state ? state : std::span<std::byte>{};
  const auto values = changed<std::byte>(before, after, filled);
  // Twice: nothing of a part that is damaged may reach the light.
  const auto read = [&](bool keep) -> std::optional<PassPart> {
    std::ifstream file(part_file(dir, stored.count), std::ios::binary);
    SealedReader in(file);
    const auto part = read_head(in, key);
    if (!part || part->pass != pass.index || part->number != stored.count ||
        !follows(part->texels, stored.progress.texels, pass, after.size()))
      return std::nullopt;
    const bool whole = read_values(in, values, part->texels, stop, [&](auto target, auto bytes) {
      if (keep) copy_where_different(bytes, target.data());
    });
    return whole ? part : std::nullopt;
  };
  while (const auto part = read(false)) {
    if (!read(true)) {  // the disk gave another answer
      take_back(before, after, part->texels);
      break;
    }
    ++stored.count;
    stored.progress.texels = part->texels.end;
    stored.progress.rays += part->rays;
    stored.progress.seconds += part->seconds;
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
