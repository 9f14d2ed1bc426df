#include "baker/gltf/accessors.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "baker/exec/stop.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/json.h"
#include "baker/gltf/tinygltf.h"

namespace kiln::gltf {
namespace {

using proto::Expected;
using proto::Unexpected;

std::string accessor_pointer(std::size_t i) {
  return pointer_to("/accessors", i);
}

bool is_component(int type) {
  return type > 0 && component_bytes(std::uint64_t(type)) > 0;
}

template <class T>
T load(const unsigned char* p) {
  T value;
  std::memcpy(&value, p, sizeof value);
  return value;
}

std::uint32_t load_unsigned(const unsigned char* p, Component c) {
  switch (c) {
    case Component::kUnsignedByte:
      return *p;
    case Component::kUnsignedShort:
      return load<std::uint16_t>(p);
    default:
      return load<std::uint32_t>(p);
  }
}

float load_float(const unsigned char* p, Component c, bool normalized) {
  switch (c) {
    case Component::kByte: {
      const float v = load<std::int8_t>(p);
      return normalized ? std::max(v / 127.f, -1.f) : v;
    }
    case Component::kUnsignedByte:
      return normalized ? float(*p) / 255.f : float(*p);
    case Component::kShort: {
      const float v = load<std::int16_t>(p);
      return normalized ? std::max(v / 32767.f, -1.f) : v;
    }
    case Component::kUnsignedShort: {
      const float v = load<std::uint16_t>(p);
      return normalized ? v / 65535.f : v;
    }
    case Component::kUnsignedInt:
      return static_cast<float>(load<std::uint32_t>(p));
    case Component::kFloat:
      return load<float>(p);
  }
  return 0;
}

/// Returns the bytes of one element; columns of matrices start at multiples of four bytes
/// [glTF 2.0, 3.6.2.4].
std::size_t element_size(const tinygltf::Accessor& a) {
  const std::size_t component = component_bytes(static_cast<Component>(a.componentType));
  const auto matrix = [&](std::size_t n) { return n * ((n * component + 3) / 4 * 4); };
  switch (a.type) {
    case TINYGLTF_TYPE_MAT2:
      return matrix(2);
    case TINYGLTF_TYPE_MAT3:
      return matrix(3);
    case TINYGLTF_TYPE_MAT4:
      return matrix(4);
    case TINYGLTF_TYPE_SCALAR:
      return component;
    default:
      return component * static_cast<std::size_t>(a.type);  // VEC2 is 2, and so on
  }
}

std::size_t component_count(const tinygltf::Accessor& a) {
  switch (a.type) {
    case TINYGLTF_TYPE_MAT2:
      return 4;
    case TINYGLTF_TYPE_MAT3:
      return 9;
    case TINYGLTF_TYPE_MAT4:
      return 16;
    case TINYGLTF_TYPE_SCALAR:
      return 1;
    default:
      return static_cast<std::size_t>(a.type);
  }
}

/// Says whether `count` elements from `offset` on, `stride` apart, end within `length` bytes.
bool fits(std::uint64_t offset, std::uint64_t stride, std::uint64_t count, std::uint64_t size,
          std::uint64_t length) {
  if (offset > length || size > length - offset) return false;
  return count - 1 <= (length - offset - size) / stride;
}

proto::Expected<void> check_range(const tinygltf::Model& model, const tinygltf::Accessor& a,
                                  const std::string& at) {
  if (a.bufferView < 0) return {};
  const auto& view = model.bufferViews[static_cast<std::size_t>(a.bufferView)];
  const std::size_t size = element_size(a);
  const std::size_t component = component_bytes(static_cast<Component>(a.componentType));
  const std::size_t stride = view.byteStride ? view.byteStride : size;
  if (stride < size || stride % component != 0) {
    return invalid("the stride " + std::to_string(stride) +
                       " of its buffer view is too small or odd "
                       "for elements of " +
                       std::to_string(size) + " bytes",
                   at);
  }
  if ((view.byteOffset + a.byteOffset) % component != 0) {
    return invalid("its data is not aligned to " + std::to_string(component) + " bytes",
                   at + "/byteOffset");
  }
  if (!fits(a.byteOffset, stride, a.count, size, view.byteLength)) {
    return invalid(std::to_string(a.count) + " elements reach beyond its buffer view of " +
                       std::to_string(view.byteLength) + " bytes",
                   at);
  }
  return {};
}

proto::Expected<void> check_sparse_range(const tinygltf::Model& model, const tinygltf::Accessor& a,
                                         const std::string& at) {
  if (!a.sparse.isSparse) return {};
  const auto& indices = a.sparse.indices;
  const auto& values = a.sparse.values;
  const auto type = static_cast<Component>(indices.componentType);
  if (type != Component::kUnsignedByte && type != Component::kUnsignedShort &&
      type != Component::kUnsignedInt) {
    return invalid("expected 5121, 5123 or 5125", at + "/sparse/indices/componentType");
  }
  const auto count = static_cast<std::uint64_t>(a.sparse.count);
  if (count > a.count) return invalid("is more than the accessor's count", at + "/sparse/count");
  const auto& index_view = model.bufferViews[static_cast<std::size_t>(indices.bufferView)];
  if (!fits(static_cast<std::uint64_t>(indices.byteOffset), component_bytes(type), count,
            component_bytes(type), index_view.byteLength)) {
    return invalid("reaches beyond its buffer view", at + "/sparse/indices");
  }
  const auto& value_view = model.bufferViews[static_cast<std::size_t>(values.bufferView)];
  if (!fits(static_cast<std::uint64_t>(values.byteOffset), element_size(a), count, element_size(a),
            value_view.byteLength)) {
    return invalid("reaches beyond its buffer view", at + "/sparse/values");
  }
  return {};
}

proto::Expected<void> check_accessor(const tinygltf::Model& model, const tinygltf::Accessor& a,
                                     const std::string& at) {
  if (!is_component(a.componentType)) {
    return invalid("expected a component type of glTF 2.0", at + "/componentType");
  }
  for (const auto* bound : {&a.minValues, &a.maxValues}) {
    if (!bound->empty() && bound->size() != component_count(a)) {
      return invalid("min and max need one number per component", at);
    }
  }
  if (auto range = check_range(model, a, at); !range) return range;
  return check_sparse_range(model, a, at);
}

std::string describe(Component c) {
  switch (c) {
    case Component::kByte:
      return "BYTE";
    case Component::kUnsignedByte:
      return "UNSIGNED_BYTE";
    case Component::kShort:
      return "SHORT";
    case Component::kUnsignedShort:
      return "UNSIGNED_SHORT";
    case Component::kUnsignedInt:
      return "UNSIGNED_INT";
    case Component::kFloat:
      return "FLOAT";
  }
  return "?";
}

}  // namespace

const unsigned char* AccessorView::element(std::uint64_t i) const {
  if (sparse_count > 0) {
    const std::size_t size = component_bytes(sparse_component);
    std::uint32_t low = 0, high = sparse_count;
    while (low < high) {
      const std::uint32_t middle = low + (high - low) / 2;
      const std::uint32_t at = load_unsigned(sparse_indices + middle * size, sparse_component);
      if (at == i) return sparse_values + std::size_t(middle) * element_bytes;
      (at < i ? low : high) = at < i ? middle + 1 : middle;
    }
  }
  return data ? data + i * stride : nullptr;
}

std::uint32_t AccessorView::index(std::uint64_t i) const {
  const unsigned char* p = element(i);
  return p ? load_unsigned(p, component) : 0;
}

std::array<float, 4> AccessorView::floats(std::uint64_t i) const {
  std::array<float, 4> out{};
  const unsigned char* p = element(i);
  if (!p) return out;
  const std::size_t size = component_bytes(component);
  for (std::uint32_t c = 0; c < components; ++c) {
    out[c] = load_float(p + c * size, component, normalized);
  }
  return out;
}

void AccessorView::copy(std::uint64_t i, char* out) const {
  if (const unsigned char* from = element(i))
    std::memcpy(out, from, element_bytes);
  else
    std::memset(out, 0, element_bytes);
}

proto::Expected<void> check_accessors(const Document& document, const std::stop_token& stop) {
  exec::StopPoll stopped(stop);
  const auto& model = *document.model;
  for (std::size_t i = 0; i < model.accessors.size(); ++i) {
    if (stopped()) return exec::canceled();
    auto checked = check_accessor(model, model.accessors[i], accessor_pointer(i));
    if (!checked) return checked;
  }
  return {};
}

Accessors::Accessors(Document& document, std::stop_token stop)
    : document_(document),
      stop_(std::move(stop)),
      checked_(document.model->accessors.size(), false) {}

proto::Expected<AccessorView> Accessors::view_of(int accessor) const {
  const auto& a = document_.model->accessors[static_cast<std::size_t>(accessor)];
  const std::string at = accessor_pointer(static_cast<std::size_t>(accessor));
  AccessorView v;
  v.count = a.count;
  v.component = static_cast<Component>(a.componentType);
  v.normalized = a.normalized;
  v.components = static_cast<std::uint32_t>(component_count(a));
  v.element_bytes = static_cast<std::uint32_t>(element_size(a));
  const auto start = [&](int view, std::size_t offset) -> proto::Expected<const unsigned char*> {
    const auto bytes = buffer_view_bytes(document_, view, at);
    if (!bytes) return Unexpected(bytes.error());
    return reinterpret_cast<const unsigned char*>(bytes->data()) + offset;
  };
  if (a.bufferView >= 0) {
    const auto data = start(a.bufferView, a.byteOffset);
    if (!data) return Unexpected(data.error());
    v.data = *data;
    const auto stride =
        document_.model->bufferViews[static_cast<std::size_t>(a.bufferView)].byteStride;
    v.stride = stride ? stride : element_size(a);
  }
  if (!a.sparse.isSparse) return v;
  const auto indices =
      start(a.sparse.indices.bufferView, static_cast<std::size_t>(a.sparse.indices.byteOffset));
  if (!indices) return Unexpected(indices.error());
  const auto values =
      start(a.sparse.values.bufferView, static_cast<std::size_t>(a.sparse.values.byteOffset));
  if (!values) return Unexpected(values.error());
  v.sparse_count = static_cast<std::uint32_t>(a.sparse.count);
  v.sparse_component = static_cast<Component>(a.sparse.indices.componentType);
  v.sparse_indices = *indices;
  v.sparse_values = *values;
  return v;
}

proto::Expected<void> Accessors::check_sparse(const AccessorView& v, const std::string& at) const {
  const std::size_t size = component_bytes(v.sparse_component);
  exec::StopPoll stopped(stop_);
  for (std::uint32_t s = 0; s < v.sparse_count; ++s) {
    if (stopped()) return exec::canceled();
    const auto index = load_unsigned(v.sparse_indices + s * size, v.sparse_component);
    const bool ascends =
        s == 0 || index > load_unsigned(v.sparse_indices + (s - 1) * size, v.sparse_component);
    if (index >= v.count || !ascends) {
      return invalid("indices must ascend and stay below the accessor's count",
                     at + "/sparse/indices");
    }
  }
  return {};
}

proto::Expected<void> Accessors::check_contents(const AccessorView& v, int accessor) {
  const std::string at = accessor_pointer(static_cast<std::size_t>(accessor));
  if (auto sparse = check_sparse(v, at); !sparse) return sparse;
  if (v.component != Component::kFloat) return {};
  const auto& a = document_.model->accessors[static_cast<std::size_t>(accessor)];
  bool outside = false;
  // Zeros of an accessor without data need no look: its count is a mere claim.
  const std::uint64_t n = v.data ? v.count : v.sparse_count;
  exec::StopPoll stopped(stop_);
  for (std::uint64_t k = 0; k < n; ++k) {
    if (stopped()) return exec::canceled();
    const std::uint64_t i =
        v.data ? k
               : load_unsigned(v.sparse_indices + k * component_bytes(v.sparse_component),
                               v.sparse_component);
    const auto values = v.floats(i);
    for (std::uint32_t c = 0; c < v.components; ++c) {
      if (!std::isfinite(values[c]))
        return invalid("element " + std::to_string(i) + " is not finite", at);
      // Bounds are written with few digits by many exporters.
      const double slack = 1e-3 * std::abs(values[c]) + 1e-4;
      outside |= !a.minValues.empty() && values[c] < a.minValues[c] - slack;
      outside |= !a.maxValues.empty() && values[c] > a.maxValues[c] + slack;
    }
  }
  if (outside) {
    document_.warnings.add("accessor_bounds_wrong", at,
                           "values lie outside the declared min and max");
  }
  return {};
}

proto::Expected<AccessorView> Accessors::open_raw(std::uint64_t accessor) const {
  const std::string at = accessor_pointer(accessor);
  if (accessor >= checked_.size()) return invalid("there is no such accessor", at);
  auto view = view_of(static_cast<int>(accessor));
  if (!view) return view;
  if (auto sparse = check_sparse(*view, at); !sparse) return Unexpected(sparse.error());
  return view;
}

proto::Expected<AccessorView> Accessors::open(int accessor, const AccessorFormat& format,
                                              const std::string& use) {
  const std::string at = accessor_pointer(static_cast<std::size_t>(accessor));
  const auto& a = document_.model->accessors[static_cast<std::size_t>(accessor)];
  const std::size_t components = component_count(a);
  const bool is_matrix = a.type == TINYGLTF_TYPE_MAT2 || components > 4;
  if (is_matrix || components < format.min_components || components > format.max_components) {
    return invalid("has the wrong type for " + use, at + "/type");
  }
  const auto type = static_cast<Component>(a.componentType);
  if (std::find(format.types.begin(), format.types.end(), std::pair{type, a.normalized}) ==
      format.types.end()) {
    return invalid(std::string(a.normalized ? "normalized " : "") + describe(type) +
                       " is not allowed for " + use,
                   at + "/componentType");
  }
  if (!format.allows_stride && a.bufferView >= 0 &&
      document_.model->bufferViews[static_cast<std::size_t>(a.bufferView)].byteStride != 0) {
    return invalid("the buffer view of " + use + " may not have a stride", at + "/bufferView");
  }
  auto view = view_of(accessor);
  if (!view || checked_[static_cast<std::size_t>(accessor)]) return view;
  if (auto contents = check_contents(*view, accessor); !contents)
    return Unexpected(contents.error());
  checked_[static_cast<std::size_t>(accessor)] = true;
  return view;
}

}  // namespace kiln::gltf
