#pragma once

#include <cstdint>
#include <string>

#include "server/http/connection.h"
#include "server/http/message.h"

namespace kiln::http {

/// Returns the status line and headers of an answer, with the empty line that ends them. `close`
/// adds Connection: close.
std::string answer_head(const Response&, const std::string& request_id, bool close);

/// An answer on its way to a connection, in as many turns as the peer needs to take it.
class Answer {
 public:
  Answer() = default;
  /// Takes the response's body. `with_body` is false for HEAD. The response lives as long as this.
  Answer(Response&, const std::string& request_id, bool close, bool with_body);

  enum class Sent { kAll, kBlocked, kMore, kBroken };
  /// Sends what the socket takes, up to about `most` bytes. Returns kMore when it would take more.
  Sent send(Connection&, TransferClock&, std::uint64_t most);
  /// Returns what has not been sent of the head.
  std::string rest_of_head() const { return text_.substr(text_at_); }

 private:
  ssize_t send_piece(Connection&, std::uint64_t most);

  const Response* response_ = nullptr;
  std::string text_;  ///< the head, and a body that is short
  std::size_t text_at_ = 0;
  std::uint64_t content_at_ = 0, content_size_ = 0;
};

}  // namespace kiln::http
