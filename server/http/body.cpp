#include "server/http/body.h"

#include <algorithm>
#include <array>
#include <charconv>

#include "proto/text_codes.h"

namespace kiln::http {
namespace {

constexpr std::size_t kMaxSizeLine = 256;
constexpr std::size_t kMaxTrailer = 512;
constexpr std::size_t kMaxTrailers = 64;

proto::Unexpected malformed() {
  return proto::fail("bad_request", "The request's body ended early or is malformed.");
}

std::string base64(const std::array<unsigned char, 32>& digest) {
  return proto::base64_encode({reinterpret_cast<const char*>(digest.data()), digest.size()});
}

}  // namespace

BodyDecoder::BodyDecoder(const RequestHead& head) : left_(head.content_length.value_or(0)) {
  state_ = head.chunked ? State::kSize : left_ > 0 ? State::kLength : State::kDone;
}

std::uint64_t BodyDecoder::sure() const {
  return state_ == State::kLength || state_ == State::kData ? left_ : 1;
}

proto::Expected<std::size_t> BodyDecoder::feed(std::string_view bytes, const Take& take) {
  std::size_t used = 0;
  while (used < bytes.size() && !done()) {
    const std::string_view rest = bytes.substr(used);
    const bool is_data = state_ == State::kLength || state_ == State::kData;
    const auto step = is_data ? feed_data(rest, take) : feed_line(rest);
    if (!step) return step;
    used += *step;
  }
  return used;
}

proto::Expected<std::size_t> BodyDecoder::feed_data(std::string_view bytes, const Take& take) {
  const std::string_view data =
      bytes.substr(0, static_cast<std::size_t>(std::min<std::uint64_t>(bytes.size(), left_)));
  if (auto taken = take(data); !taken) return proto::Unexpected(taken.error());
  left_ -= data.size();
  if (left_ == 0) state_ = state_ == State::kLength ? State::kDone : State::kDataEnd;
  return data.size();
}

// Collects a line up to its CRLF.
proto::Expected<std::size_t> BodyDecoder::feed_line(std::string_view bytes) {
  const std::size_t limit = state_ == State::kSize      ? kMaxSizeLine
                            : state_ == State::kDataEnd ? 2
                                                        : kMaxTrailer;
  const auto end = bytes.find('\n');
  const std::size_t take = end == std::string_view::npos ? bytes.size() : end + 1;
  if (line_.size() + take > limit) return malformed();
  line_ += bytes.substr(0, take);
  if (end == std::string_view::npos) return take;
  if (!line_.ends_with("\r\n")) return malformed();
  line_.resize(line_.size() - 2);
  if (auto ok = end_line(); !ok) return proto::Unexpected(ok.error());
  line_.clear();
  return take;
}

proto::Expected<void> BodyDecoder::end_line() {
  switch (state_) {
    case State::kSize:
      return read_size();
    case State::kDataEnd:
      if (!line_.empty()) return malformed();
      state_ = State::kSize;
      return {};
    default:
      if (line_.empty())
        state_ = State::kDone;
      else if (++trailers_ >= kMaxTrailers)
        return malformed();
      return {};
  }
}

proto::Expected<void> BodyDecoder::read_size() {
  const char* end = line_.data() + line_.size();
  const auto parsed = std::from_chars(line_.data(), end, left_, 16);
  if (parsed.ec != std::errc()) return malformed();
  if (parsed.ptr != end && *parsed.ptr != ';' && *parsed.ptr != ' ') return malformed();
  state_ = left_ == 0 ? State::kTrailers : State::kData;
  return {};
}

DigestCheck::DigestCheck(const RequestHead& head) {
  constexpr std::string_view kBegin = "sha-256=:";
  const std::string* header = head.header("content-digest");
  const auto at = header ? header->find(kBegin) : std::string::npos;
  if (at == std::string::npos) return;
  const auto from = at + kBegin.size();
  announced_ = header->substr(from, header->find(':', from) - from);
}

void DigestCheck::update(std::string_view bytes) {
  if (announced_) hash_.update(bytes);
}

proto::Expected<void> DigestCheck::finish() {
  if (!announced_ || base64(hash_.digest()) == *announced_) return {};
  return proto::fail("digest_mismatch", "The body does not have the announced Content-Digest.");
}

}  // namespace kiln::http
