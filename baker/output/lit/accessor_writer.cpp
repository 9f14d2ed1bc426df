#include <cstring>
#include <nlohmann/json.hpp>

#include "baker/output/lit/geometry.h"

namespace kiln::output::lit {
namespace {

constexpr int kVertexTarget = 34962, kIndexTarget = 34963;
constexpr int kUnsignedShort = 5123, kUnsignedInt = 5125, kFloat = 5126;
constexpr std::size_t kMaxShortVertices = 65535;  // index 65535 would restart the primitive

template <class T>
void put(std::string& out, T value) {
  char bytes[sizeof(T)];
  std::memcpy(bytes, &value, sizeof(T));
  out.append(bytes, sizeof(T));
}

template <class T>
Json min_and_max(const std::string& bytes, std::uint32_t stride, std::uint32_t components) {
  Json min = Json::array(), max = Json::array();
  for (std::uint32_t c = 0; c < components; ++c) {
    T low{}, high{};
    for (std::size_t at = 0; at + stride <= bytes.size(); at += stride) {
      T value;
      std::memcpy(&value, bytes.data() + at + c * sizeof(T), sizeof(T));
      if (at == 0 || value < low) low = value;
      if (at == 0 || value > high) high = value;
    }
    min.push_back(low);
    max.push_back(high);
  }
  return {{"min", std::move(min)}, {"max", std::move(max)}};
}

Json bounds_of(std::uint64_t type, const std::string& bytes, std::uint32_t stride,
               std::uint32_t components) {
  switch (type) {
    case 5120:
      return min_and_max<std::int8_t>(bytes, stride, components);
    case 5121:
      return min_and_max<std::uint8_t>(bytes, stride, components);
    case 5122:
      return min_and_max<std::int16_t>(bytes, stride, components);
    case 5123:
      return min_and_max<std::uint16_t>(bytes, stride, components);
    case 5125:
      return min_and_max<std::uint32_t>(bytes, stride, components);
    default:
      return min_and_max<float>(bytes, stride, components);
  }
}

}  // namespace

std::uint32_t AccessorWriter::add(Json accessor, std::string bytes, int target,
                                  std::uint32_t stride) {
  accessor["bufferView"] = document_.add_view(std::move(bytes), target, stride);
  return document_.add("accessors", std::move(accessor));
}

std::uint32_t AccessorWriter::uv(const std::vector<std::array<float, 2>>& uv) {
  std::string bytes;
  bytes.reserve(uv.size() * 8);
  for (const auto& [u, v] : uv) {
    put(bytes, u);
    put(bytes, v);
  }
  return add({{"componentType", kFloat}, {"count", uv.size()}, {"type", "VEC2"}}, std::move(bytes),
             kVertexTarget, 0);
}

std::uint32_t AccessorWriter::indices(const std::vector<std::uint32_t>& indices,
                                      std::size_t vertices) {
  const bool is_short = vertices <= kMaxShortVertices;
  const auto [found, is_new] = index_lists_.emplace(std::pair{indices, is_short}, 0u);
  if (!is_new) return found->second;
  std::string bytes;
  for (const std::uint32_t i : indices)
    is_short ? put(bytes, static_cast<std::uint16_t>(i)) : put(bytes, i);
  found->second = add({{"componentType", is_short ? kUnsignedShort : kUnsignedInt},
                       {"count", indices.size()},
                       {"type", "SCALAR"}},
                      std::move(bytes), kIndexTarget, 0);
  return found->second;
}

std::uint32_t AccessorWriter::id_of(const std::vector<std::uint32_t>& source) {
  return source_ids_.emplace(source, static_cast<std::uint32_t>(source_ids_.size())).first->second;
}

proto::Expected<std::uint32_t> AccessorWriter::gather(std::uint64_t index,
                                                      const std::vector<std::uint32_t>& source) {
  const std::pair key{index, id_of(source)};
  if (const auto known = gathered_.find(key); known != gathered_.end()) return known->second;
  const auto values = document_.accessor(index);
  if (!values) return proto::Unexpected(values.error());

  const std::uint32_t stride = (values->element_bytes + 3) / 4 * 4;  // vertex data is 4-aligned
  std::string bytes(source.size() * stride, '\0');
  for (std::size_t i = 0; i < source.size(); ++i) {
    if (source[i] >= values->count)
      return proto::fail("invalid_scene", "has fewer elements than POSITION", "scene",
                         "/accessors/" + std::to_string(index));
    values->copy(source[i], bytes.data() + i * stride);
  }
  Json accessor = document_.json()["accessors"][index];
  const auto type = count_at(accessor, "componentType", 0).value_or(0);
  const std::uint32_t components =
      gltf::vector_components(accessor["type"].get_ref<const std::string&>());
  for (const char* member : {"byteOffset", "sparse"}) accessor.erase(member);
  accessor["count"] = source.size();
  const bool has_bounds = accessor.contains("min") || accessor.contains("max");
  if (has_bounds && components > 0) {
    accessor.update(bounds_of(type, bytes, stride, components));
  } else {
    for (const char* bound : {"min", "max"}) accessor.erase(bound);  // a matrix may have none
  }
  const std::uint32_t made = add(std::move(accessor), std::move(bytes), kVertexTarget,
                                 stride == values->element_bytes ? 0 : stride);
  gathered_.emplace(key, made);
  return made;
}

}  // namespace kiln::output::lit
