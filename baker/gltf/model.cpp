#include "baker/gltf/model.h"

#include <cstddef>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "baker/exec/stop.h"
#include "baker/gltf/findings.h"
#include "baker/gltf/tinygltf.h"

namespace kiln::gltf {
namespace {

template <class T>
std::vector<T> list_of(const Json& object, const char* name) {
  const auto found = object.find(name);
  return found == object.end() ? std::vector<T>() : found->get<std::vector<T>>();
}

std::map<std::string, int> indices_of(const Json& object) {
  return object.get<std::map<std::string, int>>();
}

int type_of(const std::string& name) {
  if (name == "SCALAR") return TINYGLTF_TYPE_SCALAR;
  if (name == "VEC2") return TINYGLTF_TYPE_VEC2;
  if (name == "VEC3") return TINYGLTF_TYPE_VEC3;
  if (name == "VEC4") return TINYGLTF_TYPE_VEC4;
  if (name == "MAT2") return TINYGLTF_TYPE_MAT2;
  return name == "MAT3" ? TINYGLTF_TYPE_MAT3 : TINYGLTF_TYPE_MAT4;
}

tinygltf::Primitive primitive_of(const Json& from) {
  tinygltf::Primitive out;
  out.attributes = indices_of(from.at("attributes"));
  out.indices = from.value("indices", -1);
  out.material = from.value("material", -1);
  out.mode = from.value("mode", TINYGLTF_MODE_TRIANGLES);
  if (const auto targets = from.find("targets"); targets != from.end()) {
    for (const Json& target : *targets) out.targets.push_back(indices_of(target));
  }
  return out;
}

void read_sparse(decltype(tinygltf::Accessor::sparse)& out, const Json& from) {
  const Json& indices = from.at("indices");
  const Json& values = from.at("values");
  out.isSparse = true;
  out.count = from.at("count").get<int>();
  out.indices.bufferView = indices.at("bufferView").get<int>();
  out.indices.byteOffset = indices.value("byteOffset", 0);
  out.indices.componentType = indices.at("componentType").get<int>();
  out.values.bufferView = values.at("bufferView").get<int>();
  out.values.byteOffset = values.value("byteOffset", 0);
}

void read_nodes(tinygltf::Model& model, const Json& document, exec::StopPoll& stopped) {
  const Json& nodes = collection(document, "nodes");
  model.nodes.resize(nodes.size());
  for (std::size_t i = 0; i < nodes.size() && !stopped(); ++i) {
    const Json& from = nodes[i];
    tinygltf::Node& node = model.nodes[i];
    node.name = from.value("name", "");
    node.mesh = from.value("mesh", -1);
    node.skin = from.value("skin", -1);
    node.camera = from.value("camera", -1);
    node.children = list_of<int>(from, "children");
    node.matrix = list_of<double>(from, "matrix");
    node.translation = list_of<double>(from, "translation");
    node.rotation = list_of<double>(from, "rotation");
    node.scale = list_of<double>(from, "scale");
    const auto extensions = from.find("extensions");
    if (extensions == from.end() || !extensions->contains("KHR_lights_punctual")) continue;
    const int light = extensions->at("KHR_lights_punctual").at("light").get<int>();
    node.extensions.emplace("KHR_lights_punctual",
                            tinygltf::Value({{"light", tinygltf::Value(light)}}));
  }
}

void read_meshes(tinygltf::Model& model, const Json& document, exec::StopPoll& stopped) {
  const Json& meshes = collection(document, "meshes");
  model.meshes.resize(meshes.size());
  for (std::size_t i = 0; i < meshes.size() && !stopped(); ++i) {
    model.meshes[i].name = meshes[i].value("name", "");
    for (const Json& primitive : meshes[i].at("primitives")) {
      model.meshes[i].primitives.push_back(primitive_of(primitive));
    }
  }
}

void read_accessors(tinygltf::Model& model, const Json& document, exec::StopPoll& stopped) {
  const Json& accessors = collection(document, "accessors");
  model.accessors.resize(accessors.size());
  for (std::size_t i = 0; i < accessors.size() && !stopped(); ++i) {
    const Json& from = accessors[i];
    tinygltf::Accessor& out = model.accessors[i];
    out.bufferView = from.value("bufferView", -1);
    out.byteOffset = from.value("byteOffset", std::size_t(0));
    out.componentType = from.at("componentType").get<int>();
    out.normalized = from.value("normalized", false);
    out.count = from.at("count").get<std::size_t>();
    out.type = type_of(from.at("type").get_ref<const std::string&>());
    out.minValues = list_of<double>(from, "min");
    out.maxValues = list_of<double>(from, "max");
    if (const auto sparse = from.find("sparse"); sparse != from.end()) {
      read_sparse(out.sparse, *sparse);
    }
  }
}

}  // namespace

proto::Expected<void> read_model(tinygltf::Model& model, const ParsedText& parsed,
                                 const std::stop_token& stop) {
  const std::string& text = parsed.library_text;
  tinygltf::TinyGLTF parser;
  std::string error, warning;
  if (!parser.LoadASCIIFromString(&model, &error, &warning, text.data(),
                                  static_cast<unsigned>(text.size()), ""))
    return invalid("this is not a valid glTF document: " + shortened(error, 200), "");
  exec::StopPoll stopped(stop);
  read_nodes(model, *parsed.document, stopped);
  read_meshes(model, *parsed.document, stopped);
  read_accessors(model, *parsed.document, stopped);
  if (stop.stop_requested()) return exec::canceled();
  return {};
}

}  // namespace kiln::gltf
