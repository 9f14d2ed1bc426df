#include "server/http/answer.h"

#include <algorithm>

#include "proto/problems.h"
#include "server/http/content.h"

namespace kiln::http {
namespace {

const char* reason(int status) {
  switch (status) {
    case 200:
      return "OK";
    case 201:
      return "Created";
    case 202:
      return "Accepted";
    case 204:
      return "No Content";
    case 206:
      return "Partial Content";
    case 304:
      return "Not Modified";
    case 400:
      return "Bad Request";
    case 401:
      return "Unauthorized";
    case 403:
      return "Forbidden";
    case 404:
      return "Not Found";
    case 405:
      return "Method Not Allowed";
    case 408:
      return "Request Timeout";
    case 409:
      return "Conflict";
    case 412:
      return "Precondition Failed";
    case 413:
      return "Payload Too Large";
    case 414:
      return "URI Too Long";
    case 415:
      return "Unsupported Media Type";
    case 416:
      return "Range Not Satisfiable";
    case 422:
      return "Unprocessable Content";
    case 425:
      return "Too Early";
    case 429:
      return "Too Many Requests";
    case 431:
      return "Request Header Fields Too Large";
    case 500:
      return "Internal Server Error";
    case 502:
      return "Bad Gateway";
    case 503:
      return "Service Unavailable";
    case 507:
      return "Insufficient Storage";
    default:
      return "";  // which HTTP allows
  }
}

// A value with a line's end in it would be two headers.
void add_header(std::string& head, std::string_view name, std::string_view value) {
  head.append(name).append(": ");
  for (const char c : value)
    if (c != '\r' && c != '\n' && c != '\0') head += c;
  head += "\r\n";
}

}  // namespace

std::string answer_head(const Response& response, const std::string& request_id, bool close) {
  std::string head =
      "HTTP/1.1 " + std::to_string(response.status) + " " + reason(response.status) + "\r\n";
  for (const auto& [name, value] : response.headers) add_header(head, name, value);
  add_header(head, "X-Request-Id", request_id);
  if (!response.content_type.empty()) add_header(head, "Content-Type", response.content_type);
  const std::uint64_t length =
      response.content.empty() ? response.body.size() : length_of(response.content);
  if (response.stream)
    add_header(head, "Transfer-Encoding", "chunked");
  else if (response.status != 204 && response.status != 304)
    add_header(head, "Content-Length", std::to_string(length));
  if (close) add_header(head, "Connection", "close");
  return head + "\r\n";
}

Answer::Answer(Response& response, const std::string& request_id, bool close, bool with_body)
    : response_(&response), text_(answer_head(response, request_id, close)) {
  if (!with_body || response.stream || response.status == 204 || response.status == 304) return;
  if (!response.content.empty()) {
    content_size_ = length_of(response.content);
    return;
  }
  text_ += response.body;
  std::string().swap(response.body);
}

// The head and a short body leave in one packet.
ssize_t Answer::send_piece(Connection& connection, std::uint64_t most) {
  if (text_at_ < text_.size()) {
    const ssize_t sent = connection.send(std::string_view(text_).substr(text_at_));
    if (sent > 0) text_at_ += static_cast<std::size_t>(sent);
    return sent;
  }
  std::uint64_t at = content_at_;
  for (const ContentPart& part : response_->content) {
    if (at >= part.length) {
      at -= part.length;
      continue;
    }
    const auto size = static_cast<std::size_t>(std::min(most, part.length - at));
    const std::uint64_t from = part.offset + at;
    const ssize_t sent = part.file
                             ? connection.send_file(part.file->get(), from, size)
                             : connection.send(std::string_view(part.bytes).substr(from, size));
    if (sent > 0) content_at_ += static_cast<std::uint64_t>(sent);
    return sent;
  }
  return -1;  // the content is shorter than its length: never
}

Answer::Sent Answer::send(Connection& connection, TransferClock& clock, std::uint64_t most) {
  std::uint64_t total = 0;
  while (text_at_ < text_.size() || content_at_ < content_size_) {
    if (total >= most) return Sent::kMore;
    const ssize_t sent = send_piece(connection, most);
    if (sent < 0) return Sent::kBroken;
    if (sent == 0) return Sent::kBlocked;
    total += static_cast<std::uint64_t>(sent);
    clock.moved(static_cast<std::size_t>(sent));
  }
  return Sent::kAll;
}

}  // namespace kiln::http
