#include "server/sandbox/protocol.h"

#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <nlohmann/json.hpp>
#include <string_view>

#include "proto/json.h"

namespace kiln::sandbox {
namespace {

using nlohmann::json;
using proto::Expected;

constexpr std::array<const char*, 5> kWork{"probe", "check", "import", "lit", "image"};

/// An import says these of a scene. Any other code would be a word of the service's own.
constexpr std::array<std::string_view, 11> kCodes{
    "import_crashed",  "import_out_of_memory", "invalid_image",        "invalid_scene",
    "io_error",        "limit_exceeded",       "missing_file",         "no_light",
    "nothing_to_bake", "storage_full",         "unsupported_extension"};
constexpr std::string_view kSettings = "invalid_settings";

json limits_json(const files::ImportLimits& l) {
  return {{"file_bytes", l.file_bytes},
          {"json_bytes", l.json_bytes},
          {"json_depth", l.json_depth},
          {"nodes", l.nodes},
          {"node_depth", l.node_depth},
          {"vertices", l.vertices},
          {"triangles", l.triangles},
          {"image_pixels", l.image_pixels},
          {"all_image_pixels", l.all_image_pixels},
          {"lights", l.lights}};
}

files::ImportLimits limits_of(const json& from) {
  files::ImportLimits l;
  from.at("file_bytes").get_to(l.file_bytes);
  from.at("json_bytes").get_to(l.json_bytes);
  from.at("json_depth").get_to(l.json_depth);
  from.at("nodes").get_to(l.nodes);
  from.at("node_depth").get_to(l.node_depth);
  from.at("vertices").get_to(l.vertices);
  from.at("triangles").get_to(l.triangles);
  from.at("image_pixels").get_to(l.image_pixels);
  from.at("all_image_pixels").get_to(l.all_image_pixels);
  from.at("lights").get_to(l.lights);
  return l;
}

proto::Unexpected bad(const std::string& why) {
  return proto::fail("bad_document", why);
}

}  // namespace

std::string request_text(const ImportRequest& r) {
  json files = json::array();
  for (const ImportFile& file : r.files) files.push_back({{"name", file.name}, {"fd", file.fd}});
  return proto::to_text({{"work", kWork.at(static_cast<std::size_t>(r.work))},
                         {"key", r.key},
                         {"settings", r.settings},
                         {"limits", limits_json(r.limits)},
                         {"memory_bytes", r.memory_bytes},
                         {"most_memory_bytes", r.most_memory_bytes},
                         {"seconds", r.seconds},
                         {"files", std::move(files)},
                         {"sky_map", r.sky_map ? json(*r.sky_map) : json(nullptr)},
                         {"product", r.product},
                         {"orders", r.orders},
                         {"scene", r.scene},
                         {"lit", r.lit},
                         {"image", r.image}});
}

proto::Expected<ImportRequest> parse_request(const std::string& text) {
  auto document = proto::parse_json(text, "request");
  if (!document) return bad(document.error().message);
  ImportRequest r;
  try {
    const auto work =
        std::find(kWork.begin(), kWork.end(), document->at("work").get<std::string>());
    if (work == kWork.end()) return bad("unknown work");
    r.work = static_cast<ImportWork>(work - kWork.begin());
    document->at("key").get_to(r.key);
    document->at("settings").get_to(r.settings);
    r.limits = limits_of(document->at("limits"));
    document->at("memory_bytes").get_to(r.memory_bytes);
    document->at("most_memory_bytes").get_to(r.most_memory_bytes);
    document->at("seconds").get_to(r.seconds);
    for (const json& file : document->at("files"))
      r.files.push_back({file.at("name").get<std::string>(), file.at("fd").get<int>()});
    if (const json& name = document->at("sky_map"); !name.is_null())
      r.sky_map = name.get<std::string>();
    document->at("product").get_to(r.product);
    document->at("orders").get_to(r.orders);
    document->at("scene").get_to(r.scene);
    document->at("lit").get_to(r.lit);
    document->at("image").get_to(r.image);
  } catch (const json::exception& e) {
    return bad(e.what());
  }
  return r;
}

Expected<proto::Fd> request_file(const ImportRequest& request) {
  proto::Fd file(::memfd_create("import-request", MFD_CLOEXEC));
  if (!file.valid()) return proto::storage_error("create", "request");
  if (auto ok = proto::write_all(file.get(), request_text(request), "request"); !ok)
    return proto::Unexpected(ok.error());
  ::lseek(file.get(), 0, SEEK_SET);
  return file;
}

std::string answer_text(const ImportAnswer& answer) {
  json document{{"memory", answer.confinement.memory},
                {"no_seccomp", answer.confinement.no_seccomp}};
  if (answer.error) document["error"] = proto::to_json(*answer.error);
  return proto::to_text(document) + "\n";
}

proto::Expected<ImportAnswer> parse_answer(const std::string& text) {
  auto document = proto::parse_json(text, "answer");
  if (!document) return bad(document.error().message);
  ImportAnswer answer;
  try {
    document->at("memory").get_to(answer.confinement.memory);
    document->at("no_seccomp").get_to(answer.confinement.no_seccomp);
    if (!document->contains("error")) return answer;
  } catch (const json::exception& e) {
    return bad(e.what());
  }
  auto error = proto::error_from_json(document->at("error"));
  if (!error) return proto::Unexpected(error.error());
  if (error->code != kSettings &&
      std::find(kCodes.begin(), kCodes.end(), error->code) == kCodes.end())
    return bad("the code \"" + error->code + "\" is no import's");
  answer.error = std::move(*error);
  return answer;
}

}  // namespace kiln::sandbox
