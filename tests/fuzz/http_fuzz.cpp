// A request's bytes: head, framing, multipart. However the bytes are cut on their way, the same
// parts come out, and never more bytes than went in.
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "server/http/body.h"
#include "server/http/head.h"
#include "server/http/multipart.h"
#include "tests/fuzz/require.h"

using namespace kiln;
using namespace kiln::server;

namespace {

/// All of a body that arrives in pieces; nothing when it is malformed or cut short.
std::optional<std::string> read_body(const kiln::http::RequestHead& head, std::string_view rest,
                                     std::size_t piece) {
  kiln::http::BodyDecoder decoder(head);
  std::string body;
  const auto take = [&](std::string_view bytes) -> proto::Expected<void> {
    FUZZ_REQUIRE(!bytes.empty());
    body += bytes;
    return {};
  };
  while (!decoder.done()) {
    if (rest.empty()) return std::nullopt;
    const std::string_view next = rest.substr(0, piece);
    const auto used = decoder.feed(next, take);
    if (!used) return std::nullopt;
    FUZZ_REQUIRE(*used <= next.size());
    FUZZ_REQUIRE(*used == next.size() || decoder.done());
    rest.remove_prefix(*used);
  }
  return body;
}

struct Part {
  std::string name, filename, type, data;
  bool operator==(const ::Part&) const = default;
};

std::optional<std::vector<::Part>> read_parts(const std::string& boundary, std::string_view body,
                                              std::size_t piece) {
  std::vector<::Part> parts;
  kiln::http::MultipartReader reader(
      boundary, {[&](const kiln::http::PartHead& head) -> proto::Expected<void> {
                   parts.push_back({head.name, head.filename.value_or("-"), head.content_type, ""});
                   return {};
                 },
                 [&](std::string_view bytes) -> proto::Expected<void> {
                   parts.back().data += bytes;
                   return {};
                 },
                 [&]() -> proto::Expected<void> { return {}; }});
  for (std::size_t at = 0; at < body.size(); at += piece)
    if (!reader.feed(body.substr(at, piece))) return std::nullopt;
  if (!reader.finish()) return std::nullopt;
  return parts;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size == 0) return 0;
  const std::size_t piece = std::size_t{data[0]} + 1;
  const std::string_view bytes(reinterpret_cast<const char*>(data + 1), size - 1);
  const auto end = bytes.find("\r\n\r\n");
  if (end == std::string_view::npos) {
    (void)kiln::http::parse_head(bytes);
    return 0;
  }
  const auto head = kiln::http::parse_head(bytes.substr(0, end + 4));
  if (!head) return 0;
  FUZZ_REQUIRE(!(head->chunked && head->content_length));
  FUZZ_REQUIRE(head->path.find('\0') == std::string::npos);
  const std::string_view rest = bytes.substr(end + 4);
  const auto body = ::read_body(*head, rest, piece);
  FUZZ_REQUIRE(body == ::read_body(*head, rest, 4096));
  if (!body) return 0;
  FUZZ_REQUIRE(body->size() <= rest.size());
  const std::string* type = head->header("content-type");
  const auto boundary = type ? kiln::http::multipart_boundary(*type) : std::nullopt;
  if (!boundary) return 0;
  const auto parts = ::read_parts(*boundary, *body, piece);
  FUZZ_REQUIRE(parts == ::read_parts(*boundary, *body, 4096));
  return 0;
}
