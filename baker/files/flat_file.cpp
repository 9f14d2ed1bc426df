#include "baker/files/flat_file.h"

#include "proto/files.h"

namespace kiln::files {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr const char* kName = "the scene file";
constexpr std::string_view kMagic("LKILNFLT", 8);
constexpr std::size_t kKeyBytes = 64, kHeaderBytes = 96, kEntryBytes = 24, kAlignment = 64;

std::uint64_t aligned(std::uint64_t offset) {
  return (offset + kAlignment - 1) / kAlignment * kAlignment;
}

template <class T>
void put(std::string& out, T value) {
  out.append(reinterpret_cast<const char*>(&value), sizeof value);
}

template <class T>
T get(std::string_view bytes, std::size_t offset) {
  T value;
  std::memcpy(&value, bytes.data() + offset, sizeof value);
  return value;
}

/// Returns the header and the table.
std::string make_head(const FlatHeader& header, std::span<const FlatSection> sections) {
  std::string table;
  std::uint64_t end = kHeaderBytes + kEntryBytes * sections.size();
  for (const FlatSection& section : sections) {
    const std::uint64_t offset = aligned(end);
    put(table, section.record_bytes);
    put(table, std::uint32_t{0});
    put(table, offset);
    put(table, std::uint64_t{section.bytes.size() / section.record_bytes});
    end = offset + section.bytes.size();
  }
  std::string head(kMagic);
  put(head, static_cast<std::uint32_t>(header.kind));
  put(head, header.version);
  head += header.key;
  put(head, static_cast<std::uint32_t>(sections.size()));
  put(head, std::uint32_t{0});
  put(head, end);
  return head + table;
}

/// Returns whether all bytes are zero, as a writer leaves them between two sections.
bool all_zero(std::string_view bytes) {
  return bytes.find_first_not_of('\0') == std::string_view::npos;
}

}  // namespace

Unexpected bad_flat_file(const std::string& why) {
  return proto::fail("bad_document", "The scene file is damaged: " + why);
}

proto::Expected<void> write_flat(int fd, const FlatHeader& header,
                                 std::span<const FlatSection> sections) {
  const std::string head = make_head(header, sections);
  if (auto ok = proto::write_all(fd, head, kName); !ok) return ok;
  std::uint64_t at = head.size();
  for (const FlatSection& section : sections) {
    const std::string padding(aligned(at) - at, '\0');
    if (auto ok = proto::write_all(fd, padding, kName); !ok) return ok;
    if (auto ok = proto::write_all(fd, section.bytes, kName); !ok) return ok;
    at += padding.size() + section.bytes.size();
  }
  return {};
}

proto::Expected<FlatFile> FlatFile::open(std::string_view bytes, const FlatHeader& header,
                                         std::span<const std::uint32_t> record_bytes) {
  const std::uint64_t head_bytes = kHeaderBytes + kEntryBytes * record_bytes.size();
  if (bytes.size() < head_bytes) return bad_flat_file("it is too short");
  if (!bytes.starts_with(kMagic) ||
      get<std::uint32_t>(bytes, 8) != static_cast<std::uint32_t>(header.kind))
    return bad_flat_file("it is a file of another kind");
  if (get<std::uint32_t>(bytes, 12) != header.version)
    return bad_flat_file("it has another version");
  if (bytes.substr(16, kKeyBytes) != header.key)
    return bad_flat_file("it belongs to another scene");
  if (get<std::uint32_t>(bytes, 80) != record_bytes.size() || get<std::uint32_t>(bytes, 84) != 0 ||
      get<std::uint64_t>(bytes, 88) != bytes.size())
    return bad_flat_file("its header does not fit its length");
  FlatFile file;
  std::uint64_t end = head_bytes;
  for (std::size_t i = 0; i < record_bytes.size(); ++i) {
    const std::size_t entry = kHeaderBytes + kEntryBytes * i;
    const std::uint64_t offset = aligned(end), count = get<std::uint64_t>(bytes, entry + 16);
    if (get<std::uint32_t>(bytes, entry) != record_bytes[i] ||
        get<std::uint32_t>(bytes, entry + 4) != 0 ||
        get<std::uint64_t>(bytes, entry + 8) != offset || offset > bytes.size() ||
        count > (bytes.size() - offset) / record_bytes[i] ||
        !all_zero(bytes.substr(end, offset - end)))
      return bad_flat_file("its table is wrong");
    file.sections_.push_back(bytes.substr(offset, count * record_bytes[i]));
    end = offset + count * record_bytes[i];
  }
  if (end != bytes.size()) return bad_flat_file("it is longer than its table says");
  return file;
}

}  // namespace kiln::files
