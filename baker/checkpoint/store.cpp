#include "baker/checkpoint/store.h"

#include <algorithm>
#include <fstream>
#include <utility>

#include "baker/checkpoint/parts.h"
#include "baker/checkpoint/sealed_file.h"
#include "proto/files.h"

namespace kiln::checkpoint {
namespace {

namespace fs = std::filesystem;
using lightmap::Lightmap;
using lightmap::PlaneId;
using proto::Expected;

constexpr Magic kPassMagic{'K', 'I', 'L', 'N', 'P', 'A', 'S', '6'};
constexpr Magic kSharedMagic{'K', 'I', 'L', 'N', 'S', 'T', 'A', '2'};
constexpr const char* kPassFiles[] = {"pass_0.bin", "pass_1.bin"};
constexpr const char* kSharedFile = "state.bin";
constexpr std::size_t kBuffer = 1 << 20;

void write_report(SealedWriter& w, const proto::PassReport& p) {
  w.text(p.name);
  w.value(p.index);
  w.value(p.residual);
  w.value(p.mean_lx);
  w.value(p.seconds);
  w.value(p.rays);
  w.value(std::uint8_t(p.standard_error.has_value()));
  w.value(p.standard_error.value_or(0));
}

bool read_report(SealedReader& r, proto::PassReport& p) {
  std::uint8_t judged = 0;
  double error = 0;
  const bool whole = r.text(p.name) && r.value(p.index) && r.value(p.residual) &&
                     r.value(p.mean_lx) && r.value(p.seconds) && r.value(p.rays) &&
                     r.value(judged) && r.value(error);
  if (judged != 0) p.standard_error = error;
  return whole;
}

/// Returns the planes that the file of a pass holds.
lightmap::PlaneSet stored_planes(const Lightmap& light) {
  return light.planes() & ~lightmap::shared_planes();
}

/// Reads some planes of a light. Returns false when the file ends too early, or on a stop request.
bool read_planes(SealedReader& r, Lightmap& light, const lightmap::PlaneSet& planes,
                 const std::stop_token& stop) {
  std::vector<std::byte> buffer(kBuffer);
  bool whole = true;
  Lightmap::for_planes(light, planes, [&](PlaneId id, auto& plane) {
    const auto target = plane.bytes(0, light.size());
    whole = whole && for_pieces<kBuffer>(target, stop, [&](auto piece) {
              const auto read = std::span(buffer).first(piece.size());
              if (!r.bytes(read.data(), read.size())) return false;
              if (!are_sane(id, read, light.size())) return false;
              lightmap::copy_where_different(read, piece.data());
              return true;
            });
  });
  return whole;
}

/// Reads what follows the key into `out`, whose light is that with which the solver begins.
bool read_light(SealedReader& r, std::uint64_t file_bytes, std::vector<proto::PassReport>& passes,
                Lightmap& light, const std::stop_token& stop) {
  std::uint32_t count = 0, texels = 0;
  std::uint64_t planes = 0;
  if (!r.value(count) || count > file_bytes) return false;
  for (std::uint32_t i = 0; i < count; ++i)
    if (!read_report(r, passes.emplace_back())) return false;
  const auto stored = stored_planes(light);
  return r.value(texels) && texels == light.size() && r.value(planes) &&
         planes == stored.to_ullong() && read_planes(r, light, stored, stop) && r.sealed();
}

/// Reads the file of a pass. Returns nothing when there is no such file.
Expected<std::optional<solver::SolveStart>> read_pass_file(const fs::path& file,
                                                           const std::string& key,
                                                           const solver::Solver& solver,
                                                           std::uint32_t texels,
                                                           const std::stop_token& stop) {
  std::error_code missing;
  const auto size = fs::file_size(file, missing);
  if (missing) return std::nullopt;
  std::ifstream in(file, std::ios::binary);
  SealedReader reader(in);
  Magic magic{};
  std::string found;
  if (!reader.bytes(magic.data(), magic.size())) return unusable(file, "is damaged");
  if (magic != kPassMagic && std::equal(magic.begin(), magic.end() - 1, kPassMagic.begin()))
    return unusable(file, "is of another version");
  if (magic != kPassMagic || !reader.text(found)) return unusable(file, "is damaged");
  if (found != key) return unusable(file, "is of another bake");
  auto light = std::make_shared<Lightmap>(texels, solver.state_planes());
  solver::SolveStart stored;
  if (!read_light(reader, size, stored.passes, *light, stop) || stored.passes.empty())
    return stop.stop_requested() ? proto::canceled() : unusable(file, "is damaged");
  stored.light = std::move(light);
  return stored;
}

/// Reads the shared planes into a light.
Expected<void> read_shared(const fs::path& file, const std::string& key, Lightmap& light,
                           const std::stop_token& stop) {
  std::ifstream in(file, std::ios::binary);
  SealedReader reader(in);
  std::string found;
  std::uint64_t texel_bytes = 0;
  const auto planes = light.planes() & lightmap::shared_planes();
  if (!reader.magic(kSharedMagic) || !reader.text(found) || !reader.value(texel_bytes))
    return unusable(file, "is missing or damaged");
  if (found != key || texel_bytes != light.texel_bytes(planes))
    return unusable(file, "is of another bake");
  const bool whole = read_planes(reader, light, planes, stop);
  if (stop.stop_requested()) return proto::canceled();
  if (!whole || !reader.sealed()) return unusable(file, "is damaged");
  return {};
}

/// Returns whether the solver would make these passes, in this order. `needs_shared` tells whether
/// the passes that follow need what these left in shared planes.
bool are_passes_of(const solver::Solver& solver, std::span<const proto::PassReport> passes,
                   bool& needs_shared) {
  needs_shared = false;
  for (std::size_t i = 0; i < passes.size(); ++i) {
    const auto pass = solver.next(passes.first(i));
    if (!pass || pass->plan().name != passes[i].name || passes[i].index != i) return false;
    needs_shared = (needs_shared || fills_shared(pass->plan())) && !pass->plan().completes;
  }
  return true;
}

}  // namespace

proto::Expected<void> write_checkpoint(const fs::path& dir, const std::string& key,
                                       std::span<const proto::PassReport> passes,
                                       const Lightmap& light, std::stop_token stop) {
  return proto::write_whole(dir / kPassFiles[passes.size() % 2], [&](const fs::path& temporary) {
    auto done = write_sealed(temporary, kPassMagic, key, [&](SealedWriter& w) {
      w.value(std::uint32_t(passes.size()));
      for (const auto& p : passes) write_report(w, p);
      w.value(light.size());
      w.value(std::uint64_t(stored_planes(light).to_ullong()));
      Lightmap::for_planes(light, stored_planes(light), [&](PlaneId, const auto& plane) {
        w.pieces(plane.bytes(0, light.size()), stop);
      });
    });
    if (stop.stop_requested()) return proto::Expected<void>(proto::canceled());
    return done;
  });
}

proto::Expected<void> write_shared(const fs::path& dir, const std::string& key,
                                   const Lightmap& light, std::stop_token stop) {
  const auto planes = light.planes() & lightmap::shared_planes();
  const fs::path file = dir / kSharedFile, temporary = dir / ".state.part";
  auto done = write_sealed(temporary, kSharedMagic, key, [&](SealedWriter& w) {
    w.value(std::uint64_t(light.texel_bytes(planes)));
    Lightmap::for_planes(light, planes, [&](PlaneId, const auto& plane) {
      w.pieces(plane.bytes(0, light.size()), stop);
    });
  });
  if (stop.stop_requested()) done = proto::canceled();
  std::error_code error;
  if (done) fs::rename(temporary, file, error);
  if (error) done = proto::fail("io_error", "Can't rename to state.bin: " + error.message() + ".");
  if (!done) fs::remove(temporary, error);
  return done;
}

proto::Expected<std::optional<solver::SolveStart>> read_checkpoint(const fs::path& dir,
                                                                   const std::string& key,
                                                                   const solver::Solver& solver,
                                                                   std::uint32_t texels,
                                                                   std::stop_token stop) {
  auto first = read_pass_file(dir / kPassFiles[0], key, solver, texels, stop);
  auto second = read_pass_file(dir / kPassFiles[1], key, solver, texels, stop);
  const auto passes = [](const auto& stored) {
    return stored && *stored ? (*stored)->passes.size() : 0;
  };
  if (passes(first) < passes(second)) std::swap(first, second);
  if (passes(first) == 0) {
    if (!first) return proto::Unexpected(first.error());
    if (!second) return proto::Unexpected(second.error());
    return std::nullopt;
  }
  solver::SolveStart start = std::move(**first);
  bool needs_shared = false;
  if (!are_passes_of(solver, start.passes, needs_shared))
    return unusable(dir / kPassFiles[start.passes.size() % 2], "is of another bake");
  auto light = std::make_shared<Lightmap>(*start.light);
  start.light = nullptr;
  if (needs_shared)
    if (auto ok = read_shared(dir / kSharedFile, key, *light, stop); !ok)
      return proto::Unexpected(ok.error());
  start.light = std::move(light);
  return start;
}

void remove_checkpoints(const fs::path& dir) {
  std::error_code ignored;  // what can't be removed is read, and refused, by the next bake
  for (const char* name : {kPassFiles[0], kPassFiles[1], kSharedFile})
    fs::remove(dir / name, ignored);
  remove_parts(dir);
}

}  // namespace kiln::checkpoint
