#include <fcntl.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstdio>
#include <filesystem>
#include <functional>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "baker/trace/ray_scene.h"
#include "baker/visibility/pairs.h"
#include "proto/files.h"
#include "proto/json.h"
#include "server/cli/commands.h"
#include "server/cli/interrupt.h"
#include "server/cli/report.h"
#include "server/cli/side_files.h"
#include "server/sandbox/importer.h"

namespace kiln::cli {
namespace {

using proto::Expected;
using proto::Unexpected;
using Clock = std::chrono::steady_clock;

struct VisibilityFlags {
  std::string scene, pairs, bits;
  std::vector<std::string> side;
  unsigned threads = 0;
  bool quiet = false, json = false;
};

struct Figures {
  std::uint64_t pairs = 0, visible = 0;
  double trace_seconds = 0;

  double rays_per_second() const { return trace_seconds > 0 ? double(pairs) / trace_seconds : 0; }
};

/// Reads the scene and builds its tree.
Expected<trace::RayScene> read_rays(const VisibilityFlags& flags, const std::stop_token& stop) {
  std::error_code error;
  if (!std::filesystem::is_regular_file(flags.scene, error))
    return proto::fail("missing_file", "there is no file " + flags.scene);
  auto side = all_side_files(flags.scene, flags.side);
  if (!side) return Unexpected(side.error());
  sandbox::Importer::Options importing;
  importing.process.zygote = std::make_shared<sandbox::Zygote>(sandbox::Zygote::Options{});
  importing.decodes_images = side->images;
  const auto scene = sandbox::Importer(importing)
                         .open({flags.scene, std::move(side->files), {}}, {}, {})
                         ->import(stop);
  if (!scene) return Unexpected(scene.error());
  return trace::RayScene::build(*scene, stop);
}

Expected<proto::Fd> open_pairs(const std::string& path) {
  proto::Fd file(path == "-" ? ::dup(STDIN_FILENO) : ::open(path.c_str(), O_RDONLY | O_CLOEXEC));
  if (file.valid()) return file;
  return proto::fail("missing_file", "can't read the pairs: " + path);
}

/// Reads up to so many bytes; fewer at the end of the file only.
Expected<std::string> read_piece(int fd, std::size_t most, const std::string& path) {
  std::string piece(most, '\0');
  std::size_t size = 0;
  while (size < most) {
    const ssize_t got = ::read(fd, piece.data() + size, most - size);
    if (got < 0 && errno == EINTR) continue;
    if (got < 0) return proto::storage_error("read", path);
    if (got == 0) break;
    size += std::size_t(got);
  }
  piece.resize(size);
  return piece;
}

/// Answers the pairs piece by piece: any number of them takes the memory of a million.
Expected<Figures> answer_all(const VisibilityFlags& flags, int pairs, int bits,
                             const trace::RayScene& rays, const exec::Workers& workers) {
  constexpr std::size_t kPiece = std::size_t{visibility::kMostPairs} * visibility::kPairBytes;
  static_assert(visibility::kMostPairs % 8 == 0, "pieces end with whole bytes");
  Figures all;
  for (bool more = true; more;) {
    const auto piece = read_piece(pairs, kPiece, flags.pairs);
    if (!piece) return Unexpected(piece.error());
    more = piece->size() == kPiece;
    if (auto ok = visibility::check_pairs(*piece, workers, all.pairs); !ok)
      return proto::fail(ok.error().code, flags.pairs + ": " + ok.error().message);
    const auto began = Clock::now();
    const auto answer = visibility::see(rays, *piece, workers);
    if (!answer) return Unexpected(answer.error());
    all.trace_seconds += std::chrono::duration<double>(Clock::now() - began).count();
    all.pairs += piece->size() / visibility::kPairBytes;
    all.visible += answer->visible;
    if (auto ok = proto::write_all(bits, answer->bits, flags.bits); !ok)
      return Unexpected(ok.error());
  }
  return all;
}

Expected<Figures> see_pairs(const VisibilityFlags& flags, const std::stop_token& stop) {
  const auto pairs = open_pairs(flags.pairs);
  if (!pairs) return Unexpected(pairs.error());
  const auto rays = read_rays(flags, stop);
  if (!rays) return Unexpected(rays.error());
  exec::ThreadPool pool(flags.threads != 0 ? flags.threads
                                           : std::max(1u, std::thread::hardware_concurrency()));
  const auto write = [&](int bits) {
    return answer_all(flags, pairs->get(), bits, *rays, {pool, stop});
  };
  if (flags.bits == "-") return write(STDOUT_FILENO);
  Expected<Figures> figures;
  const auto written =
      proto::write_whole(flags.bits, [&](const std::filesystem::path& temporary) -> Expected<void> {
        const proto::Fd file(
            ::open(temporary.c_str(), O_CREAT | O_TRUNC | O_WRONLY | O_CLOEXEC, 0666));
        if (!file.valid()) return proto::storage_error("create", temporary);
        figures = write(file.get());
        if (!figures) return Unexpected(figures.error());
        return {};
      });
  if (!written) return Unexpected(written.error());
  return figures;
}

void print(const VisibilityFlags& flags, const Figures& figures) {
  std::FILE* const out = flags.bits == "-" ? stderr : stdout;
  if (flags.json) {
    const nlohmann::json document{{"pairs", figures.pairs},
                                  {"visible", figures.visible},
                                  {"trace_seconds", figures.trace_seconds},
                                  {"rays_per_second", figures.rays_per_second()}};
    std::fprintf(out, "%s\n", proto::to_text(document, 2).c_str());
  } else if (!flags.quiet) {
    std::fprintf(out, "%s: %llu pairs, %llu see each other, %.3g million rays/s\n",
                 flags.bits.c_str(), static_cast<unsigned long long>(figures.pairs),
                 static_cast<unsigned long long>(figures.visible),
                 figures.rays_per_second() * 1e-6);
  }
}

int run_visibility(const VisibilityFlags& flags) {
  const Interrupt interrupt;  // made before all threads, which inherit the signal mask
  const auto figures = see_pairs(flags, interrupt.token());
  if (!figures) return report(figures.error());
  print(flags, *figures);
  return kDone;
}

}  // namespace

void add_visibility(CLI::App& app, Run& run) {
  auto flags = std::make_shared<VisibilityFlags>();
  auto* command = app.add_subcommand("visibility", "Tell which pairs of points see each other");
  command->add_option("scene", flags->scene, "The scene: .glb, or .gltf with the files it names")
      ->required()
      ->type_name("FILE");
  command->add_option("--pairs", flags->pairs, "The file of pairs; - for standard input")
      ->required()
      ->type_name("FILE");
  command->add_option("-o,--out", flags->bits, "The file of bits to write; - for standard output")
      ->required()
      ->type_name("FILE");
  command
      ->add_option("--side", flags->side,
                   "A file that the scene needs and that does not lie beside it; may be given many "
                   "times")
      ->type_name("FILE")
      ->take_all();
  command->add_option("--threads", flags->threads, "Threads that trace; 0: one per processor")
      ->check(CLI::Range(0u, 1024u))
      ->type_name("N")
      ->envname("LIGHTKILN_THREADS")
      ->capture_default_str();
  command->add_flag("-q,--quiet", flags->quiet, "Print errors only");
  command->add_flag("--json", flags->json, "Print the figures as JSON");
  command->footer(
      R"(A pair is six little-endian 32-bit floats: x, y, z of the one point, then of the other, in meters,
in the world space of the scene. It becomes one bit: bit i % 8 of byte i / 8, where bit 0 is worth 1,
is 1 when nothing lies between the two points of pair i. The last byte is filled up with 0.

What is nearer to one of the points than about 32 ulp of its largest coordinate does not count, so
points may lie on surfaces. Materials play no part: glass and foliage block as walls do.

The figures go to standard error where the bits go to standard output.

Examples:
  lightkiln visibility room.glb --pairs pairs.bin -o bits.bin
  make-pairs | lightkiln visibility room.glb --pairs - -o - >bits.bin)");
  command->callback([flags, &run] { run = [flags] { return run_visibility(*flags); }; });
}

}  // namespace kiln::cli
