#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <limits>
#include <nlohmann/json.hpp>
#include <span>
#include <sstream>
#include <string>
#include <vector>

#include "baker/scene/gltf_json.h"

namespace kiln::baker {
namespace {

using nlohmann::json;

enum class Kind {
  kBool,
  kString,
  kWord,       ///< one of the words of `target`, which are parted by spaces
  kInteger,    ///< in [low, high]
  kNumber,     ///< in [low, high]; fits a float
  kNumbers,    ///< array of `length` kNumbers, any length when 0
  kIndex,      ///< into the collection `target`
  kIndices,    ///< array of those
  kIndexMap,   ///< object whose members are kIndex
  kIndexMaps,  ///< array of those
  kStrings,
  kObject,   ///< described by `fields`
  kObjects,  ///< array of those
};

/// One property of a glTF object. What is not listed is not read by a bake, and is removed.
struct Field {
  const char* name;
  Kind kind;
  bool required = false;
  const char* target = nullptr;
  std::span<const Field> fields{};
  std::size_t length = 0;
  double low = std::numeric_limits<double>::lowest(), high = std::numeric_limits<double>::max();
};

constexpr bool kRequired = true;
constexpr double kMaxSize = 9007199254740991.0;  // 2^53 - 1: exact in JSON
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

// The parts of glTF 2.0 and of its extensions that a bake reads [glTF 2.0, section 5]
// --------------
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

constexpr Field kPrimitiveExtensions[] = {object("KHR_draco_mesh_compression", {})};
constexpr Field kPrimitive[] = {{"attributes", Kind::kIndexMap, kRequired, "/accessors"},
                                index("indices", "/accessors"),
                                index("material", "/materials"),
                                integer("mode", 0, 6),
                                {"targets", Kind::kIndexMaps, false, "/accessors"},
                                object("extensions", kPrimitiveExtensions)};
constexpr Field kMesh[] = {objects("primitives", kPrimitive, kRequired), numbers("weights", 0),
                           text("name")};

constexpr double kMaxOffset = 2147483647;  // sparse offsets and counts: int in the glTF library
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
constexpr Field kBufferView[] = {index("buffer", "/buffers", kRequired), integer("byteOffset", 0),
                                 integer("byteLength", 1, kMaxSize, kRequired),
                                 integer("byteStride", 4, 252), integer("target", 0, 65535)};
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
                           objects("cameras", {}),
                           object("extensions", kRootExtensions)};

/// Walks document and tables together; stops at the first wrong place. Where it is in the document
/// is kept as a path, since a pointer's text is needed only when something is wrong.
class Checker {
 public:
  explicit Checker(json& root) : root_(root) {}

  proto::Expected<void> run() {
    if (!check_object(root_, kRoot)) return proto::Unexpected(error_);
    return {};
  }

 private:
  struct Step {
    std::string_view key;
    std::size_t index = 0;  ///< when key has no data
  };

  bool wrong(const std::string& what) {
    std::string pointer;
    for (const Step& step : path_) {
      pointer = step.key.data() ? pointer_to(pointer, step.key) : pointer_to(pointer, step.index);
    }
    error_ = proto::fail("invalid_scene", what, "scene", pointer).value();
    return false;
  }

  template <class Check>
  bool within(Step step, Check check) {
    path_.push_back(step);
    const bool fine = check();
    path_.pop_back();
    return fine;
  }

  template <class Check>
  bool each(json& array, Check check) {
    if (!array.is_array()) return wrong("expected an array");
    for (std::size_t i = 0; i < array.size(); ++i) {
      if (!within({{}, i}, [&] { return check(array[i]); })) return false;
    }
    return true;
  }

  template <class Check>
  bool each_member(json& value, Check check) {
    if (!value.is_object()) return wrong("expected an object");
    for (auto& [key, member] : value.get_ref<json::object_t&>()) {
      if (!within({key}, [&, &m = member] { return check(m); })) return false;
    }
    return true;
  }

  bool check_object(json& value, std::span<const Field> fields) {
    if (!value.is_object()) return wrong("expected an object");
    auto& members = value.get_ref<json::object_t&>();
    for (auto m = members.begin(); m != members.end();) {
      const bool listed = std::any_of(fields.begin(), fields.end(),
                                      [&](const Field& f) { return m->first == f.name; });
      m = listed ? std::next(m) : members.erase(m);
    }
    for (const Field& field : fields) {
      const auto member = members.find(field.name);
      if (member != members.end()) {
        if (!within({field.name}, [&] { return check(member->second, field); })) return false;
      } else if (field.required) {
        return wrong(std::string("misses the required property \"") + field.name + "\"");
      }
    }
    return true;
  }

  /// Ends that only stand for what a type can hold are left out of the message.
  bool out_of_range(double low, double high) {
    const auto number = [](double v) {
      return v == std::trunc(v) ? json(static_cast<std::int64_t>(v)).dump() : json(v).dump();
    };
    if (low <= -kMaxSize && high >= kMaxSize) return wrong("is too large a number");
    if (high >= kMaxOffset) return wrong("is out of range: expected at least " + number(low));
    return wrong("is out of range: expected " + number(low) + " to " + number(high));
  }

  bool check_integer(json& value, double low, double high) {
    if (!value.is_number()) return wrong("expected an integer");
    const double v = value.get<double>();
    if (std::abs(v) > kMaxSize) return out_of_range(low, high);
    if (std::trunc(v) != v) return wrong("expected an integer");
    if (v < low || v > high) return out_of_range(low, high);
    if (v >= 0) {
      value = static_cast<std::uint64_t>(v);
    } else {
      value = static_cast<std::int64_t>(v);
    }
    return true;
  }

  bool check_number(const json& value, const Field& f) {
    if (!value.is_number()) return wrong("expected a number");
    const double v = value.get<double>();
    return (v >= f.low && v <= f.high) || out_of_range(f.low, f.high);
  }

  bool check_numbers(json& value, const Field& f) {
    if (value.is_array() && f.length != 0 && value.size() != f.length) {
      return wrong("expected an array of " + std::to_string(f.length) + " numbers");
    }
    return each(value, [&](const json& element) { return check_number(element, f); });
  }

  /// Elements of a collection; what is not an array has none.
  std::size_t size_of(const char* target) {
    if (target != size_target_) {  // runs of the same target are the rule
      const json::json_pointer place{std::string(target)};
      const bool is_array = root_.contains(place) && root_.at(place).is_array();
      size_ = is_array ? root_.at(place).size() : 0;
      size_target_ = target;
    }
    return size_;
  }

  bool check_index(json& value, const char* target) {
    if (!check_integer(value, -kMaxSize, kMaxSize)) return false;
    const double size = static_cast<double>(size_of(target));
    const double v = value.get<double>();
    return (v >= 0 && v < size) || wrong("is the index " + value.dump() + ", but " + target +
                                         " has " + std::to_string(size_of(target)) + " elements");
  }

  bool check_word(const json& value, const char* words) {
    if (!value.is_string()) return wrong("expected a string");
    std::istringstream list(words);
    for (std::string w; list >> w;) {
      if (value.get_ref<const std::string&>() == w) return true;
    }
    return wrong(std::string("expected one of ") + words);
  }

  bool check_index_map(json& value, const char* target) {
    return each_member(value, [&](json& member) { return check_index(member, target); });
  }

  bool check(json& value, const Field& f) {
    switch (f.kind) {
      case Kind::kBool:
        return value.is_boolean() || wrong("expected true or false");
      case Kind::kString:
        return value.is_string() || wrong("expected a string");
      case Kind::kWord:
        return check_word(value, f.target);
      case Kind::kInteger:
        return check_integer(value, f.low, f.high);
      case Kind::kNumber:
        return check_number(value, f);
      case Kind::kNumbers:
        return check_numbers(value, f);
      case Kind::kIndex:
        return check_index(value, f.target);
      case Kind::kIndexMap:
        return check_index_map(value, f.target);
      case Kind::kObject:
        return check_object(value, f.fields);
      case Kind::kStrings:
        return each(value, [&](json& e) { return e.is_string() || wrong("expected a string"); });
      case Kind::kIndices:
        return each(value, [&](json& e) { return check_index(e, f.target); });
      case Kind::kIndexMaps:
        return each(value, [&](json& e) { return check_index_map(e, f.target); });
      case Kind::kObjects:
        return each(value, [&](json& e) { return check_object(e, f.fields); });
    }
    return false;
  }

  json& root_;
  proto::Error error_;
  std::vector<Step> path_;
  const char* size_target_ = nullptr;
  std::size_t size_ = 0;
};

}  // namespace

proto::Expected<void> check_and_prune(json& document) {
  return Checker(document).run();
}

}  // namespace kiln::baker
