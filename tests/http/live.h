#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "server/service.h"
#include "tests/server/fake_bake.h"
#include "tests/support/temp_files.h"

namespace kiln::test {

/// A service in this process, on free ports and a folder of its own unless the config names one.
struct Live {
  TempFolder folder;
  std::unique_ptr<server::Service> service;

  explicit Live(jobs::BakeFunction bake, base::ServerConfig config = {},
                http::EdgeLimits limits = {}, api::CheckFunction check = {});
  Live(server::ServiceParts parts,
       base::ServerConfig config);  ///< parts without a check take every scene
  std::uint16_t port() const { return service->port(); }
};

/// A blocking TCP client: says exactly the bytes it is told.
class Wire {
 public:
  /// `from`: the address that the connection comes from.
  explicit Wire(std::uint16_t port, const char* from = "127.0.0.1");
  ~Wire();
  Wire(Wire&& other) noexcept : fd_(other.fd_) { other.fd_ = -1; }
  Wire& operator=(Wire&&) = delete;

  bool connected() const { return fd_ >= 0; }
  bool send(std::string_view bytes) const;
  void finish() const;  ///< sends no more, but would read on
  /// Reads until `until` has been seen, the peer closed, or the time is up.
  std::string read(const std::string& until = {},
                   std::chrono::milliseconds time = std::chrono::seconds(5)) const;
  /// Whether the peer closes within the time.
  bool closed(std::chrono::milliseconds time) const;

 private:
  int fd_ = -1;
};

struct Answer {
  int status = 0;
  std::map<std::string, std::string> headers;  ///< names in lower case
  std::string body;
};

/// Reads status line and header lines into the answer; false when they are none.
bool read_head(const std::string& text, Answer&);

/// One request on a connection of its own.
Answer ask(std::uint16_t port, const std::string& method, const std::string& target,
           const std::vector<std::string>& headers = {}, const std::string& body = {});

/// A multipart/form-data body with boundary `B`; parts: (disposition, content).
std::string form(const std::vector<std::pair<std::string, std::string>>& parts);
inline const std::string kForm = "Content-Type: multipart/form-data; boundary=B";

/// Posts a job of a scene that fakes accept; returns its id.
std::string post_job(std::uint16_t port);
/// The value of `key` in a JSON object's text.
std::string member(const std::string& json, const std::string& key);
/// Waits for a state; returns the last one seen.
std::string wait_for_state(std::uint16_t port, const std::string& id, const std::string& state);

}  // namespace kiln::test
