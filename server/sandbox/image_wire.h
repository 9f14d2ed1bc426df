#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "baker/image/module.h"
#include "proto/expected.h"

namespace kiln::sandbox {

// The talk between this program and a process that makes one call of a function of image::Module
// for it, over a socket of bytes. The head of the call comes with the process's request
// (protocol.h). Then this program sends the bytes that the function reads, and the process sends
// messages, of which kEnd or kNoMemory is the last. Only kRows has an answer: the floats of the
// rows, without a head. So one of the two always reads, and neither holds more than a piece of what
// the other has sent.

enum class ImageFunction : std::uint8_t { kReadRgba8, kReadAlpha8, kReadRgb, kWriteExr, kWritePng };

/// The arguments of one call but for its bytes.
struct ImageHead {
  ImageFunction function{};
  std::uint32_t width = 0, height = 0;
  // For functions that read
  image::Format format{};
  std::uint32_t rows = 1;            ///< rows at a time
  bool alpha = false;                ///< kReadRgb: alpha is wanted, too
  std::string layer;                 ///< kReadRgb
  std::vector<std::uint64_t> parts;  ///< bytes of each part of the file
  // For kWriteExr
  std::uint32_t tile = 0;
  bool half_floats = false;
  std::vector<std::string> channels;
  std::vector<std::pair<std::string, std::string>> metadata;
  // For kWritePng
  int samples = 0;  ///< per pixel
};

std::string head_text(const ImageHead&);
/// Errors: `bad_document`.
proto::Expected<ImageHead> parse_head(const std::string& text);

/// Messages of the process.
enum class ImageWord : std::uint32_t {
  kRows,      ///< asks for the floats of the rows [at, size)
  kWrite,     ///< `size` bytes follow, which belong at `at` of the encoded file
  kPixels,    ///< `size` bytes follow: all that was decoded, in the order of the texels
  kEnd,       ///< the call has ended as image::Outcome::End(at); `size` bytes of words follow
  kNoMemory,  ///< the call has ended for want of memory
};
struct ImageMessage {
  ImageWord word{};
  std::uint32_t size = 0;
  std::uint64_t at = 0;
};
inline constexpr std::uint32_t kMaxImagePiece = 1 << 20;  ///< of kWrite and kPixels, bytes
inline constexpr std::uint32_t kMaxImageWords = 1 << 16;  ///< of kEnd, bytes

}  // namespace kiln::sandbox
