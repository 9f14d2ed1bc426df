#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "proto/expected.h"
#include "proto/sha256.h"
#include "server/http/head.h"

namespace kiln::http {

/// Takes the framing (Content-Length or chunked) off a request's body as its bytes arrive. Bounded
/// memory, however they are cut.
class BodyDecoder {
 public:
  /// Takes a piece of the body. An error ends the body.
  using Take = std::function<proto::Expected<void>(std::string_view)>;

  explicit BodyDecoder(const RequestHead&);

  /// Hands the body's bytes among these on. Returns how many it used: fewer than all of them only
  /// at the end of the body. Errors: `bad_request` when it is malformed; those of `take`.
  proto::Expected<std::size_t> feed(std::string_view bytes, const Take& take);
  bool done() const { return state_ == State::kDone; }  ///< the body is whole
  /// Returns how many bytes are sure to belong to the body, framing included: 1 when that is not
  /// known.
  std::uint64_t sure() const;

 private:
  enum class State { kLength, kSize, kData, kDataEnd, kTrailers, kDone };
  proto::Expected<std::size_t> feed_data(std::string_view bytes, const Take& take);
  proto::Expected<std::size_t> feed_line(std::string_view bytes);
  proto::Expected<void> end_line();
  proto::Expected<void> read_size();

  State state_;
  std::uint64_t left_ = 0;  ///< bytes left of the body or the chunk
  std::string line_;        ///< line of the framing, as far as it has arrived
  std::size_t trailers_ = 0;
};

/// Checks a body against the Content-Digest (RFC 9530) of its head. Algorithms other than SHA-256
/// are ignored.
class DigestCheck {
 public:
  explicit DigestCheck(const RequestHead&);
  void update(std::string_view bytes);
  /// Checks the digest after the last byte. Errors: `digest_mismatch`.
  proto::Expected<void> finish();

 private:
  std::optional<std::string> announced_;  ///< base64
  proto::Sha256 hash_;
};

}  // namespace kiln::http
