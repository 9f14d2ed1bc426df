#include "baker/checkpoint/checkpoint.h"

#include <algorithm>
#include <fstream>
#include <utility>

#include "baker/checkpoint/pass_part.h"
#include "baker/checkpoint/sealed_file.h"
#include "proto/files.h"

namespace kiln::checkpoint {
namespace {

namespace fs = std::filesystem;
using proto::Expected;

constexpr Magic kPassMagic{'K', 'I', 'L', 'N', 'P', 'A', 'S', '5'};
constexpr Magic kStateMagic{'K', 'I', 'L', 'N', 'S', 'T', 'A', '1'};
constexpr const char* kPassFiles[] = {"pass_0.bin", "pass_1.bin"};
constexpr const char* kStateFile = "state.bin";
constexpr std::size_t kStateBuffer = 1 << 20;

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

/// The light after a finished pass, as a file holds it.
struct StoredLight {
  std::vector<proto::PassReport> passes;
  std::shared_ptr<const lightmap::Lightmap> light;
};

bool read_light(SealedReader& r, std::uint64_t file_bytes, StoredLight& out) {
  std::uint32_t passes = 0, texels = 0;
  if (!r.value(passes) || passes > file_bytes) return false;
  for (std::uint32_t i = 0; i < passes; ++i)
    if (!read_report(r, out.passes.emplace_back())) return false;
  std::uint64_t texel_bytes = 0;
  const lightmap::Lightmap none;
  lightmap::Lightmap::for_planes(none, [&](const auto& plane) { texel_bytes += sizeof(plane[0]); });
  if (!r.value(texels) || texels * texel_bytes > file_bytes) return false;
  auto light = std::make_shared<lightmap::Lightmap>(texels);
  bool whole = true;
  lightmap::Lightmap::for_planes(*light,
                                 [&](auto& plane) { whole = whole && r.plane(plane.own()); });
  whole = whole && r.sealed();
  out.light = std::move(light);
  return whole;
}

/// Nothing when there is no such file.
Expected<std::optional<StoredLight>> read_pass_file(const fs::path& file, const std::string& key) {
  std::error_code missing;
  const auto size = fs::file_size(file, missing);
  if (missing) return std::nullopt;
  std::ifstream in(file, std::ios::binary);
  SealedReader reader(in);
  std::string found;
  if (!reader.magic(kPassMagic) || !reader.text(found)) return unusable(file, "is damaged");
  if (found != key) return unusable(file, "is of another bake");
  StoredLight stored;
  if (!read_light(reader, size, stored) || stored.passes.empty())
    return unusable(file, "is damaged");
  return stored;
}

proto::Expected<void> read_state(const fs::path& file, const std::string& key,
                                 std::span<std::byte> out, std::stop_token stop) {
  std::ifstream in(file, std::ios::binary);
  SealedReader reader(in);
  std::string found;
  std::uint64_t bytes = 0;
  if (!reader.magic(kStateMagic) || !reader.text(found) || !reader.value(bytes))
    return unusable(file, "is missing or damaged");
  if (found != key || bytes != out.size()) return unusable(file, "is of another bake");
  std::vector<std::byte> buffer(kStateBuffer);
  const bool whole = for_pieces<kStateBuffer>(out, stop, [&](auto piece) {
    if (!reader.bytes(buffer.data(), piece.size())) return false;
    copy_where_different(std::span(buffer).first(piece.size()), piece.data());
    return true;
  });
  if (stop.stop_requested()) return stopped();
  if (!whole || !reader.sealed()) return unusable(file, "is damaged");
  return {};
}

/// Whether the solver would make these passes, in this order; `needs_state` says whether those that
/// follow need what they left in its state.
bool are_passes_of(const solver::Solver& solver, std::span<const proto::PassReport> passes,
                   bool& needs_state) {
  needs_state = false;
  for (std::size_t i = 0; i < passes.size(); ++i) {
    const auto pass = solver.next(passes.first(i));
    if (!pass || pass->name != passes[i].name || passes[i].index != i) return false;
    needs_state = (needs_state || pass->fills_state) && !pass->completes;
  }
  return true;
}

}  // namespace

proto::Expected<void> write_checkpoint(const fs::path& dir, const std::string& key,
                                       std::span<const proto::PassReport> passes,
                                       const lightmap::Lightmap& light, std::stop_token stop) {
  return proto::write_whole(dir / kPassFiles[passes.size() % 2], [&](const fs::path& temporary) {
    auto done = write_sealed(temporary, kPassMagic, key, [&](SealedWriter& w) {
      w.value(std::uint32_t(passes.size()));
      for (const auto& p : passes) write_report(w, p);
      w.value(light.size());
      lightmap::Lightmap::for_planes(light, [&](const auto& plane) {
        w.pieces(std::as_bytes(std::span(plane.values())), stop);
      });
    });
    if (stop.stop_requested()) return proto::Expected<void>(stopped());
    return done;
  });
}

proto::Expected<void> write_state(const fs::path& dir, const std::string& key,
                                  std::span<const std::byte> state, std::stop_token stop) {
  const fs::path file = dir / kStateFile, temporary = dir / ".state.part";
  auto done = write_sealed(temporary, kStateMagic, key, [&](SealedWriter& w) {
    w.value(std::uint64_t(state.size()));
    w.pieces(state, stop);
  });
  if (stop.stop_requested()) done = stopped();
  std::error_code error;
  if (done) fs::rename(temporary, file, error);
  if (error) done = proto::fail("io_error", "Can't rename to state.bin: " + error.message() + ".");
  if (!done) fs::remove(temporary, error);
  return done;
}

proto::Expected<std::optional<solver::SolveStart>> read_checkpoint(const fs::path& dir,
                                                                   const std::string& key,
                                                                   solver::Solver& solver,
                                                                   std::uint32_t texels,
                                                                   std::stop_token stop) {
  auto first = read_pass_file(dir / kPassFiles[0], key);
  auto second = read_pass_file(dir / kPassFiles[1], key);
  const auto passes = [](const auto& stored) {
    return stored && *stored ? (*stored)->passes.size() : 0;
  };
  if (passes(first) < passes(second)) std::swap(first, second);
  if (passes(first) == 0) {
    if (!first) return proto::Unexpected(first.error());
    if (!second) return proto::Unexpected(second.error());
    return std::nullopt;
  }
  solver::SolveStart start{std::move((*first)->passes), std::move((*first)->light)};
  bool needs_state = false;
  if (start.light->size() != texels || !are_passes_of(solver, start.passes, needs_state))
    return unusable(dir / kPassFiles[start.passes.size() % 2], "is of another bake");
  if (needs_state)
    if (auto ok = read_state(dir / kStateFile, key, solver.state(), stop); !ok)
      return proto::Unexpected(ok.error());
  return start;
}

void remove_checkpoints(const fs::path& dir) {
  std::error_code ignored;  // what can't be removed is read, and refused, by the next bake
  for (const char* name : {kPassFiles[0], kPassFiles[1], kStateFile})
    fs::remove(dir / name, ignored);
  remove_parts(dir);
}

}  // namespace kiln::checkpoint
