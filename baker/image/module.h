#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>

#include "baker/math/vec.h"

namespace kiln::image {

enum class Format : std::uint8_t { kPng, kJpeg, kWebp, kExr, kHdr, kTiff };

/// RGBA, 8 bits each, row 0 = top.
using Texels = std::span<std::array<std::uint8_t, 4>>;

/// An encoded picture, and what its header was found to say.
struct Source {
  Format format{};
  std::span<const std::string_view> parts;  ///< the file, in order
  std::uint32_t width = 0, height = 0;
  std::uint32_t rows = 1;  ///< rows at a time; a stop request is looked for in between
  std::string_view layer;  ///< read_rgb, OpenEXR: reads `layer`.R, .G, .B; "": R, G, B
};

/// Takes an encoded file. Returns false when it can't; nothing more is written then.
struct Sink {
  virtual bool write(std::uint64_t at, const void* bytes, std::size_t size) = 0;

 protected:
  ~Sink() = default;
};

struct Outcome {
  /// kUnavailable: the library could not be asked; `words` are a sentence for the user.
  enum class End : std::uint8_t { kWhole, kStopped, kFailed, kUnavailable } end = End::kWhole;
  std::string words;  ///< of the library: why it failed, or what it complained of on the way
};

/// Channels of 32-bit floats, interleaved; `rows(y0, y1)` gives those of the rows [y0, y1).
struct FloatRows {
  virtual std::span<const float> rows(std::uint32_t y0, std::uint32_t y1) = 0;

 protected:
  ~FloatRows() = default;
};
struct ExrPlan {
  std::uint32_t width = 0, height = 0, tile = 0;
  bool half_floats = false;
  std::span<const std::string> channels;
  std::span<const std::pair<std::string, std::string>> metadata;
};

/// Holds all calls into OpenImageIO: liblightkiln-image.so gives such a table, and so does
/// server/sandbox/image_process.h, whose functions ask another process. The functions are safe to
/// call from many threads, open no file and leave no thread behind. They throw std::bad_alloc.
struct Module {
  std::uint32_t interface_version;
  const char* version;  ///< of the program that it belongs to

  /// Colors as they are stored; gray becomes RGB, 16 bits are rounded to 8, alpha is 255 where
  /// there is none.
  Outcome (*read_rgba8)(const Source&, Texels, const std::stop_token&);
  /// Writes nothing but alpha.
  Outcome (*read_alpha8)(const Source&, Texels, const std::stop_token&);
  /// R, G and B of source.layer. Writes A to `alpha`, which is empty or as long; 1 where there is
  /// none.
  Outcome (*read_rgb)(const Source&, std::span<math::Rgb> rgb, std::span<float> alpha,
                      const std::stop_token&);
  Outcome (*write_exr)(const ExrPlan&, FloatRows&, Sink&, const std::stop_token&);
  Outcome (*write_png)(std::span<const std::uint8_t> samples, std::uint32_t width,
                       std::uint32_t height, int channels, Sink&);
};
inline constexpr std::uint32_t kInterfaceVersion = 3;
/// Name of the module's one function, `const Module* ()`.
inline constexpr const char* kModuleEntry = "lightkiln_image_module";

}  // namespace kiln::image
