#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "proto/event.h"

namespace kiln::clients {

/// Takes a text/event-stream apart as its bytes arrive, in pieces of any size
/// (WHATWG HTML, "server-sent events"). Not thread-safe.
class SseParser {
 public:
  static constexpr std::size_t kMaxEventBytes = 16u << 20;

  /// Called for each whole event; returns false to stop.
  using Handler = std::function<bool(const proto::Event&)>;

  /// False when the handler stopped, or when an event grew beyond kMaxEventBytes (overflowed()).
  bool feed(std::string_view bytes, const Handler&);

  /// To be called before the bytes of a new connection: a half event is dropped, ids are kept.
  void reconnect();

  std::uint64_t last_id() const { return last_id_; }  ///< 0: none seen
  std::optional<std::uint32_t> retry_ms() const { return retry_ms_; }
  bool overflowed() const { return overflowed_; }

 private:
  std::string line_, type_, data_;
  std::uint64_t id_ = 0, last_id_ = 0;
  std::optional<std::uint32_t> retry_ms_;
  bool has_data_ = false;
  bool after_return_ = false;  ///< the last byte was '\r': a '\n' now belongs to it
  bool first_line_ = true;
  bool overflowed_ = false;

  bool end_line(const Handler&);
  void field(std::string_view name, std::string_view value);
  bool dispatch(const Handler&);
};

}  // namespace kiln::clients
