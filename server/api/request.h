#pragma once

#include <cstdint>
#include <functional>
#include <initializer_list>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <semaphore>
#include <string>
#include <string_view>

#include "proto/expected.h"
#include "server/api/upload.h"
#include "server/http/message.h"

/// Helpers that read a request, or answer it, alike for several resources.
namespace kiln::api {

/// The longest time that a request may ask to wait.
inline constexpr std::uint32_t kMaxWaitSeconds = 60;

/// Reads a number from the query. Returns nothing when it is not there. Errors: `bad_request`, with
/// the parameter's name.
proto::Expected<std::optional<std::uint64_t>> query_number(const http::Request&, const char* name,
                                                           std::uint64_t max);
/// Refuses parameters that are not among these: a slip would be left out in silence. Errors:
/// `bad_request`, with the parameter's name.
proto::Expected<void> only_query(const http::Request&, std::initializer_list<std::string_view>);
/// Reads a whole number from a header, likewise.
proto::Expected<std::optional<std::uint64_t>> header_number(const http::Request&, const char* name);
/// Returns the request's Idempotency-Key; "" when it has none. Errors: `bad_request`.
proto::Expected<std::string> idempotency_key(const http::Request&);

using JsonAnswer =
    std::function<http::Response(http::Request&, const std::optional<nlohmann::json>& document)>;
/// Receives the body, a JSON object or nothing, and answers with it, or with what is wrong.
http::Response receive_json_object(http::Request&, const Intake&, JsonAnswer);

http::Response no_content();                           ///< 204
http::Response not_modified(const std::string& etag);  ///< 304
/// Returns whether the request's If-None-Match names this entity tag.
bool client_has(const http::Request&, const std::string& etag);

/// A slot of a semaphore, which it gives back.
class Slot {
 public:
  explicit Slot(std::counting_semaphore<>& taken) : semaphore_(taken) {}
  ~Slot() { semaphore_.release(); }
  Slot(const Slot&) = delete;
  Slot& operator=(const Slot&) = delete;

 private:
  std::counting_semaphore<>& semaphore_;
};

}  // namespace kiln::api
