#include "baker/image/image.h"

#include <dlfcn.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <stdexcept>

#include "baker/exec/stop.h"

namespace kiln::image {
namespace {

namespace fs = std::filesystem;
using proto::Expected;
using proto::Unexpected;

constexpr const char* kModuleFile = "liblightkiln-image.so";

#if defined(__SANITIZE_ADDRESS__)
constexpr bool kLeaksAreSought = true;
#elif defined(__has_feature)
constexpr bool kLeaksAreSought = __has_feature(address_sanitizer);
#else
constexpr bool kLeaksAreSought = false;
#endif

/// The shared libraries behind the module, each after those that it needs. The build lists them
/// with scripts/load-order.
constexpr const char* kLibraries[] = {
#include <image_load_order.inc>
};

/// Opens the libraries behind the module one by one. Each looks its symbols up among the few that
/// it needs; opened with the module they all search all 260, which takes 0.36 s instead of 0.2 s
/// (process time of a program that opens the module and ends). A library that can't be opened on
/// its own is left to the module. LeakSanitizer crashes on the thread-local storage of libraries
/// that were opened so, and a sanitized program has time.
void open_libraries() {
  if constexpr (kLeaksAreSought) return;
  for (const char* const name : kLibraries) ::dlopen(name, RTLD_NOW | RTLD_LOCAL);
}

/// Opens the first of module_paths() that is there.
Expected<const Module*> load() {
  std::error_code error;
  const auto paths = module_paths();
  const auto found = std::find_if(paths.begin(), paths.end(),
                                  [&](const fs::path& path) { return fs::exists(path, error); });
  const auto broken = [](const std::string& why) {
    return proto::fail("internal", "The image module can't be used: " + why + ".");
  };
  if (found == paths.end()) {
    std::string all;
    for (const fs::path& path : paths) all += (all.empty() ? "" : " nor ") + path.string();
    return broken("there is neither " + all);
  }
  open_libraries();
  void* const library = ::dlopen(found->c_str(), RTLD_NOW | RTLD_LOCAL);
  if (library == nullptr) {
    const std::string why = ::dlerror();  // names the file, or another that it needs
    return broken(why.find(kModuleFile) == std::string::npos ? found->string() + ": " + why : why);
  }
  const auto entry = reinterpret_cast<const Module* (*)()>(::dlsym(library, kModuleEntry));
  const Module* const module = entry == nullptr ? nullptr : entry();
  if (module == nullptr || module->interface_version != kInterfaceVersion ||
      std::strcmp(module->version, LIGHTKILN_VERSION) != 0)
    return broken(found->string() + " belongs to another version of the program");
  return module;
}

std::atomic<const Module*> replacement{nullptr};
std::atomic<Expected<void> (*)()> replacement_check{nullptr};

Unexpected unavailable(const Outcome& outcome) {
  return proto::fail("internal", outcome.words);
}

struct Kind {
  std::string_view signature, behind;  ///< first bytes; those from the ninth on
  Format format;
  Expected<Header> (*header)(std::string_view);
};
constexpr std::string_view kTiff[] = {
    {"II\x2a\0", 4}, {"MM\0\x2a", 4}, {"II\x2b\0", 4}, {"MM\0\x2b", 4}};
constexpr Kind kKinds[] = {{"\x89PNG\r\n\x1a\n", "", Format::kPng, png_header},
                           {"\xff\xd8\xff", "", Format::kJpeg, jpeg_header},
                           {"RIFF", "WEBP", Format::kWebp, webp_header},
                           {"\x76\x2f\x31\x01", "", Format::kExr, exr_header},
                           {"#?", "", Format::kHdr, hdr_header},
                           {kTiff[0], "", Format::kTiff, tiff_header},
                           {kTiff[1], "", Format::kTiff, tiff_header},
                           {kTiff[2], "", Format::kTiff, tiff_header},
                           {kTiff[3], "", Format::kTiff, tiff_header}};

const Kind* kind_of(std::string_view bytes) {
  for (const Kind& kind : kKinds)
    if (bytes.starts_with(kind.signature) &&
        bytes.substr(std::min<std::size_t>(8, bytes.size())).starts_with(kind.behind))
      return &kind;
  return nullptr;
}

/// Throws std::bad_alloc when the library may have failed for want of memory. It tells that by
/// errors of its own, which may name it; zlib within says no more than that it failed. Its memory
/// is free again: if that was not enough, as much is not to be had now.
void throw_if_memory_lacks(const std::string& error, std::uint64_t bytes) {
  constexpr std::uint64_t kBeside = 4 << 20, kPiece = 256 << 20;
  if (error.find("std::bad_alloc") != std::string::npos) throw std::bad_alloc();
  std::vector<std::unique_ptr<char[]>> room;
  for (std::uint64_t left = bytes + kBeside; left > 0;) {
    const std::uint64_t piece = std::min(left, kPiece);
    room.push_back(std::make_unique_for_overwrite<char[]>(piece));
    left -= piece;
  }
}

/// Returns the memory that the library needs at most beside our texels: for pictures that are
/// decoded in one go (interlaced, progressive, WebP) three words a pixel.
std::uint64_t working_bytes(const Header& header) {
  constexpr std::uint64_t kCopies = 8, kWholeBytes = 12;
  const bool in_pieces = header.format == Format::kExr || header.format == Format::kHdr ||
                         header.format == Format::kTiff;
  return in_pieces ? kCopies * header.chunk_bytes
                   : kWholeBytes * header.size.width * header.size.height;
}

Source source_of(const Header& header, const std::vector<std::string_view>& parts) {
  constexpr std::uint32_t kRowBytes = 1 << 20;
  const std::uint32_t rows = header.chunk_bytes > 0
                                 ? header.rows
                                 : std::max(1u, kRowBytes / (8 * std::max(1u, header.size.width)));
  return {header.format, parts, header.size.width, header.size.height, rows, header.layer};
}

/// Turns the outcome of a decoder into a result of ours.
Expected<std::string> result(const Header& header, Outcome outcome) {
  if (outcome.end == Outcome::End::kStopped) return exec::canceled();
  if (outcome.end == Outcome::End::kWhole) return std::move(outcome.words);
  if (outcome.end == Outcome::End::kUnavailable) return unavailable(outcome);
  throw_if_memory_lacks(outcome.words, working_bytes(header));
  return invalid_image(outcome.words);
}

/// Returns true for words of the library that tell of data that is missing or wrong. It tells only
/// the first thing that it meets, so bytes too many in the middle of the data count, too.
bool is_damage(std::string_view words) {
  return words.starts_with("Corrupt JPEG data") || words.starts_with("Premature end");
}

}  // namespace

std::vector<fs::path> module_paths() {
  std::error_code error;
  const fs::path folder = fs::read_symlink("/proc/self/exe", error).parent_path();
  return {folder / kModuleFile, folder.parent_path() / "lib" / "lightkiln" / kModuleFile};
}

void ignore_environment() {
  for (const char* name : {"OIIO_LIBRARY_PATH", "OPENIMAGEIO_OPTIONS", "OPENIMAGEIO_THREADS",
                           "CUE_THREADS", "OPENIMAGEIO_LOG_TIMES", "OPENIMAGEIO_DEBUG"})
    ::unsetenv(name);
}

/// The module stays open to the end of the program: the libraries behind it don't all take leave.
Expected<const Module*> module() {
  if (const Module* const other = replacement.load()) return other;
  static const Expected<const Module*> opened = load();
  return opened;
}

void use_module(const Module* other, Expected<void> (*check)()) {
  replacement.store(other);
  replacement_check.store(check);
}

Expected<void> open_module() {
  if (const auto opened = module(); !opened) return Unexpected(opened.error());
  const auto check = replacement_check.load();
  return check == nullptr ? Expected<void>() : check();
}

std::optional<Format> format_of(std::string_view bytes) {
  const Kind* const kind = kind_of(bytes);
  return kind == nullptr ? std::nullopt : std::optional(kind->format);
}

Expected<Header> read_header(std::string_view bytes) {
  const Kind* const kind = kind_of(bytes);
  if (kind == nullptr) throw std::invalid_argument("read_header: no picture");
  return kind->header(bytes);
}

Expected<std::string> decode_rgba8(const Header& header, Texels texels,
                                   const std::stop_token& stop) {
  if (!header.flaw.empty()) return invalid_image(header.flaw);
  const auto library = module();
  if (!library) return Unexpected(library.error());
  auto said = result(header, (*library)->read_rgba8(source_of(header, header.parts), texels, stop));
  if (!said) return said;
  if (!header.alpha_parts.empty()) {
    const auto alpha = result(
        header, (*library)->read_alpha8(source_of(header, header.alpha_parts), texels, stop));
    if (!alpha) return alpha;
  }
  return is_damage(*said) ? *said : "";
}

Expected<void> decode_rgb(Header& header, std::span<math::Rgb> rgb, std::span<float> alpha,
                          const std::stop_token& stop) {
  if (!header.flaw.empty()) return invalid_image(header.flaw);
  const auto library = module();
  if (!library) return Unexpected(library.error());
  if (header.format == Format::kHdr)
    if (auto unfolded = unfold_old_runs(header, stop); !unfolded) return unfolded;
  auto said =
      result(header, (*library)->read_rgb(source_of(header, header.parts), rgb, alpha, stop));
  if (!said) return Unexpected(said.error());
  if (header.exposure == 1) return {};
  const double per_exposure = 1 / header.exposure;
  for (math::Rgb& c : rgb)
    c = {float(double(c.r) * per_exposure), float(double(c.g) * per_exposure),
         float(double(c.b) * per_exposure)};
  return {};
}

Expected<void> encode_exr(const ExrPlan& plan, FloatRows& pixels, Sink& sink,
                          const std::stop_token& stop) {
  const auto library = module();
  if (!library) return Unexpected(library.error());
  const Outcome outcome = (*library)->write_exr(plan, pixels, sink, stop);
  if (outcome.end == Outcome::End::kStopped) return exec::canceled();
  if (outcome.end == Outcome::End::kWhole) return {};
  if (outcome.end == Outcome::End::kUnavailable) return unavailable(outcome);
  if (outcome.words.find("std::bad_alloc") != std::string::npos) throw std::bad_alloc();
  return proto::fail("io_error", "cannot write an EXR file: " + outcome.words);
}

Expected<std::string> encode_png(std::span<const std::uint8_t> samples, std::uint32_t width,
                                 std::uint32_t height, int channels) {
  if (width == 0 || samples.size() != std::size_t(width) * height * std::size_t(channels))
    throw std::invalid_argument("encode_png: the size does not fit the samples");
  const auto library = module();
  if (!library) return Unexpected(library.error());
  struct Memory final : Sink {
    std::string bytes;
    bool full = false;
    bool write(std::uint64_t at, const void* from, std::size_t size) override {
      try {
        bytes.resize(std::max<std::size_t>(bytes.size(), at + size));
        std::memcpy(bytes.data() + at, from, size);
      } catch (const std::bad_alloc&) {  // must not fly through C
        full = true;
      }
      return !full;
    }
  } memory;
  const Outcome outcome = (*library)->write_png(samples, width, height, channels, memory);
  if (memory.full) throw std::bad_alloc();
  if (outcome.end == Outcome::End::kWhole) return std::move(memory.bytes);
  if (outcome.end == Outcome::End::kUnavailable) return unavailable(outcome);
  return proto::fail("internal", "cannot encode a PNG: " + outcome.words);
}

}  // namespace kiln::image
