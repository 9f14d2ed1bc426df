#include "server/http/body.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <string_view>

namespace kiln::http {
namespace {

constexpr std::size_t kMaxTrailers = 64;

}  // namespace

BodyReader::BodyReader(const RequestHead& head, Source source)
    : source_(std::move(source)), left_(head.content_length.value_or(0)) {
  state_ = head.chunked ? State::kChunkSize : left_ > 0 ? State::kLength : State::kDone;
}

ssize_t BodyReader::read(char* out, std::size_t n) {
  started_ = true;
  if (state_ == State::kChunkSize && !read_chunk_size()) state_ = State::kBroken;
  if (state_ == State::kDone || n == 0) return 0;
  if (state_ == State::kBroken) return -1;
  return read_plain(out, n);
}

ssize_t BodyReader::read_plain(char* out, std::size_t n) {
  const ssize_t got = source_(out, static_cast<std::size_t>(std::min<std::uint64_t>(n, left_)));
  if (got <= 0) {
    state_ = State::kBroken;
    return -1;
  }
  left_ -= static_cast<std::uint64_t>(got);
  if (left_ == 0) state_ = state_ == State::kLength ? State::kDone : State::kChunkSize;
  return got;
}

// A line up to CRLF, without it. False when it is longer than the capacity.
bool BodyReader::read_line(char* line, std::size_t capacity, std::size_t& length) {
  for (length = 0; length < capacity; ++length) {
    if (source_(line + length, 1) != 1) return false;
    if (line[length] != '\n') continue;
    if (length == 0 || line[length - 1] != '\r') return false;
    --length;
    return true;
  }
  return false;
}

bool BodyReader::read_chunk_size() {
  std::array<char, 256> line{};
  std::size_t length = 0;
  if (!first_chunk_ && (!read_line(line.data(), 2, length) || length != 0)) return false;
  first_chunk_ = false;
  if (!read_line(line.data(), line.size(), length)) return false;
  const auto parsed = std::from_chars(line.data(), line.data() + length, left_, 16);
  if (parsed.ec != std::errc()) return false;
  const char* end = line.data() + length;
  if (parsed.ptr != end && *parsed.ptr != ';' && *parsed.ptr != ' ') return false;
  if (left_ == 0) return read_trailers();
  state_ = State::kChunkData;
  return true;
}

bool BodyReader::read_trailers() {
  std::array<char, 512> line{};
  std::size_t length = 0;
  for (std::size_t i = 0; i < kMaxTrailers; ++i) {
    if (!read_line(line.data(), line.size(), length)) return false;
    if (length != 0) continue;
    state_ = State::kDone;
    return true;
  }
  return false;
}

}  // namespace kiln::http
