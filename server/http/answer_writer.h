#pragma once

#include <memory>

#include "server/http/exchange.h"

namespace kiln::http {

/// Writes answers, by cpp-httplib. Thread-safe.
class AnswerWriter {
 public:
  AnswerWriter();
  ~AnswerWriter();

  enum class End {
    kKeep,    ///< the connection is ready for a next request
    kClose,   ///< it has to end
    kStream,  ///< the head is out; the event stream of the response follows
  };
  /// Writes the exchange's response, waiting for the peer to take it.
  End write(Exchange&);

 private:
  class Library;
  std::unique_ptr<Library> library_;
};

}  // namespace kiln::http
