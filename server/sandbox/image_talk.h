#pragma once

#include <chrono>
#include <cstdint>
#include <span>
#include <stop_token>
#include <vector>

#include "baker/image/module.h"
#include "server/sandbox/image_wire.h"

namespace kiln::sandbox {

/// One call with its bytes, as this process holds them.
struct ImageCall {
  ImageHead head;
  std::vector<std::span<const char>> input;  ///< parts of the file, or samples
  image::FloatRows* rows = nullptr;          ///< of kWriteExr
  image::Sink* sink = nullptr;               ///< of functions that write
  std::vector<std::span<char>> pixels;       ///< of functions that read: gets what was decoded
};

/// Holds this process's side of the talk over `socket`, which must not block. Checks every number
/// that arrives. Returns the outcome of the call; kUnavailable without words when the other side
/// went; kUnavailable with words when it broke the rules of the talk or fell silent for
/// `silence`. Throws std::bad_alloc when the other side had too little memory.
image::Outcome hold_image_talk(const ImageCall&, int socket, const std::stop_token&,
                               std::chrono::milliseconds silence = std::chrono::minutes(5));

/// Returns the bytes of all spans.
std::uint64_t bytes_of(const auto& spans) {
  std::uint64_t all = 0;
  for (const auto& span : spans) all += span.size();
  return all;
}
/// Returns the bytes of the floats of `rows` rows of an EXR page.
std::uint64_t bytes_of_rows(const ImageHead&, std::uint64_t rows);

}  // namespace kiln::sandbox
