#include "support/packed_gltf.h"

#include <meshoptimizer.h>

namespace kiln::test {
namespace {

std::string encode(const std::string& plain, const PackedView& view) {
  const auto stride = static_cast<std::size_t>(view.stride);
  const std::size_t count = plain.size() / stride;
  std::vector<unsigned char> out;
  if (view.mode == "ATTRIBUTES") {
    out.resize(meshopt_encodeVertexBufferBound(count, stride));
    out.resize(meshopt_encodeVertexBuffer(out.data(), out.size(), plain.data(), count, stride));
  } else {
    std::vector<unsigned> indices(count);
    for (std::size_t i = 0; i < count; ++i) std::memcpy(&indices[i], &plain[i * stride], stride);
    if (view.mode == "TRIANGLES") {
      out.resize(meshopt_encodeIndexBufferBound(count, 1 << 20));
      out.resize(meshopt_encodeIndexBuffer(out.data(), out.size(), indices.data(), count));
    } else {
      out.resize(meshopt_encodeIndexSequenceBound(count, 1 << 20));
      out.resize(meshopt_encodeIndexSequence(out.data(), out.size(), indices.data(), count));
    }
  }
  return {out.begin(), out.end()};
}

}  // namespace

GltfBuilder packed_by_meshopt(GltfBuilder plain, const std::vector<PackedView>& views) {
  GltfBuilder out = std::move(plain);
  const std::string binary = std::move(out.binary);
  out.binary.clear();
  for (std::size_t i = 0; i < views.size(); ++i) {
    nlohmann::json& view = out.json["bufferViews"][i];
    const auto length = view["byteLength"].get<std::size_t>();
    const std::string packed =
        encode(binary.substr(view["byteOffset"].get<std::size_t>(), length), views[i]);
    out.binary.resize((out.binary.size() + 3) / 4 * 4);
    view["buffer"] = 1;
    view["extensions"]["EXT_meshopt_compression"] = {
        {"buffer", 0},
        {"byteOffset", out.binary.size()},
        {"byteLength", packed.size()},
        {"byteStride", views[i].stride},
        {"count", length / static_cast<std::size_t>(views[i].stride)},
        {"mode", views[i].mode},
        {"filter", views[i].filter}};
    out.binary += packed;
  }
  out.json["buffers"] = {{{"byteLength", out.binary.size()}},
                         {{"byteLength", binary.size()},
                          {"extensions", {{"EXT_meshopt_compression", {{"fallback", true}}}}}}};
  out.json["extensionsUsed"] =
      out.json["extensionsRequired"] = {"EXT_meshopt_compression", "KHR_mesh_quantization"};
  return out;
}

}  // namespace kiln::test
