#include "baker/solver/checkpoint.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstring>
#include <fstream>
#include <functional>
#include <type_traits>
#include <utility>

#include "proto/files.h"

namespace kiln::baker {
namespace {

namespace fs = std::filesystem;
using proto::Expected;

using Magic = std::array<char, 8>;
constexpr Magic kPassMagic{'K', 'I', 'L', 'N', 'P', 'A', 'S', '5'};
constexpr Magic kStateMagic{'K', 'I', 'L', 'N', 'S', 'T', 'A', '1'};
constexpr const char* kPassFiles[] = {"pass_0.bin", "pass_1.bin"};
constexpr const char* kStateFile = "state.bin";
constexpr std::uint32_t kMaxTextBytes = 4096;
constexpr std::size_t kMemoryPage = 4096, kStateBuffer = 256 * kMemoryPage;

class Writer {
 public:
  explicit Writer(std::ofstream& out) : out_(out) {}
  void bytes(const void* data, std::size_t n) {
    out_.write(static_cast<const char*>(data), std::streamsize(n));
    hash_.update({static_cast<const char*>(data), n});
  }
  template <class T>
  void value(T v) {
    static_assert(std::is_arithmetic_v<T>);
    bytes(&v, sizeof v);
  }
  void text(const std::string& s) {
    value(std::uint32_t(s.size()));
    bytes(s.data(), s.size());
  }
  void seal() {
    const auto digest = hash_.digest();
    out_.write(reinterpret_cast<const char*>(digest.data()), std::streamsize(digest.size()));
  }

 private:
  std::ofstream& out_;
  proto::Sha256 hash_;
};

class Reader {
 public:
  explicit Reader(std::ifstream& in) : in_(in) {}
  bool bytes(void* data, std::size_t n) {
    if (!in_.read(static_cast<char*>(data), std::streamsize(n))) return false;
    hash_.update({static_cast<const char*>(data), n});
    return true;
  }
  template <class T>
  bool value(T& v) {
    return bytes(&v, sizeof v);
  }
  bool text(std::string& s) {
    std::uint32_t n = 0;
    if (!value(n) || n > kMaxTextBytes) return false;
    s.resize(n);
    return bytes(s.data(), n);
  }
  template <class T>
  bool plane(std::vector<T>& p) {
    return bytes(p.data(), p.size() * sizeof(T));
  }
  bool magic(const Magic& expected) {
    Magic found;
    return bytes(found.data(), found.size()) && found == expected;
  }
  bool sealed() {
    const auto expected = hash_.digest();
    auto found = expected;
    in_.read(reinterpret_cast<char*>(found.data()), std::streamsize(found.size()));
    return in_ && found == expected;
  }

 private:
  std::ifstream& in_;
  proto::Sha256 hash_;
};

void write_report(Writer& w, const proto::PassReport& p) {
  w.text(p.name);
  w.value(p.index);
  w.value(p.residual);
  w.value(p.mean_lx);
  w.value(p.seconds);
  w.value(p.rays);
  w.value(std::uint8_t(p.standard_error.has_value()));
  w.value(p.standard_error.value_or(0));
}

bool read_report(Reader& r, proto::PassReport& p) {
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
  std::shared_ptr<const Lightmap> light;
};

proto::Unexpected unusable(const fs::path& file, const char* what) {
  return proto::fail("invalid_checkpoint",
                     "The checkpoint " + file.filename().string() + " " + what + ".");
}

bool read_light(Reader& r, std::uint64_t file_bytes, StoredLight& out) {
  std::uint32_t passes = 0, texels = 0;
  if (!r.value(passes) || passes > file_bytes) return false;
  for (std::uint32_t i = 0; i < passes; ++i)
    if (!read_report(r, out.passes.emplace_back())) return false;
  std::uint64_t texel_bytes = 0;
  const Lightmap none;
  Lightmap::for_planes(none, [&](const auto& plane) { texel_bytes += sizeof(plane[0]); });
  if (!r.value(texels) || texels * texel_bytes > file_bytes) return false;
  auto light = std::make_shared<Lightmap>(texels);
  bool whole = true;
  Lightmap::for_planes(*light, [&](auto& plane) { whole = whole && r.plane(plane.own()); });
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
  Reader reader(in);
  std::string found;
  if (!reader.magic(kPassMagic) || !reader.text(found)) return unusable(file, "is damaged");
  if (found != key) return unusable(file, "is of another bake");
  StoredLight stored;
  if (!read_light(reader, size, stored) || stored.passes.empty())
    return unusable(file, "is damaged");
  return stored;
}

/// `use` for one piece after the other. False when it refuses one, or on a stop request.
template <std::size_t kPiece = 16 << 20, class T, class Use>
bool for_pieces(std::span<T> bytes, const std::stop_token& stop, const Use& use) {
  while (!bytes.empty()) {
    const auto piece = bytes.first(std::min(kPiece, bytes.size()));
    if (stop.stop_requested() || !use(piece)) return false;
    bytes = bytes.subspan(piece.size());
  }
  return true;
}

void write_pieces(Writer& w, std::span<const std::byte> bytes, const std::stop_token& stop) {
  for_pieces(bytes, stop, [&](auto piece) {
    w.bytes(piece.data(), piece.size());
    return true;
  });
}

proto::Unexpected stopped() {
  return proto::fail(proto::kCanceledCode, "The job was canceled.");
}

Expected<void> read_state(const fs::path& file, const std::string& key, std::span<std::byte> out,
                          std::stop_token stop) {
  std::ifstream in(file, std::ios::binary);
  Reader reader(in);
  std::string found;
  std::uint64_t bytes = 0;
  if (!reader.magic(kStateMagic) || !reader.text(found) || !reader.value(bytes))
    return unusable(file, "is missing or damaged");
  if (found != key || bytes != out.size()) return unusable(file, "is of another bake");
  std::vector<char> buffer(kStateBuffer);
  const bool whole = for_pieces<kStateBuffer>(out, stop, [&](auto piece) {
    if (!reader.bytes(buffer.data(), piece.size())) return false;
    // Memory that was never written costs nothing, and stays so.
    for (std::size_t at = 0; at < piece.size(); at += kMemoryPage) {
      const auto page = std::span(buffer).subspan(at, std::min(kMemoryPage, piece.size() - at));
      if (std::ranges::any_of(page, [](char c) { return c != 0; }))
        std::memcpy(piece.data() + at, page.data(), page.size());
    }
    return true;
  });
  if (stop.stop_requested()) return stopped();
  if (!whole || !reader.sealed()) return unusable(file, "is damaged");
  return {};
}

/// Writes what `fill` does between a header and the check sum.
Expected<void> write_sealed(const fs::path& file, const Magic& magic, const std::string& key,
                            const std::function<void(Writer&)>& fill) {
  errno = 0;
  std::ofstream out(file, std::ios::binary);
  Writer w(out);
  w.bytes(magic.data(), magic.size());
  w.text(key);
  fill(w);
  w.seal();
  out.close();
  if (out) return {};
  return proto::storage_error("write", file);
}

/// Whether the solver would make these passes, in this order; `needs_state` says whether those that
/// follow need what they left in its state.
bool are_passes_of(const Solver& solver, std::span<const proto::PassReport> passes,
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

Expected<void> write_checkpoint(const fs::path& dir, const std::string& key,
                                std::span<const proto::PassReport> passes, const Lightmap& light,
                                std::stop_token stop) {
  return proto::write_whole(dir / kPassFiles[passes.size() % 2], [&](const fs::path& temporary) {
    auto done = write_sealed(temporary, kPassMagic, key, [&](Writer& w) {
      w.value(std::uint32_t(passes.size()));
      for (const auto& p : passes) write_report(w, p);
      w.value(light.size());
      Lightmap::for_planes(light, [&](const auto& plane) {
        write_pieces(w, std::as_bytes(std::span(plane.values())), stop);
      });
    });
    if (stop.stop_requested()) return Expected<void>(stopped());
    return done;
  });
}

Expected<void> write_state(const fs::path& dir, const std::string& key,
                           std::span<const std::byte> state, std::stop_token stop) {
  const fs::path file = dir / kStateFile, temporary = dir / ".state.part";
  auto done = write_sealed(temporary, kStateMagic, key, [&](Writer& w) {
    w.value(std::uint64_t(state.size()));
    write_pieces(w, state, stop);
  });
  if (stop.stop_requested()) done = stopped();
  std::error_code error;
  if (done) fs::rename(temporary, file, error);
  if (error) done = proto::fail("io_error", "Can't rename to state.bin: " + error.message() + ".");
  if (!done) fs::remove(temporary, error);
  return done;
}

Expected<std::optional<SolveStart>> read_checkpoint(const fs::path& dir, const std::string& key,
                                                    Solver& solver, std::uint32_t texels,
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
  SolveStart start{std::move((*first)->passes), std::move((*first)->light)};
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
}

}  // namespace kiln::baker
