#include <algorithm>
#include <cmath>
#include <cstring>
#include <nlohmann/json.hpp>

#include "baker/gltf/component.h"
#include "baker/output/lit/document.h"

namespace kiln::output::lit {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr std::uint64_t kNone = ~std::uint64_t{0};

std::uint64_t little_endian(std::string_view bytes) {
  std::uint64_t value = 0;
  for (std::size_t i = bytes.size(); i-- > 0;)
    value = value << 8 | static_cast<unsigned char>(bytes[i]);
  return value;
}

/// count elements of `element` bytes, `stride` apart, from `offset` on; nothing when they don't
/// fit.
std::optional<std::string_view> slice(std::string_view view, std::uint64_t offset,
                                      std::uint64_t count, std::uint64_t stride,
                                      std::uint64_t element) {
  if (offset > view.size() || count == 0) return std::nullopt;
  const std::uint64_t left = view.size() - offset;
  if (left < element || (count - 1) > (left - element) / stride) return std::nullopt;
  return view.substr(offset);
}

}  // namespace

std::optional<std::uint64_t> as_count(const Json& value) {
  if (value.is_number_unsigned()) return value.get<std::uint64_t>();
  if (!value.is_number()) return std::nullopt;
  const double number = value.get<double>();
  if (!(number >= 0) || number > 9e15 || number != std::floor(number)) return std::nullopt;
  return static_cast<std::uint64_t>(number);
}

std::optional<std::uint64_t> count_at(const Json& object, const char* key, std::uint64_t missing) {
  if (!object.is_object()) return std::nullopt;
  const auto found = object.find(key);
  return found == object.end() ? std::optional(missing) : as_count(*found);
}

std::uint32_t component_count(std::string_view type) {
  if (type == "SCALAR") return 1;
  if (type == "VEC2") return 2;
  if (type == "VEC3") return 3;
  return type == "VEC4" ? 4 : 0;
}

void SourceAccessor::read(std::uint64_t i, char* out) const {
  const auto found = std::lower_bound(sparse_indices.begin(), sparse_indices.end(), i);
  if (found != sparse_indices.end() && *found == i) {
    const auto k = static_cast<std::size_t>(found - sparse_indices.begin());
    std::memcpy(out, sparse_values.data() + k * element_bytes, element_bytes);
  } else if (bytes.empty()) {
    std::memset(out, 0, element_bytes);
  } else {
    std::memcpy(out, bytes.data() + i * stride, element_bytes);
  }
}

proto::Expected<SourceAccessor> LitDocument::accessor(std::uint64_t index) const {
  const auto bad = [&](const char* why) {
    return proto::fail("invalid_scene", why, "scene", "/accessors/" + std::to_string(index));
  };
  const auto accessors = json_->find("accessors");
  if (accessors == json_->end() || index >= accessors->size()) return bad("no such accessor");
  const Json& a = (*accessors)[index];
  const auto count = count_at(a, "count", 0), offset = count_at(a, "byteOffset", 0);
  const auto type = count_at(a, "componentType", 0), view = count_at(a, "bufferView", kNone);
  if (!count || !offset || !type || !view) return bad("not an accessor");

  SourceAccessor out;
  out.count = *count;
  const auto kind = a.find("type");
  if (kind == a.end() || !kind->is_string()) return bad("has no type");
  out.element_bytes =
      gltf::component_bytes(*type) * component_count(kind->get_ref<const std::string&>());
  if (out.element_bytes == 0) return bad("has an unknown type");
  const auto view_bytes = [&](std::uint64_t v) {
    return v < views_.size() ? views_[v] : std::optional<std::string_view>();
  };
  if (*view != kNone) {
    const auto data = view_bytes(*view);
    if (!data) return bad("has no data");
    const auto stride = count_at((*json_)["bufferViews"][*view], "byteStride", out.element_bytes);
    if (!stride || *stride < out.element_bytes || *stride > 255) return bad("has a wrong stride");
    out.stride = static_cast<std::uint32_t>(*stride);
    const auto bytes = slice(*data, *offset, out.count, out.stride, out.element_bytes);
    if (!bytes) return bad("reaches beyond its buffer view");
    out.bytes = *bytes;
  }
  if (!a.contains("sparse")) return out;

  const Json& sparse = a["sparse"];
  const auto n = count_at(sparse, "count", 0);
  if (!n || !sparse.contains("indices") || !sparse.contains("values")) return bad("is not sparse");
  const Json &indices = sparse["indices"], &values = sparse["values"];
  const auto index_view = count_at(indices, "bufferView", kNone);
  const auto value_view = count_at(values, "bufferView", kNone);
  const auto index_type = count_at(indices, "componentType", 0);
  if (!index_view || !value_view || !index_type) return bad("is not sparse");
  const std::uint32_t size = gltf::component_bytes(*index_type);
  const auto index_data = view_bytes(*index_view), value_data = view_bytes(*value_view);
  if (!index_data || !value_data || size == 0) return bad("has no sparse data");
  const auto index_bytes =
      slice(*index_data, count_at(indices, "byteOffset", 0).value_or(kNone), *n, size, size);
  const auto value_bytes = slice(*value_data, count_at(values, "byteOffset", 0).value_or(kNone), *n,
                                 out.element_bytes, out.element_bytes);
  if (!index_bytes || !value_bytes) return bad("reaches beyond its sparse data");
  for (std::uint64_t i = 0; i < *n; ++i)
    out.sparse_indices.push_back(little_endian(index_bytes->substr(i * size, size)));
  if (!std::is_sorted(out.sparse_indices.begin(), out.sparse_indices.end()))
    return bad("has sparse indices out of order");
  out.sparse_values = *value_bytes;
  return out;
}

}  // namespace kiln::output::lit
