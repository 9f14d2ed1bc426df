#include "server/sandbox/image_wire.h"

#include <nlohmann/json.hpp>

#include "proto/json.h"

namespace kiln::sandbox {

std::string head_text(const ImageHead& head) {
  return proto::to_text({{"function", static_cast<int>(head.function)},
                         {"width", head.width},
                         {"height", head.height},
                         {"format", static_cast<int>(head.format)},
                         {"rows", head.rows},
                         {"alpha", head.alpha},
                         {"layer", head.layer},
                         {"parts", head.parts},
                         {"tile", head.tile},
                         {"half_floats", head.half_floats},
                         {"channels", head.channels},
                         {"metadata", head.metadata},
                         {"samples", head.samples}});
}

proto::Expected<ImageHead> parse_head(const std::string& text) {
  auto document = proto::parse_json(text, "image call");
  if (!document) return proto::fail("bad_document", document.error().message);
  ImageHead head;
  try {
    head.function = static_cast<ImageFunction>(document->at("function").get<std::uint8_t>());
    document->at("width").get_to(head.width);
    document->at("height").get_to(head.height);
    head.format = static_cast<image::Format>(document->at("format").get<std::uint8_t>());
    document->at("rows").get_to(head.rows);
    document->at("alpha").get_to(head.alpha);
    document->at("layer").get_to(head.layer);
    document->at("parts").get_to(head.parts);
    document->at("tile").get_to(head.tile);
    document->at("half_floats").get_to(head.half_floats);
    document->at("channels").get_to(head.channels);
    document->at("metadata").get_to(head.metadata);
    document->at("samples").get_to(head.samples);
  } catch (const nlohmann::json::exception& e) {
    return proto::fail("bad_document", e.what());
  }
  return head;
}

}  // namespace kiln::sandbox
