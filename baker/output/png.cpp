#include "baker/output/png.h"

#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/imageio.h>

#include <stdexcept>

#include "baker/output/output.h"

namespace kiln::baker {

proto::Expected<std::string> encode_png_bytes(std::span<const std::uint8_t> samples,
                                              std::uint32_t width, std::uint32_t height,
                                              int channels) {
  if (width == 0 || samples.size() != std::size_t(width) * height * std::size_t(channels))
    throw std::invalid_argument("encode_png: the size does not fit the samples");
  auto out = OIIO::ImageOutput::create("png");
  if (!out) return proto::fail("internal", "OpenImageIO cannot write PNG: " + OIIO::geterror());

  std::vector<unsigned char> bytes;
  OIIO::Filesystem::IOVecOutput memory(bytes);
  OIIO::ImageSpec spec(int(width), int(height), channels, OIIO::TypeDesc::UINT8);
  spec.attribute("oiio:UnassociatedAlpha", 1);
  if (!out->set_ioproxy(&memory) || !out->open("page.png", spec) ||
      !out->write_image(OIIO::TypeDesc::UINT8, samples.data()) || !out->close())
    return proto::fail("internal", "cannot encode a PNG: " + out->geterror());
  return std::string(bytes.begin(), bytes.end());
}

proto::Expected<std::string> encode_png(std::span<const std::array<std::uint8_t, 3>> pixels,
                                        std::uint32_t width, std::uint32_t height) {
  return encode_png_bytes({pixels.empty() ? nullptr : pixels[0].data(), pixels.size() * 3}, width,
                          height, 3);
}

}  // namespace kiln::baker
