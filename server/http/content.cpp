#include "server/http/content.h"

#include <unistd.h>

#include <algorithm>

namespace kiln::http {

ContentPart ContentPart::of(std::string text) {
  ContentPart part;
  part.length = text.size();
  part.bytes = std::move(text);
  return part;
}

ContentPart ContentPart::of(std::shared_ptr<const proto::Fd> file, std::uint64_t length) {
  return {std::move(file), {}, 0, length};
}

std::uint64_t length_of(const Content& content) {
  std::uint64_t length = 0;
  for (const auto& part : content) length += part.length;
  return length;
}

Content slice(const Content& content, std::uint64_t offset, std::uint64_t length) {
  Content cut;
  std::uint64_t begin = 0;
  for (const ContentPart& part : content) {
    const std::uint64_t from = std::max(begin, offset);
    const std::uint64_t to = std::min(begin + part.length, offset + length);
    if (from < to) {
      cut.push_back(part);
      cut.back().offset += from - begin;
      cut.back().length = to - from;
    }
    begin += part.length;
  }
  return cut;
}

std::int64_t read_content(const Content& content, std::uint64_t at, char* out, std::size_t n) {
  for (const ContentPart& part : content) {
    if (at >= part.length) {
      at -= part.length;
      continue;
    }
    const auto want = static_cast<std::size_t>(std::min<std::uint64_t>(n, part.length - at));
    const std::uint64_t from = part.offset + at;
    if (part.file) return ::pread(part.file->get(), out, want, static_cast<off_t>(from));
    std::copy_n(part.bytes.data() + from, want, out);
    return static_cast<std::int64_t>(want);
  }
  return 0;
}

}  // namespace kiln::http
