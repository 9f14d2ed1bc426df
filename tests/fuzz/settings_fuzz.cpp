// The JSON documents of a request: settings and options. What is accepted is said again the same.
#include <cstdint>
#include <nlohmann/json.hpp>

#include "proto/json.h"
#include "tests/fuzz/require.h"

using namespace kiln;

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  const std::string_view text(reinterpret_cast<const char*>(data), size);
  const auto document = proto::parse_json(text, "request");
  if (!document) {
    FUZZ_REQUIRE(document.error().code == "invalid_json");
    (void)proto::parse_settings(text);
    return 0;
  }
  (void)proto::to_text(*document);
  if (const auto settings = proto::settings_from_json(*document)) {
    const std::string said = proto::to_text(proto::to_json(*settings));
    const auto again = proto::parse_settings(said);
    FUZZ_REQUIRE(again);
    FUZZ_REQUIRE(proto::to_text(proto::to_json(*again)) == said);
  } else {
    FUZZ_REQUIRE(settings.error().code == "invalid_settings");
    (void)proto::to_text(proto::to_json(settings.error()));
  }
  if (const auto options = proto::job_options_from_json(*document)) {
    nlohmann::json told = proto::to_json(*options);
    const std::string said = proto::to_text(told);
    if (told.at("ttl_seconds").is_null()) told.erase("ttl_seconds");  // told, not taken
    const auto again = proto::job_options_from_json(told);
    FUZZ_REQUIRE(again);
    FUZZ_REQUIRE(proto::to_text(proto::to_json(*again)) == said);
  }
  (void)proto::job_patch_from_json(*document);
  (void)proto::error_from_json(*document);
  (void)proto::manifest_from_json(*document);
  return 0;
}
