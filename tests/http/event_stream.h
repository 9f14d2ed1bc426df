#pragma once

#include <functional>
#include <string>
#include <vector>

#include "clients/sse_parser.h"
#include "tests/http/live.h"
#include "tests/support/sanitizer.h"

namespace kiln::test {

/// One open event stream, read as it comes.
class EventStream {
 public:
  /// Asks for the job's events; `last` is sent as Last-Event-ID unless empty.
  EventStream(std::uint16_t port, const std::string& id, const std::string& last = "");
  /// The same of any path, with these header lines.
  EventStream(std::uint16_t port, const std::string& path, const std::vector<std::string>& headers);

  /// Reads until an event of this type has come. Whether it did, in time.
  bool wait_for(const std::string& type,
                std::chrono::milliseconds time = std::chrono::seconds(30) * kSlowdown);
  /// Reads until there is an event; what came with the head counts.
  bool wait_first(std::chrono::milliseconds time = std::chrono::seconds(30) * kSlowdown);
  /// Reads until one more event has come.
  bool wait_next(std::chrono::milliseconds time = std::chrono::seconds(30) * kSlowdown);
  /// Reads until the server ends the stream properly. Whether it did, in time.
  bool wait_end(std::chrono::milliseconds time = std::chrono::seconds(30) * kSlowdown);

  int status() const { return status_; }
  const std::vector<proto::Event>& events() const { return events_; }
  std::vector<std::uint64_t> ids() const;  ///< of the events that have one
  std::size_t count(const std::string& type) const;

 private:
  bool read_until(const std::function<bool()>& done, std::chrono::milliseconds time);
  void take_chunks();

  Wire wire_;
  int status_ = 0;
  std::string bytes_;  ///< not decoded yet
  bool ended_ = false;
  clients::SseParser parser_;
  std::vector<proto::Event> events_;
};

}  // namespace kiln::test
