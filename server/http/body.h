#pragma once

#include <sys/types.h>

#include <cstddef>
#include <cstdint>
#include <functional>

#include "server/http/head.h"

namespace kiln::http {

/// A request's body, its framing taken off: Content-Length or chunked. Bounded memory.
class BodyReader {
 public:
  /// Takes up to n bytes off the connection; <= 0 when it is closed, too slow or broken.
  using Source = std::function<ssize_t(char*, std::size_t)>;

  BodyReader(const RequestHead&, Source);

  /// Bytes of the body: > 0; 0 at its end; -1 when it is malformed or does not arrive.
  ssize_t read(char* out, std::size_t n);
  bool done() const { return state_ == State::kDone; }  ///< read to its end
  bool started() const { return started_; }

 private:
  enum class State { kLength, kChunkSize, kChunkData, kDone, kBroken };
  ssize_t read_plain(char* out, std::size_t n);
  bool read_chunk_size();
  bool read_line(char* line, std::size_t capacity, std::size_t& length);
  bool read_trailers();

  Source source_;
  State state_;
  std::uint64_t left_ = 0;  ///< of the body or of the chunk
  bool first_chunk_ = true;
  bool started_ = false;
};

}  // namespace kiln::http
