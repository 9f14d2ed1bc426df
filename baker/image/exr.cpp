#include <IexErrnoExc.h>
#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfInputPart.h>
#include <OpenEXR/ImfMultiPartInputFile.h>
#include <OpenEXR/ImfPartType.h>
#include <OpenEXR/ImfStringAttribute.h>
#include <OpenEXR/ImfTileDescription.h>
#include <OpenEXR/ImfTiledOutputFile.h>
#include <half.h>

#include <cmath>
#include <new>

#include "baker/image/page_image.h"

namespace kiln::image {
namespace {

using proto::fail;

constexpr std::uint32_t kTile = 64;
constexpr float kMaxHalf = 65504;

// Of files from outside: checked against the header before memory is taken.
constexpr std::int64_t kMaxSide = 1 << 16, kMaxPixels = 1 << 27, kMaxTilePixels = 1 << 22;
constexpr int kMaxChannels = 1024;

proto::Expected<void> check_layers(std::span<const ExrLayer> layers, proto::Precision precision) {
  if (layers.empty()) throw std::invalid_argument("write_exr: no layer");
  const PageImage& first = *layers[0].image;
  for (const ExrLayer& layer : layers) {
    const PageImage& image = *layer.image;
    if (image.width != first.width || image.height != first.height || image.rgb.empty())
      throw std::invalid_argument("write_exr: layers of different sizes, or an empty page");
    for (std::size_t i = 0; i < image.rgb.size(); ++i) {
      const math::Rgb v = image.rgb[i];
      const bool finite = std::isfinite(v.r) && std::isfinite(v.g) && std::isfinite(v.b);
      const float magnitude = std::max({std::abs(v.r), std::abs(v.g), std::abs(v.b)});
      if (finite && (precision == proto::Precision::kFloat || magnitude <= kMaxHalf)) continue;
      return proto::fail("internal", "layer '" + layer.name + "' has a value that " +
                                         (finite ? "half precision cannot hold" : "is not finite") +
                                         " at texel (" + std::to_string(i % image.width) + ", " +
                                         std::to_string(i / image.width) + ")");
    }
  }
  return {};
}

std::vector<std::string> channel_names(std::span<const ExrLayer> layers) {
  std::vector<std::string> names{"R", "G", "B", "A"};
  for (const ExrLayer& layer : layers.subspan(1))
    for (const char* c : {".R", ".G", ".B"}) names.push_back(layer.name + c);
  return names;
}

/// Rows [y0, y1) of all channels, interleaved in the order of channel_names().
template <class T>
std::vector<T> interleave(std::span<const ExrLayer> layers, std::uint32_t y0, std::uint32_t y1) {
  const std::uint32_t width = layers[0].image->width;
  std::vector<T> out;
  out.reserve(std::size_t(width) * (y1 - y0) * (4 + 3 * (layers.size() - 1)));
  for (std::size_t i = std::size_t(y0) * width; i < std::size_t(y1) * width; ++i) {
    for (const ExrLayer& layer : layers) {
      const math::Rgb v = layer.image->rgb[i];
      out.insert(out.end(), {T(v.r), T(v.g), T(v.b)});
      if (&layer == layers.data()) out.push_back(T(layer.image->coverage[i] > 0 ? 1.f : 0.f));
    }
  }
  return out;
}

/// False when stopped.
template <class T>
bool write_tiles(Imf::TiledOutputFile& file, std::span<const ExrLayer> layers, Imf::PixelType type,
                 const std::stop_token& stop) {
  const std::uint32_t width = layers[0].image->width, height = layers[0].image->height;
  const std::vector<std::string> names = channel_names(layers);
  for (std::uint32_t y0 = 0; y0 < height; y0 += kTile) {
    if (stop.stop_requested()) return false;
    const std::uint32_t rows = std::min(kTile, height - y0);
    const std::vector<T> pixels = interleave<T>(layers, y0, y0 + rows);
    const std::size_t stride = names.size() * sizeof(T);
    Imf::FrameBuffer frame;
    for (std::size_t c = 0; c < names.size(); ++c)
      frame.insert(names[c], Imf::Slice::Make(type, pixels.data() + c, {0, int(y0)}, width, rows,
                                              stride, stride * width));
    file.setFrameBuffer(frame);
    file.writeTiles(0, file.numXTiles() - 1, int(y0 / kTile), int(y0 / kTile));
  }
  return true;
}

proto::Unexpected invalid(const std::string& what) {
  return proto::fail("invalid_image", what);
}

proto::Expected<void> check_header(const Imf::Header& header) {
  const auto& box = header.dataWindow();
  const std::int64_t w = std::int64_t(box.max.x) - box.min.x + 1;
  const std::int64_t h = std::int64_t(box.max.y) - box.min.y + 1;
  if (w < 1 || h < 1 || w > kMaxSide || h > kMaxSide || w * h > kMaxPixels)
    return invalid("OpenEXR: the size of " + std::to_string(w) + " x " + std::to_string(h) +
                   " is over the limit");
  if (header.hasType() && header.type() != Imf::SCANLINEIMAGE && header.type() != Imf::TILEDIMAGE)
    return invalid("OpenEXR: the part is neither scan lines nor tiles");
  if (header.hasTileDescription()) {
    const auto& tile = header.tileDescription();
    if (std::int64_t(tile.xSize) * tile.ySize > kMaxTilePixels)
      return invalid("OpenEXR: tiles of " + std::to_string(tile.xSize) + " x " +
                     std::to_string(tile.ySize) + " are over the limit");
  }
  int channels = 0;
  for (auto c = header.channels().begin(); c != header.channels().end(); ++c) {
    if (c.channel().xSampling != 1 || c.channel().ySampling != 1)
      return invalid(std::string("OpenEXR: channel ") + c.name() + " is subsampled");
    if (++channels > kMaxChannels) return invalid("OpenEXR: over 1,024 channels");
  }
  for (const char* name : {"R", "G", "B"})
    if (!header.channels().findChannel(name))
      return invalid(std::string("OpenEXR: there is no channel ") + name);
  return {};
}

proto::Expected<PageImage> read_checked(const std::filesystem::path& path) {
  Imf::MultiPartInputFile file(path.c_str(), 0, /*reconstructChunkOffsetTable=*/false);
  if (auto ok = check_header(file.header(0)); !ok) return proto::Unexpected(ok.error());
  Imf::InputPart part(file, 0);
  const auto box = part.header().dataWindow();
  PageImage image;
  image.width = std::uint32_t(box.max.x - box.min.x + 1);
  image.height = std::uint32_t(box.max.y - box.min.y + 1);
  image.rgb.resize(std::size_t(image.width) * image.height);
  image.coverage.assign(image.rgb.size(), 1);

  Imf::FrameBuffer frame;
  const auto slice = [&](const char* name, float* first, std::size_t stride) {
    frame.insert(name, Imf::Slice::Make(Imf::FLOAT, first, box.min, image.width, image.height,
                                        stride, stride * image.width));
  };
  slice("R", &image.rgb[0].r, sizeof(math::Rgb));
  slice("G", &image.rgb[0].g, sizeof(math::Rgb));
  slice("B", &image.rgb[0].b, sizeof(math::Rgb));
  if (part.header().channels().findChannel("A")) slice("A", image.coverage.data(), sizeof(float));
  part.setFrameBuffer(frame);
  part.readPixels(box.min.y, box.max.y);
  for (float& a : image.coverage)
    if (!(a > 0.5f)) a = 0;
  return image;
}

}  // namespace

proto::Expected<void> write_exr(const std::filesystem::path& path, std::span<const ExrLayer> layers,
                                proto::Precision precision,
                                std::span<const std::pair<std::string, std::string>> metadata,
                                const std::stop_token& stop) {
  if (auto ok = check_layers(layers, precision); !ok) return ok;
  const bool half_floats = precision == proto::Precision::kHalf;
  const Imf::PixelType type = half_floats ? Imf::HALF : Imf::FLOAT;
  try {
    Imf::Header header(int(layers[0].image->width), int(layers[0].image->height));
    header.compression() = Imf::ZIP_COMPRESSION;
    header.setTileDescription({kTile, kTile, Imf::ONE_LEVEL});
    for (const std::string& name : channel_names(layers))
      header.channels().insert(name, Imf::Channel(type));
    for (const auto& [name, value] : metadata) header.insert(name, Imf::StringAttribute(value));
    Imf::TiledOutputFile file(path.c_str(), header, 0);
    const bool whole = half_floats ? write_tiles<half>(file, layers, type, stop)
                                   : write_tiles<float>(file, layers, type, stop);
    if (!whole) return proto::fail(proto::kCanceledCode, "the bake was cancelled");
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const Iex::EnospcExc&) {
    return proto::fail("storage_full", "There is no room on the disk for an EXR file.");
  } catch (const std::exception& e) {  // a missing folder and so on
    return proto::fail("io_error", std::string("cannot write an EXR file: ") + e.what());
  }
  return {};
}

proto::Expected<PageImage> read_exr(const std::filesystem::path& path) {
  try {
    return read_checked(path);
  } catch (const std::bad_alloc&) {
    throw;
  } catch (const std::exception& e) {  // a malformed file
    return invalid(std::string("OpenEXR: ") + e.what());
  }
}

}  // namespace kiln::image
