#include "tests/support/sky_files.h"

#include <OpenEXR/ImfChannelList.h>
#include <OpenEXR/ImfFrameBuffer.h>
#include <OpenEXR/ImfHeader.h>
#include <OpenEXR/ImfOutputFile.h>
#include <OpenEXR/ImfStandardAttributes.h>
#include <OpenEXR/ImfStdIO.h>
#include <OpenEXR/ImfTileDescription.h>
#include <OpenEXR/ImfTiledOutputFile.h>

#include <half.h>
#include <algorithm>
#include <array>

namespace kiln::test {
namespace {

using math::Rgb;
using Rgbe = std::array<unsigned char, 4>;

Rgbe rgbe(Rgb c) {
  const float brightest = math::max_channel(c);
  if (!(brightest > 1e-32f)) return {};
  int exponent = 0;
  const float scale = std::frexp(brightest, &exponent) * 256 / brightest;
  const auto mantissa = [&](float v) { return static_cast<unsigned char>(v * scale); };
  return {mantissa(c.r), mantissa(c.g), mantissa(c.b), static_cast<unsigned char>(exponent + 128)};
}

void put(std::string& out, unsigned value) {
  out += static_cast<char>(static_cast<unsigned char>(value));
}

void pack(std::string& out, const std::vector<Rgbe>& row) {
  put(out, 2), put(out, 2);
  put(out, unsigned(row.size() >> 8)), put(out, unsigned(row.size() & 255));
  for (std::size_t c = 0; c < 4; ++c)
    for (std::size_t x = 0, end = 0; x < row.size(); x = end) {
      while (end < row.size() && end - x < 127 && row[end][c] == row[x][c]) ++end;
      if (end - x > 1) {
        put(out, unsigned(128 + end - x)), put(out, row[x][c]);
        continue;
      }
      // Different values, up to where two are alike.
      while (end < row.size() && end - x < 128 && row[end][c] != row[end - 1][c]) ++end;
      put(out, unsigned(end - x));
      for (std::size_t i = x; i < end; ++i) put(out, row[i][c]);
    }
}

void repeat(std::string& out, const std::vector<Rgbe>& row) {
  for (std::size_t x = 0, end = 0; x < row.size(); x = end) {
    while (end < row.size() && end - x < 60'000 && row[end] == row[x]) ++end;
    for (const unsigned v : row[x]) put(out, v);
    const auto more = unsigned(end - x - 1);
    if (more == 0) continue;
    for (const unsigned v : {1u, 1u, 1u, more & 255u}) put(out, v);
    if (more > 255)
      for (const unsigned v : {1u, 1u, 1u, more >> 8}) put(out, v);
  }
}

template <class File, class Header>
void write(Imf::OStream& out, const Header& header, const Imf::FrameBuffer& frame, int rows) {
  File file(out, header, 0);
  file.setFrameBuffer(frame);
  if constexpr (std::is_same_v<File, Imf::TiledOutputFile>)
    file.writeTiles(0, file.numXTiles() - 1, 0, file.numYTiles() - 1);
  else
    file.writePixels(rows);
}

}  // namespace

std::string hdr_file(const SkyPicture& picture, HdrRows rows, const std::string& lines) {
  std::string out = "#?RADIANCE\n# a comment\nFORMAT=32-bit_rle_rgbe\n" + lines + "\n-Y " +
                    std::to_string(picture.height) + " +X " + std::to_string(picture.width) + "\n";
  for (std::uint32_t y = 0; y < picture.height; ++y) {
    std::vector<Rgbe> row;
    for (std::uint32_t x = 0; x < picture.width; ++x)
      row.push_back(rgbe(picture.pixels[y * picture.width + x]));
    if (rows == HdrRows::kPacked)
      pack(out, row);
    else if (rows == HdrRows::kRepeated)
      repeat(out, row);
    else
      for (const Rgbe& pixel : row)
        for (const unsigned v : pixel) put(out, v);
  }
  return out;
}

math::Rgb hdr_rounded(Rgb c) {
  const Rgbe p = rgbe(c);
  const float scale = p[3] == 0 ? 0 : std::ldexp(1.f, int(p[3]) - 136);
  return {float(p[0]) * scale, float(p[1]) * scale, float(p[2]) * scale};
}

std::string exr_file(const SkyPicture& picture, const ExrStorage& storage) {
  const Imf::PixelType type = storage.half ? Imf::HALF : Imf::FLOAT;
  Imf::Header header(int(picture.width), int(picture.height));
  header.compression() = static_cast<Imf::Compression>(storage.compression);
  if (const auto& c = storage.chromaticities; !c.empty())
    Imf::addChromaticities(header, {{c[0], c[1]}, {c[2], c[3]}, {c[4], c[5]}, {c[6], c[7]}});
  std::vector<half> halves;
  for (const Rgb& c : picture.pixels)
    if (storage.half)
      for (const float v : {c.r, c.g, c.b}) halves.emplace_back(v);
  const std::size_t value = storage.half ? sizeof(half) : sizeof(float), pixel = 3 * value;
  const char* first = storage.half ? reinterpret_cast<const char*>(halves.data())
                                   : reinterpret_cast<const char*>(picture.pixels.data());
  Imf::FrameBuffer frame;
  for (std::size_t c = 0; c < storage.channels.size(); ++c) {
    header.channels().insert(storage.channels[c], Imf::Channel(type));
    frame.insert(storage.channels[c],
                 Imf::Slice::Make(type, first + std::min<std::size_t>(c, 2) * value, {0, 0},
                                  picture.width, picture.height, pixel, pixel * picture.width));
  }
  Imf::StdOSStream out;
  if (storage.tiled) {
    header.setTileDescription({16, 8, Imf::ONE_LEVEL});
    write<Imf::TiledOutputFile>(out, header, frame, int(picture.height));
  } else {
    write<Imf::OutputFile>(out, header, frame, int(picture.height));
  }
  return out.str();
}

}  // namespace kiln::test
