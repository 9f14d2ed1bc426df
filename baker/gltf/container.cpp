#include "baker/gltf/container.h"

#include "proto/bytes.h"

#include <cstddef>

namespace kiln::gltf {
namespace {

constexpr std::size_t kHeader = 12, kChunkHeader = 8;
constexpr std::uint32_t kJson = 0x4E4F534A, kBin = 0x004E4942;

constexpr std::size_t padded(std::size_t bytes) {
  return (bytes + 3) / 4 * 4;
}

void put_u32(std::string& out, std::uint64_t value) {
  for (int i = 0; i < 4; ++i) out += static_cast<char>(value >> (8 * i) & 0xff);
}

proto::Unexpected broken(const std::string& why) {
  return proto::fail("invalid_scene", why, "scene", "");
}

proto::Expected<Container> open_text(std::string_view bytes) {
  if (bytes.starts_with("\xEF\xBB\xBF")) bytes.remove_prefix(3);
  const auto first = bytes.find_first_not_of(" \t\r\n");
  if (first == std::string_view::npos || bytes[first] != '{') {
    return broken("the file is neither a .glb (magic \"glTF\") nor a JSON object");
  }
  return Container{bytes, std::nullopt};
}

/// @param index of the chunk: 0 must be JSON, 1 may be BIN, others may be anything else.
proto::Expected<void> take_chunk(Container& out, std::uint32_t index, std::uint32_t type,
                                 std::string_view data) {
  if (index == 0 && type != kJson) return broken("the first chunk of the .glb is not JSON");
  if (index > 0 && type == kJson) return broken("the .glb has two JSON chunks");
  if (type == kJson) out.json = data;
  if (type == kBin && index != 1) return broken("the BIN chunk is not the second one of the .glb");
  if (type == kBin) out.binary = data;
  return {};
}

}  // namespace

std::uint32_t u32_at(std::string_view bytes, std::size_t offset) {
  return static_cast<std::uint32_t>(proto::little_endian(bytes.substr(offset, 4)));
}

std::uint64_t glb_bytes(std::size_t json_bytes, std::uint64_t binary_bytes) {
  return kHeader + 2 * kChunkHeader + padded(json_bytes) + binary_bytes;
}

std::string glb_head(std::string json, std::uint64_t binary_bytes) {
  std::string out = "glTF";
  put_u32(out, 2);
  put_u32(out, glb_bytes(json.size(), binary_bytes));
  json.resize(padded(json.size()), ' ');
  put_u32(out, json.size());
  put_u32(out, kJson);
  out += json;
  put_u32(out, binary_bytes);
  put_u32(out, kBin);
  return out;
}

proto::Expected<Container> open_container(std::string_view bytes) {
  if (!bytes.starts_with("glTF")) return open_text(bytes);
  if (bytes.size() < kHeader + kChunkHeader) return broken("the .glb is truncated in its header");
  if (u32_at(bytes, 4) != 2) {
    return broken("the .glb has version " + std::to_string(u32_at(bytes, 4)) + ", expected 2");
  }
  if (u32_at(bytes, 8) != bytes.size()) {
    return broken("the .glb says it has " + std::to_string(u32_at(bytes, 8)) + " bytes, but has " +
                  std::to_string(bytes.size()));
  }
  Container out;
  std::size_t at = kHeader;
  for (std::uint32_t index = 0; at < bytes.size(); ++index) {
    if (bytes.size() - at < kChunkHeader) return broken("the .glb ends inside a chunk's header");
    const std::size_t length = u32_at(bytes, at);
    const std::uint32_t type = u32_at(bytes, at + 4);
    at += kChunkHeader;
    if (length > bytes.size() - at) return broken("a chunk of the .glb is longer than the file");
    const auto taken = take_chunk(out, index, type, bytes.substr(at, length));
    if (!taken) return proto::Unexpected(taken.error());
    at += length;
  }
  if (out.json.empty()) return broken("the JSON chunk of the .glb is empty");
  return out;
}

}  // namespace kiln::gltf
