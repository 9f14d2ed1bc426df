#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <stop_token>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "baker/image/header.h"
#include "baker/image/module.h"
#include "proto/expected.h"

namespace kiln::image {

// Encoded pictures, from and to memory. Headers are read here; pixels by OpenImageIO, which is
// opened at first use: it lies in liblightkiln-image.so, beside the program or in ../lib/lightkiln,
// and takes a fifth of a second and 126 MiB. A service and `lightkiln bake` have other processes do
// that (use_module()). All functions are safe to call from many threads. Those that decode or
// encode have the error `internal` when the module can't be opened, which names the file, or when
// the other process ends.

/// Tells the format of a file by its first bytes; nothing for all others, which nothing here reads.
std::optional<Format> format_of(std::string_view bytes);

/// Reads what the file says of itself and takes no memory for pixels. Refuses files that no size
/// makes readable.
/// `format_of(bytes)` must be something. Errors: `invalid_image`.
proto::Expected<Header> read_header(std::string_view bytes);

/// Fills `texels`, one per pixel of header.size. PNG, JPEG and WebP: gray becomes RGB, palettes
/// become colors, 16 bits per channel are rounded to 8; colors are neither converted nor multiplied
/// by alpha, which is 255 where there is none. Returns what is damaged in a picture of which only a
/// part could be read, "" for a whole one. Throws std::bad_alloc where memory lacks, also where the
/// library makes another error of that.
/// Errors: `invalid_image` with the library's reason, `canceled`, `internal`.
proto::Expected<std::string> decode_rgba8(const Header& header, Texels texels,
                                          const std::stop_token&);

/// Fills `rgb`, one per pixel of header.size, with the numbers of an OpenEXR, Radiance or TIFF file
/// by its own primaries, an EXPOSURE taken out again. `alpha` may be empty; it is 1 where there is
/// none. Throws and errors as above.
proto::Expected<void> decode_rgb(Header& header, std::span<math::Rgb> rgb, std::span<float> alpha,
                                 const std::stop_token&);

/// Writes an OpenEXR file of one part in tiles, ZIP-compressed, `metadata` as text attributes; its
/// bytes depend on the arguments only. Errors: `canceled`, `internal`, and `io_error`
/// when the sink fails.
proto::Expected<void> encode_exr(const ExrPlan&, FloatRows&, Sink&, const std::stop_token&);

/// Returns PNG bytes of an 8-bit picture of 3 (RGB) or 4 (RGBA, straight) channels, row 0 = top.
/// Carries no color space, so that no reader converts values; the bytes depend on the arguments
/// only.
proto::Expected<std::string> encode_png(std::span<const std::uint8_t> samples, std::uint32_t width,
                                        std::uint32_t height, int channels);

/// Opens the module now instead of at first use. After use_module() it returns at once, and asks
/// the check that was given there. Errors: `internal`.
proto::Expected<void> open_module();
/// Returns the functions that this process uses. Opens the module unless use_module() gave others.
/// Errors: `internal`.
proto::Expected<const Module*> module();
/// Lets this process use other functions than those of the module, which it then never opens. Null:
/// it uses the module again. The table must outlive all calls of the functions here, and no such
/// call may run meanwhile. `check` tells at once whether anything is known against the functions.
void use_module(const Module*, proto::Expected<void> (*check)() = nullptr);
/// Returns the places where the module is looked for, first to last.
std::vector<std::filesystem::path> module_paths();
/// OpenImageIO reads options and plug-ins from the environment; takes those variables away. To be
/// called before there are other threads.
void ignore_environment();

}  // namespace kiln::image
