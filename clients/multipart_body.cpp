#include "clients/multipart_body.h"

#include <algorithm>
#include <utility>

namespace kiln::clients {
namespace {

constexpr std::size_t kPiece = 256u << 10;

/// Returns a name inside quotes, as browsers write it (WHATWG: multipart/form-data encoding).
std::string quote_name(std::string_view name) {
  std::string out = "\"";
  for (const char c : name) {
    if (c == '"')
      out += "%22";
    else if (c == '\r')
      out += "%0D";
    else if (c == '\n')
      out += "%0A";
    else
      out += c;
  }
  return out + "\"";
}

proto::Expected<std::uint64_t> readable_size(const std::filesystem::path& path) {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(path, error);
  if (error || !std::filesystem::is_regular_file(path, error) || !std::ifstream(path))
    return proto::fail("missing_file", "The file " + path.string() + " can't be read.");
  return bytes;
}

}  // namespace

MultipartBody::MultipartBody(std::string boundary) : boundary_(std::move(boundary)) {}

std::string MultipartBody::content_type() const {
  if (boundary_.empty()) return "application/octet-stream";
  return "multipart/form-data; boundary=" + boundary_;
}

proto::Expected<MultipartBody> MultipartBody::bare(const std::filesystem::path& path) {
  auto bytes = readable_size(path);
  if (!bytes) return proto::Unexpected(std::move(bytes.error()));
  MultipartBody body("");
  body.append({0, *bytes, {}, path});
  return body;
}

void MultipartBody::append(Segment segment) {
  segment.begin = size_;
  size_ += segment.size;
  segments_.push_back(std::move(segment));
}

void MultipartBody::add_text(const std::string& name, const std::string& media_type,
                             std::string text) {
  std::string part = "--" + boundary_ +
                     "\r\nContent-Disposition: form-data; name=" + quote_name(name) +
                     "\r\nContent-Type: " + media_type + "\r\n\r\n" + std::move(text) + "\r\n";
  const auto size = part.size();
  append({0, size, std::move(part), {}});
}

proto::Expected<void> MultipartBody::add_file(const std::string& name, const std::string& file_name,
                                              const std::filesystem::path& path) {
  const auto bytes = readable_size(path);
  if (!bytes) return proto::Unexpected(bytes.error());
  std::string head =
      "--" + boundary_ + "\r\nContent-Disposition: form-data; name=" + quote_name(name) +
      "; filename=" + quote_name(file_name) + "\r\nContent-Type: application/octet-stream\r\n\r\n";
  const auto head_size = head.size();
  append({0, head_size, std::move(head), {}});
  append({0, *bytes, {}, path});
  append({0, 2, "\r\n", {}});
  return {};
}

void MultipartBody::finish() {
  std::string end = "--" + boundary_ + "--\r\n";
  const auto size = end.size();
  append({0, size, std::move(end), {}});
}

bool MultipartBody::read(std::uint64_t offset, std::uint64_t length,
                         const std::function<bool(std::string_view)>& sink) {
  auto segment = std::upper_bound(segments_.begin(), segments_.end(), offset,
                                  [](std::uint64_t at, const Segment& s) { return at < s.begin; });
  if (segment == segments_.begin()) return false;
  --segment;
  // Empty files are segments of no length, so this skips them.
  while (segment != segments_.end() && offset >= segment->begin + segment->size) ++segment;
  if (segment == segments_.end()) return false;
  const std::uint64_t at = offset - segment->begin;
  const std::uint64_t take = std::min({length, segment->size - at, std::uint64_t{kPiece}});
  if (!segment->file.empty()) return read_file(*segment, at, take, sink);
  return sink(std::string_view(segment->text).substr(at, take));
}

bool MultipartBody::read_file(const Segment& segment, std::uint64_t at, std::uint64_t length,
                              const std::function<bool(std::string_view)>& sink) {
  if (open_path_ != segment.file) {
    open_ = std::ifstream(segment.file, std::ios::binary);
    open_path_ = segment.file;
  }
  buffer_.resize(kPiece);
  open_.seekg(static_cast<std::streamoff>(at));
  open_.read(buffer_.data(), static_cast<std::streamsize>(length));
  if (static_cast<std::uint64_t>(open_.gcount()) != length) {
    error_ = segment.file.string() + " changed during the upload";
    return false;
  }
  return sink({buffer_.data(), static_cast<std::size_t>(length)});
}

}  // namespace kiln::clients
