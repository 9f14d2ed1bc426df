#include "server/api/zip.h"

#include <unistd.h>
#include <zlib.h>

#include <algorithm>

namespace kiln::api {
namespace {

// Field names and order are those of APPNOTE.TXT 6.3 (PKWARE), sections 4.3.7 to 4.3.16.
constexpr std::uint32_t kLocal = 0x04034b50, kCentral = 0x02014b50, kEnd = 0x06054b50;
constexpr std::uint32_t kEnd64 = 0x06064b50, kLocator64 = 0x07064b50;
constexpr std::uint16_t kVersion = 45;  // knows ZIP64
constexpr std::uint16_t kUtf8 = 1 << 11;
constexpr std::uint16_t kDate = 1 << 5 | 1;  // 1 January 1980: no clock in what should repeat
constexpr std::uint64_t kMax32 = 0xffffffff;
constexpr std::size_t kMax16 = 0xffff;

class Bytes {
 public:
  template <class T>
  Bytes& put(T value) {
    for (std::size_t i = 0; i < sizeof value; ++i)
      text_ += static_cast<char>(static_cast<std::uint64_t>(value) >> (8 * i) & 0xff);
    return *this;
  }
  Bytes& put32(std::uint64_t value) {
    return put(static_cast<std::uint32_t>(std::min(value, kMax32)));
  }
  Bytes& text(const std::string& s) {
    text_ += s;
    return *this;
  }
  std::size_t size() const { return text_.size(); }
  std::string take() { return std::move(text_); }

 private:
  std::string text_;
};

proto::Expected<std::uint32_t> crc_of(const ZipEntry& entry) {
  std::vector<char> buffer(256 * 1024);
  const http::Content content{http::ContentPart::of(entry.file, entry.bytes)};
  auto crc = static_cast<std::uint32_t>(::crc32(0, nullptr, 0));
  for (std::uint64_t at = 0; at < entry.bytes;) {
    const std::int64_t got = read_content(content, at, buffer.data(), buffer.size());
    if (got <= 0) return proto::fail("io_error", "The file " + entry.name + " can't be read.");
    crc = static_cast<std::uint32_t>(::crc32(
        crc, reinterpret_cast<const unsigned char*>(buffer.data()), static_cast<uInt>(got)));
    at += static_cast<std::uint64_t>(got);
  }
  return crc;
}

// The sizes (and the offset, in the central directory) that 32 bits don't hold.
std::string extra_of(std::uint64_t bytes, std::uint64_t offset) {
  Bytes fields;
  if (bytes >= kMax32) fields.put(bytes).put(bytes);
  if (offset >= kMax32) fields.put(offset);
  if (fields.size() == 0) return {};
  Bytes extra;
  extra.put(std::uint16_t{1}).put(static_cast<std::uint16_t>(fields.size()));
  return extra.text(fields.take()).take();
}

void put_common(Bytes& out, const ZipEntry& entry, std::uint32_t crc, const std::string& extra) {
  out.put(kVersion).put(kUtf8).put(std::uint16_t{0}).put(std::uint16_t{0}).put(kDate).put(crc);
  out.put32(entry.bytes).put32(entry.bytes);
  out.put(static_cast<std::uint16_t>(entry.name.size()));
  out.put(static_cast<std::uint16_t>(extra.size()));
}

std::string local_header(const ZipEntry& entry, std::uint32_t crc) {
  const std::string extra = extra_of(entry.bytes, 0);
  Bytes out;
  out.put(kLocal);
  put_common(out, entry, crc, extra);
  return out.text(entry.name).text(extra).take();
}

std::string central_header(const ZipEntry& entry, std::uint32_t crc, std::uint64_t offset) {
  const std::string extra = extra_of(entry.bytes, offset);
  Bytes out;
  out.put(kCentral).put(kVersion);
  put_common(out, entry, crc, extra);
  out.put(std::uint16_t{0}).put(std::uint16_t{0}).put(std::uint16_t{0}).put(std::uint32_t{0});
  return out.put32(offset).text(entry.name).text(extra).take();
}

std::string ending(std::uint64_t entries, std::uint64_t offset, std::uint64_t size) {
  Bytes out;
  if (offset >= kMax32) {
    constexpr std::uint64_t kRest = 44;
    out.put(kEnd64).put(kRest).put(kVersion).put(kVersion).put(std::uint32_t{0});
    out.put(std::uint32_t{0}).put(entries).put(entries).put(size).put(offset);
    out.put(kLocator64).put(std::uint32_t{0}).put(offset + size).put(std::uint32_t{1});
  }
  const auto count = static_cast<std::uint16_t>(std::min<std::uint64_t>(entries, kMax16));
  out.put(kEnd).put(std::uint16_t{0}).put(std::uint16_t{0}).put(count).put(count);
  return out.put32(size).put32(offset).put(std::uint16_t{0}).take();
}

}  // namespace

proto::Expected<http::Content> zip_of(const std::vector<ZipEntry>& entries) {
  http::Content content;
  std::string directory;
  std::uint64_t offset = 0;
  for (const ZipEntry& entry : entries) {
    const auto crc = crc_of(entry);
    if (!crc) return proto::Unexpected(crc.error());
    directory += central_header(entry, *crc, offset);
    content.push_back(http::ContentPart::of(local_header(entry, *crc)));
    offset += content.back().length + entry.bytes;
    if (entry.bytes > 0) content.push_back(http::ContentPart::of(entry.file, entry.bytes));
  }
  const std::string end = ending(entries.size(), offset, directory.size());
  content.push_back(http::ContentPart::of(directory + end));
  return content;
}

}  // namespace kiln::api
