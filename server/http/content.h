#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "proto/files.h"

namespace kiln::http {

/// A part of an answer's content: bytes in memory, or a range of a file.
struct ContentPart {
  std::shared_ptr<const proto::Fd> file;  ///< null: `bytes`
  std::string bytes;
  std::uint64_t offset = 0, length = 0;  ///< within the file or the bytes

  static ContentPart of(std::string bytes);
  static ContentPart of(std::shared_ptr<const proto::Fd>, std::uint64_t length);
};

/// Holds parts, one after the other.
using Content = std::vector<ContentPart>;

std::uint64_t length_of(const Content&);
/// Returns the bytes [offset, offset + length) of the content, which must have them.
Content slice(const Content&, std::uint64_t offset, std::uint64_t length);
/// Reads up to n bytes from `at` on. Returns how many; <= 0 when a file is shorter than it was.
std::int64_t read_content(const Content&, std::uint64_t at, char* out, std::size_t n);

}  // namespace kiln::http
