#pragma once

#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <string>
#include <vector>

#include <jpeglib.h>  // after <cstdio>: it names FILE

namespace kiln::test {

/// Says how samples become a JPEG file.
struct JpegOptions {
  std::uint32_t width = 0, height = 0;
  J_COLOR_SPACE color_space = JCS_RGB;
  int channels = 3;
  int quality = 75;
  bool progressive = false;
};

/// Returns the file of `channels` samples for each pixel, row 0 = top.
inline std::string jpeg_file(const JpegOptions& options, std::vector<std::uint8_t> samples) {
  jpeg_compress_struct jpeg{};
  jpeg_error_mgr errors{};
  jpeg.err = jpeg_std_error(&errors);
  jpeg_create_compress(&jpeg);
  unsigned char* bytes = nullptr;
  unsigned long size = 0;
  jpeg_mem_dest(&jpeg, &bytes, &size);
  jpeg.image_width = options.width;
  jpeg.image_height = options.height;
  jpeg.input_components = options.channels;
  jpeg.in_color_space = options.color_space;
  jpeg_set_defaults(&jpeg);
  jpeg_set_quality(&jpeg, options.quality, TRUE);
  if (options.progressive) jpeg_simple_progression(&jpeg);
  jpeg_start_compress(&jpeg, TRUE);
  for (std::uint32_t y = 0; y < options.height; ++y) {
    JSAMPROW row = &samples[std::size_t(y) * options.width * std::size_t(options.channels)];
    jpeg_write_scanlines(&jpeg, &row, 1);
  }
  jpeg_finish_compress(&jpeg);
  jpeg_destroy_compress(&jpeg);
  std::string file(reinterpret_cast<const char*>(bytes), size);
  std::free(bytes);
  return file;
}

}  // namespace kiln::test
