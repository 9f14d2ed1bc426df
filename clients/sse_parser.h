#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "proto/event.h"

namespace kiln::clients {

/// Parses a text/event-stream as its bytes arrive, in pieces of any size (WHATWG HTML, "server-sent
/// events"). It is not thread-safe.
class SseParser {
 public:
  static constexpr std::size_t kMaxEventBytes = 16u << 20;

  /// The parser calls it for each whole event. It returns false to stop.
  using Handler = std::function<bool(const proto::Event&)>;

  /// Parses more bytes. Returns false when the handler stopped, or when an event grew beyond
  /// kMaxEventBytes (see overflowed()).
  bool feed(std::string_view bytes, const Handler&);

  /// Prepares for the bytes of a new connection. It drops an incomplete event and keeps the ids.
  void reconnect();

  std::uint64_t last_id() const { return last_id_; }  ///< 0: none seen
  std::optional<std::uint32_t> retry_ms() const { return retry_ms_; }
  bool overflowed() const { return overflowed_; }

 private:
  std::string line_, type_, data_;
  std::uint64_t id_ = 0, last_id_ = 0;
  std::optional<std::uint32_t> retry_ms_;
  bool has_data_ = false;
  bool after_return_ = false;  ///< the last byte was '\r', so a '\n' now belongs to it
  bool first_line_ = true;
  bool overflowed_ = false;

  bool end_line(const Handler&);
  void field(std::string_view name, std::string_view value);
  bool dispatch(const Handler&);
};

}  // namespace kiln::clients
