#include "tests/support/packed_gltf.h"

#include <draco/compression/encode.h>
#include <meshoptimizer.h>

#include <stdexcept>

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

GltfBuilder packed_by_draco(const std::vector<float>& positions, const std::vector<float>& normals,
                            const std::vector<std::uint32_t>& indices, bool edgebreaker) {
  const auto count = static_cast<std::uint32_t>(positions.size() / 3);
  draco::Mesh mesh;
  mesh.set_num_points(count);
  const auto add = [&](draco::GeometryAttribute::Type type, const std::vector<float>& values) {
    draco::GeometryAttribute attribute;
    attribute.Init(type, nullptr, 3, draco::DT_FLOAT32, false, 12, 0);
    const int id = mesh.AddAttribute(attribute, true, count);
    for (std::uint32_t i = 0; i < count; ++i)
      mesh.attribute(id)->SetAttributeValue(draco::AttributeValueIndex(i), &values[3 * i]);
    return mesh.attribute(id)->unique_id();
  };
  const auto position = add(draco::GeometryAttribute::POSITION, positions),
             normal = add(draco::GeometryAttribute::NORMAL, normals);
  for (std::size_t i = 0; i < indices.size(); i += 3)
    mesh.AddFace({draco::PointIndex(indices[i]), draco::PointIndex(indices[i + 1]),
                  draco::PointIndex(indices[i + 2])});
  draco::Encoder encoder;
  encoder.SetEncodingMethod(edgebreaker ? draco::MESH_EDGEBREAKER_ENCODING
                                        : draco::MESH_SEQUENTIAL_ENCODING);
  draco::EncoderBuffer packed;
  if (!encoder.EncodeMeshToBuffer(mesh, &packed).ok()) throw std::runtime_error("draco");

  GltfBuilder out;
  const int view = out.view(packed.data(), packed.size());
  const auto accessor = [&](int component_type, std::size_t n, const char* type) {
    return out.add("accessors", {{"componentType", component_type}, {"count", n}, {"type", type}});
  };
  const int p = accessor(5126, count, "VEC3"), n = accessor(5126, count, "VEC3"),
            i = accessor(5123, indices.size(), "SCALAR");
  out.node(
      {{"mesh", out.mesh({{"attributes", {{"POSITION", p}, {"NORMAL", n}}},
                          {"indices", i},
                          {"extensions",
                           {{"KHR_draco_mesh_compression",
                             {{"bufferView", view},
                              {"attributes", {{"POSITION", position}, {"NORMAL", normal}}}}}}}})}});
  out.json["extensionsUsed"] = out.json["extensionsRequired"] = {"KHR_draco_mesh_compression"};
  return out;
}

}  // namespace kiln::test
