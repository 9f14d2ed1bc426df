#include "baker/gltf/schema.h"

namespace kiln::gltf {
namespace {

constexpr bool kRequired = true;
constexpr double kMaxFloat = std::numeric_limits<float>::max();

constexpr Field boolean(const char* name) {
  return {name, Kind::kBool};
}
constexpr Field text(const char* name, bool required = false) {
  return {name, Kind::kString, required};
}
constexpr Field word(const char* name, const char* words, bool required = false) {
  return {name, Kind::kWord, required, words};
}
constexpr Field integer(const char* name, double low, double high = kMaxSize,
                        bool required = false) {
  return {name, Kind::kInteger, required, nullptr, {}, 0, low, high};
}
constexpr Field number(const char* name, double low = -kMaxFloat, double high = kMaxFloat) {
  return {name, Kind::kNumber, false, nullptr, {}, 0, low, high};
}
constexpr Field numbers(const char* name, std::size_t length, double low = -kMaxFloat,
                        double high = kMaxFloat) {
  return {name, Kind::kNumbers, false, nullptr, {}, length, low, high};
}
constexpr Field index(const char* name, const char* target, bool required = false) {
  return {name, Kind::kIndex, required, target};
}
constexpr Field indices(const char* name, const char* target) {
  return {name, Kind::kIndices, false, target};
}
constexpr Field object(const char* name, std::span<const Field> fields, bool required = false) {
  return {name, Kind::kObject, required, nullptr, fields};
}
constexpr Field objects(const char* name, std::span<const Field> fields, bool required = false) {
  return {name, Kind::kObjects, required, nullptr, fields};
}

// glTF 2.0, section 5, and extensions -------------------------------------------------------------
constexpr const char* kLights = "/extensions/KHR_lights_punctual/lights";

constexpr Field kAsset[] = {text("version", kRequired), text("minVersion")};
constexpr Field kSceneFields[] = {indices("nodes", "/nodes"), text("name")};

constexpr Field kNodeLight[] = {index("light", kLights, kRequired)};
constexpr Field kNodeExtensions[] = {object("KHR_lights_punctual", kNodeLight),
                                     object("EXT_mesh_gpu_instancing", {})};
constexpr Field kNode[] = {index("camera", "/cameras"),
                           indices("children", "/nodes"),
                           index("skin", "/skins"),
                           index("mesh", "/meshes"),
                           numbers("matrix", 16),
                           numbers("rotation", 4),
                           numbers("scale", 3),
                           numbers("translation", 3),
                           numbers("weights", 0),
                           text("name"),
                           object("extensions", kNodeExtensions)};

constexpr Field kDraco[] = {
    index("bufferView", "/bufferViews", kRequired),
    {"attributes", Kind::kIntegerMap, kRequired, nullptr, {}, 0, 0, kMaxOffset}};
constexpr Field kPrimitiveExtensions[] = {object("KHR_draco_mesh_compression", kDraco)};
constexpr Field kPrimitive[] = {{"attributes", Kind::kIndexMap, kRequired, "/accessors"},
                                index("indices", "/accessors"),
                                index("material", "/materials"),
                                integer("mode", 0, 6),
                                {"targets", Kind::kIndexMaps, false, "/accessors"},
                                object("extensions", kPrimitiveExtensions)};
constexpr Field kMesh[] = {objects("primitives", kPrimitive, kRequired), numbers("weights", 0),
                           text("name")};

constexpr Field kSparseIndices[] = {index("bufferView", "/bufferViews", kRequired),
                                    integer("byteOffset", 0, kMaxOffset),
                                    integer("componentType", 5121, 5125, kRequired)};
constexpr Field kSparseValues[] = {index("bufferView", "/bufferViews", kRequired),
                                   integer("byteOffset", 0, kMaxOffset)};
constexpr Field kSparse[] = {integer("count", 1, kMaxOffset, kRequired),
                             object("indices", kSparseIndices, kRequired),
                             object("values", kSparseValues, kRequired)};
constexpr Field kAccessor[] = {
    index("bufferView", "/bufferViews"),
    integer("byteOffset", 0),
    integer("componentType", 5120, 5126, kRequired),
    boolean("normalized"),
    integer("count", 1, kMaxSize, kRequired),
    word("type", "SCALAR VEC2 VEC3 VEC4 MAT2 MAT3 MAT4", kRequired),
    numbers("max", 0, std::numeric_limits<double>::lowest(), std::numeric_limits<double>::max()),
    numbers("min", 0, std::numeric_limits<double>::lowest(), std::numeric_limits<double>::max()),
    object("sparse", kSparse)};
constexpr Field kMeshoptView[] = {index("buffer", "/buffers", kRequired),
                                  integer("byteOffset", 0),
                                  integer("byteLength", 1, kMaxSize, kRequired),
                                  integer("byteStride", 2, 256, kRequired),
                                  integer("count", 1, kMaxSize, kRequired),
                                  word("mode", "ATTRIBUTES TRIANGLES INDICES", kRequired),
                                  word("filter", "NONE OCTAHEDRAL QUATERNION EXPONENTIAL")};
constexpr Field kViewExtensions[] = {object("EXT_meshopt_compression", kMeshoptView)};
constexpr Field kBufferView[] = {index("buffer", "/buffers", kRequired),
                                 integer("byteOffset", 0),
                                 integer("byteLength", 1, kMaxSize, kRequired),
                                 integer("byteStride", 4, 252),
                                 integer("target", 0, 65535),
                                 object("extensions", kViewExtensions)};
constexpr Field kBuffer[] = {text("uri"), integer("byteLength", 1, kMaxSize, kRequired)};
constexpr Field kImage[] = {text("uri"), text("mimeType"), index("bufferView", "/bufferViews")};

constexpr Field kTextureSource[] = {index("source", "/images")};
constexpr Field kTextureExtensions[] = {object("EXT_texture_webp", kTextureSource),
                                        object("KHR_texture_basisu", kTextureSource)};
constexpr Field kTexture[] = {index("sampler", "/samplers"), index("source", "/images"),
                              object("extensions", kTextureExtensions)};
constexpr Field kSampler[] = {integer("magFilter", 9728, 9729), integer("minFilter", 9728, 9987),
                              integer("wrapS", 10497, 33648), integer("wrapT", 10497, 33648)};

constexpr Field kTransform[] = {numbers("offset", 2), number("rotation"), numbers("scale", 2),
                                integer("texCoord", 0, 255)};
constexpr Field kInfoExtensions[] = {object("KHR_texture_transform", kTransform)};
constexpr Field kTextureInfo[] = {index("index", "/textures", kRequired),
                                  integer("texCoord", 0, 255),
                                  object("extensions", kInfoExtensions)};
constexpr Field kPbr[] = {numbers("baseColorFactor", 4), object("baseColorTexture", kTextureInfo)};
constexpr Field kSpecularGlossiness[] = {numbers("diffuseFactor", 4),
                                         object("diffuseTexture", kTextureInfo)};
constexpr Field kStrength[] = {number("emissiveStrength", 0)};
constexpr Field kMaterialExtensions[] = {
    object("KHR_materials_emissive_strength", kStrength), object("KHR_materials_unlit", {}),
    object("KHR_materials_pbrSpecularGlossiness", kSpecularGlossiness)};
constexpr Field kMaterial[] = {object("pbrMetallicRoughness", kPbr),
                               object("emissiveTexture", kTextureInfo),
                               numbers("emissiveFactor", 3, 0),
                               text("alphaMode"),
                               number("alphaCutoff", 0),
                               boolean("doubleSided"),
                               text("name"),
                               object("extensions", kMaterialExtensions)};

constexpr Field kSpot[] = {number("innerConeAngle", 0), number("outerConeAngle", 0)};
constexpr Field kLight[] = {text("type", kRequired), numbers("color", 3, 0), number("intensity", 0),
                            number("range", 0), object("spot", kSpot)};
constexpr Field kLightList[] = {objects("lights", kLight, kRequired)};
constexpr Field kRootExtensions[] = {object("KHR_lights_punctual", kLightList)};

constexpr Field kPerspective[] = {number("yfov")};
constexpr Field kOrthographic[] = {number("ymag")};
constexpr Field kCamera[] = {text("type"), text("name"), object("perspective", kPerspective),
                             object("orthographic", kOrthographic)};

constexpr Field kRoot[] = {object("asset", kAsset, kRequired),
                           {"extensionsUsed", Kind::kStrings},
                           {"extensionsRequired", Kind::kStrings},
                           index("scene", "/scenes"),
                           objects("scenes", kSceneFields),
                           objects("nodes", kNode),
                           objects("meshes", kMesh),
                           objects("accessors", kAccessor),
                           objects("bufferViews", kBufferView),
                           objects("buffers", kBuffer),
                           objects("images", kImage),
                           objects("textures", kTexture),
                           objects("samplers", kSampler),
                           objects("materials", kMaterial),
                           objects("skins", {}),
                           objects("animations", {}),
                           objects("cameras", kCamera),
                           object("extensions", kRootExtensions)};

}  // namespace

std::span<const Field> gltf_fields() {
  return kRoot;
}

}  // namespace kiln::gltf
