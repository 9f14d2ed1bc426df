// liblightkiln-image.so: the only source that includes OpenImageIO.
#include <OpenImageIO/filesystem.h>
#include <OpenImageIO/half.h>
#include <OpenImageIO/imageio.h>

#include <algorithm>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>
#include <stdexcept>
#include <vector>

#include "baker/image/module.h"

// OpenImageIO gives each format these functions. They are called directly, because its registry
// would read the environment and load every plug-in that is named there.
OIIO_NAMESPACE_BEGIN
ImageInput* png_input_imageio_create();
ImageInput* jpeg_input_imageio_create();
ImageInput* webp_input_imageio_create();
ImageInput* openexr_input_imageio_create();
ImageInput* hdr_input_imageio_create();
ImageInput* tiff_input_imageio_create();
ImageOutput* png_output_imageio_create();
ImageOutput* openexr_output_imageio_create();
OIIO_NAMESPACE_END

namespace kiln::image {
namespace {

using math::Rgb;

constexpr const char* kName = "image";  // in messages: there is no file

std::unique_ptr<OIIO::ImageInput> reader_of(Format format) {
  switch (format) {
    case Format::kPng:
      return std::unique_ptr<OIIO::ImageInput>(OIIO::png_input_imageio_create());
    case Format::kJpeg:
      return std::unique_ptr<OIIO::ImageInput>(OIIO::jpeg_input_imageio_create());
    case Format::kWebp:
      return std::unique_ptr<OIIO::ImageInput>(OIIO::webp_input_imageio_create());
    case Format::kExr:
      return std::unique_ptr<OIIO::ImageInput>(OIIO::openexr_input_imageio_create());
    case Format::kHdr:
      return std::unique_ptr<OIIO::ImageInput>(OIIO::hdr_input_imageio_create());
    case Format::kTiff:
      return std::unique_ptr<OIIO::ImageInput>(OIIO::tiff_input_imageio_create());
  }
  throw std::logic_error("there is no such format");
}

/// The parts of a file as one. Ends where a stop is requested, so that readers that decode all at
/// once end, too.
class Parts {
 public:
  Parts(std::span<const std::string_view> parts, const std::stop_token& stop)
      : parts_(parts), stop_(stop) {
    for (const std::string_view part : parts) size_ += part.size();
  }
  std::size_t size() const { return size_; }

  std::size_t read(char* to, std::size_t count, std::uint64_t at) const {
    std::size_t done = 0;
    if (stop_.stop_requested()) return 0;
    for (const std::string_view part : parts_) {
      if (at < part.size()) {
        const std::size_t n = part.copy(to + done, count - done, at);
        done += n;
        at = 0;
      } else {
        at -= part.size();
      }
      if (done == count) break;
    }
    return done;
  }

 private:
  std::span<const std::string_view> parts_;
  const std::stop_token& stop_;
  std::size_t size_ = 0;
};

class PartsProxy final : public OIIO::Filesystem::IOProxy {
 public:
  explicit PartsProxy(const Parts& parts) : IOProxy(kName, Read), parts_(parts) {}
  const char* proxytype() const override { return "parts"; }
  std::size_t size() const override { return parts_.size(); }
  bool seek(std::int64_t to) override {
    if (to < 0) return false;
    m_pos = to;
    return true;
  }
  std::size_t read(void* to, std::size_t count) override {
    const std::size_t n = pread(to, count, m_pos);
    m_pos += std::int64_t(n);
    return n;
  }
  std::size_t pread(void* to, std::size_t count, std::int64_t at) override {
    return at < 0 ? 0 : parts_.read(static_cast<char*>(to), count, std::uint64_t(at));
  }

 private:
  const Parts& parts_;
};

/// A FILE without a file, since the JPEG reader takes nothing else.
class PartsFile {
 public:
  explicit PartsFile(const Parts& parts) : parts_(parts) {
    file_ = ::fopencookie(this, "rb", {read, nullptr, seek, nullptr});
    if (file_ == nullptr) throw std::bad_alloc();
  }
  ~PartsFile() { std::fclose(file_); }
  PartsFile(const PartsFile&) = delete;
  PartsFile& operator=(const PartsFile&) = delete;
  std::FILE* get() const { return file_; }

 private:
  static ssize_t read(void* cookie, char* to, std::size_t count) {
    auto& self = *static_cast<PartsFile*>(cookie);
    const std::size_t n = self.parts_.read(to, count, std::uint64_t(self.at_));
    self.at_ += std::int64_t(n);
    return ssize_t(n);
  }
  static int seek(void* cookie, off64_t* offset, int origin) {
    auto& self = *static_cast<PartsFile*>(cookie);
    std::int64_t to = *offset;
    if (origin == SEEK_CUR) to += self.at_;
    if (origin == SEEK_END) to += std::int64_t(self.parts_.size());
    if (to < 0) return -1;
    *offset = self.at_ = to;
    return 0;
  }

  const Parts& parts_;
  std::int64_t at_ = 0;
  std::FILE* file_ = nullptr;
};
class PartsFileProxy final : public OIIO::Filesystem::IOFile {
 public:
  PartsFileProxy(const Parts& parts, const PartsFile& file)
      : IOFile(file.get(), Read), parts_(parts) {}
  std::size_t pread(void* to, std::size_t count, std::int64_t at) override {
    return at < 0 ? 0 : parts_.read(static_cast<char*>(to), count, std::uint64_t(at));
  }

 private:
  const Parts& parts_;
};

/// The first thing that the library complained of, or the last, which ended it; without what it
/// puts around: the format's name before, the file's behind.
std::string reason(std::string words, bool last) {
  while (words.ends_with('\n')) words.pop_back();
  if (last)
    words.erase(0, words.rfind('\n') + 1);
  else
    words.erase(std::min(words.find('\n'), words.size()));
  for (const char* before :
       {"JPEG error: ", "PNG read error: ", "OpenEXR exception: ", "Failed OpenEXR read: ",
        "Error reading pixel data from image file \"image\". "})
    if (words.starts_with(before)) words.erase(0, std::strlen(before));
  for (const char* behind : {" (\"image\")", " \"image\"."})
    if (words.ends_with(behind)) words.erase(words.size() - std::strlen(behind));
  return words;
}

/// An open picture.
class Reader {
 public:
  Reader(const Source& source, const std::stop_token& stop)
      : source_(source), stop_(stop), parts_(source.parts, stop), proxy_(parts_) {
    if (source.format == Format::kJpeg) {
      file_.emplace(parts_);
      file_proxy_.emplace(parts_, *file_);
    }
    reader_ = reader_of(source.format);
    reader_->threads(1);
  }
  Reader(const Reader&) = delete;
  Reader& operator=(const Reader&) = delete;
  ~Reader() {
    try {
      reader_->close();
      (void)reader_->geterror();       // it prints what nobody asked for
    } catch (const std::bad_alloc&) {  // what brought us here is flying already
    }
  }

  /// Calls take(y0, y1), which returns whether it read those rows, from the first row to the last.
  template <class Take>
  Outcome read(const Take& take) {
    if (!open()) return failed();
    for (std::uint32_t y = 0; y < source_.height; y += source_.rows) {
      if (stop_.stop_requested()) return {Outcome::End::kStopped, ""};
      if (!take(y, std::min(y + source_.rows, source_.height))) return failed();
    }
    if (stop_.stop_requested()) return {Outcome::End::kStopped, ""};
    return {Outcome::End::kWhole, reason(reader_->geterror(), false)};
  }

  const OIIO::ImageSpec& spec() const { return spec_; }

  /// Channels [first, last) of the rows [y0, y1), interleaved, in the file's own types: to convert
  /// them the library would take 64 MB.
  bool take(std::uint32_t y0, std::uint32_t y1, int first, int last, void* to) {
    const int top = spec_.y + int(y0), bottom = spec_.y + int(y1);
    if (spec_.tile_width > 0)
      return reader_->read_tiles(0, 0, spec_.x, spec_.x + spec_.width, top, bottom, 0, 1, first,
                                 last, OIIO::TypeUnknown, to);
    return reader_->read_native_scanlines(0, 0, top, bottom, 0, first, last, to);
  }

 private:
  bool open() {
    OIIO::ImageSpec config;
    OIIO::Filesystem::IOProxy* proxy = &proxy_;
    if (file_proxy_) proxy = &*file_proxy_;
    config.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &proxy);
    config.attribute("oiio:UnassociatedAlpha", 1);
    if (!reader_->open(kName, spec_, config)) return false;
    const bool same = spec_.width == int(source_.width) && spec_.height == int(source_.height);
    if (!same) why_ = "its size is declared twice";
    if (same && (spec_.deep || spec_.depth > 1)) why_ = "it is no plain picture";
    return why_.empty();
  }
  Outcome failed() {
    if (stop_.stop_requested()) return {Outcome::End::kStopped, ""};
    std::string words = reason(reader_->geterror(), true);
    if (!why_.empty()) words = why_;
    return {Outcome::End::kFailed, words.empty() ? "it is damaged" : words};
  }

  const Source& source_;
  const std::stop_token& stop_;
  Parts parts_;
  PartsProxy proxy_;
  std::optional<PartsFile> file_;
  std::optional<PartsFileProxy> file_proxy_;
  std::unique_ptr<OIIO::ImageInput> reader_;
  OIIO::ImageSpec spec_;
  std::string why_;
};

/// One pixel of 1 (gray), 2 (gray, alpha), 3 or 4 samples.
template <class Sample, class To8>
std::array<std::uint8_t, 4> texel(const Sample* s, int channels, const To8& to8) {
  const bool gray = channels < 3;
  const std::uint8_t alpha = channels % 2 == 0 ? to8(s[channels - 1]) : std::uint8_t{255};
  return {to8(s[0]), to8(s[gray ? 0 : 1]), to8(s[gray ? 0 : 2]), alpha};
}

template <class Sample, class To8>
bool take_texels(Reader& reader, std::uint32_t y0, std::uint32_t y1, std::vector<Sample>& samples,
                 const To8& to8, Texels texels, bool alpha_only) {
  const int channels = reader.spec().nchannels;
  const std::size_t step = std::size_t(channels);
  samples.resize(texels.size() * step);
  if (!reader.take(y0, y1, 0, channels, samples.data())) return false;
  for (std::size_t i = 0; i < texels.size(); ++i) {
    const auto t = texel(&samples[i * step], channels, to8);
    if (alpha_only)
      texels[i][3] = t[3];
    else
      texels[i] = t;
  }
  return true;
}

Outcome read_8(const Source& source, Texels texels, bool alpha_only, const std::stop_token& stop) {
  Reader reader(source, stop);
  std::vector<std::uint8_t> bytes;
  std::vector<std::uint16_t> words;
  return reader.read([&](std::uint32_t y0, std::uint32_t y1) {
    const int channels = reader.spec().nchannels;
    if (channels < 1 || channels > 4) return false;
    const Texels rows =
        texels.subspan(std::size_t(y0) * source.width, std::size_t(y1 - y0) * source.width);
    if (reader.spec().format != OIIO::TypeUInt8 && reader.spec().format != OIIO::TypeUInt16)
      return false;
    if (reader.spec().format == OIIO::TypeUInt16)
      return take_texels(
          reader, y0, y1, words,
          [](std::uint16_t v) { return std::uint8_t((v * 255u + 32895u) >> 16); }, rows,
          alpha_only);
    return take_texels(
        reader, y0, y1, bytes, [](std::uint8_t v) { return v; }, rows, alpha_only);
  });
}

Outcome read_rgba8(const Source& source, Texels texels, const std::stop_token& stop) {
  return read_8(source, texels, false, stop);
}

Outcome read_alpha8(const Source& source, Texels texels, const std::stop_token& stop) {
  return read_8(source, texels, true, stop);
}

/// The place and type of a channel in interleaved pixels.
struct Channel {
  std::size_t offset = 0;
  bool is_half = false;

  float operator()(const char* pixel) const {
    if (is_half) {
      half value;
      std::memcpy(&value, pixel + offset, sizeof value);
      return value;
    }
    float value = 0;
    std::memcpy(&value, pixel + offset, sizeof value);
    return value;
  }
};

/// The channels R, G, B of a layer, and A, among those of a picture.
struct Channels {
  std::array<Channel, 4> rgba;
  bool has_alpha = false;
  int first = 0, last = 0;      ///< those that hold them all
  std::size_t pixel_bytes = 0;  ///< of these

  /// Returns false when one is missing, or of another type.
  bool find(const OIIO::ImageSpec& spec, std::string_view layer, bool alpha) {
    std::array<int, 4> at{};
    std::string prefix(layer);
    if (!layer.empty()) prefix += '.';
    for (std::size_t c = 0; c < 3; ++c) at[c] = spec.channelindex(prefix + "RGB"[c]);
    at[3] = spec.channelindex("A");
    has_alpha = alpha && at[3] >= 0;
    if (!has_alpha) at[3] = at[0];
    first = *std::min_element(at.begin(), at.end());
    last = *std::max_element(at.begin(), at.end()) + 1;
    if (first < 0) return false;
    pixel_bytes = spec.pixel_bytes(first, last, true);
    for (std::size_t c = 0; c < at.size(); ++c) {
      const OIIO::TypeDesc type = spec.channelformat(at[c]);
      if (type != OIIO::TypeHalf && type != OIIO::TypeFloat) return false;
      rgba[c] = {at[c] > first ? spec.pixel_bytes(first, at[c], true) : 0, type == OIIO::TypeHalf};
    }
    return true;
  }
};

Outcome read_rgb(const Source& source, std::span<Rgb> rgb, std::span<float> alpha,
                 const std::stop_token& stop) {
  Reader reader(source, stop);
  std::vector<char> pixels;
  return reader.read([&](std::uint32_t y0, std::uint32_t y1) {
    Channels channels;
    if (!channels.find(reader.spec(), source.layer, !alpha.empty())) return false;
    pixels.resize(std::size_t(y1 - y0) * source.width * channels.pixel_bytes);
    if (!reader.take(y0, y1, channels.first, channels.last, pixels.data())) return false;
    const auto& [r, g, b, a] = channels.rgba;
    const char* pixel = pixels.data();
    for (std::size_t i = std::size_t(y0) * source.width, end = std::size_t(y1) * source.width;
         i < end; ++i, pixel += channels.pixel_bytes) {
      rgb[i] = {r(pixel), g(pixel), b(pixel)};
      if (!alpha.empty()) alpha[i] = channels.has_alpha ? a(pixel) : 1;
    }
    return true;
  });
}

class SinkProxy final : public OIIO::Filesystem::IOProxy {
 public:
  explicit SinkProxy(Sink& sink) : IOProxy(kName, Write), sink_(sink) {}
  const char* proxytype() const override { return "sink"; }
  std::size_t write(const void* bytes, std::size_t count) override {
    failed_ = failed_ || !sink_.write(std::uint64_t(m_pos), bytes, count);
    if (failed_) return 0;
    m_pos += std::int64_t(count);
    return count;
  }
  bool failed() const { return failed_; }

 private:
  Sink& sink_;
  bool failed_ = false;
};

/// Calls put(writer), which returns Outcome's end, between opening and closing.
template <class Put>
Outcome write(OIIO::ImageOutput* created, OIIO::ImageSpec& spec, Sink& sink, const Put& put) {
  const std::unique_ptr<OIIO::ImageOutput> writer(created);
  SinkProxy proxy(sink);
  OIIO::Filesystem::IOProxy* to = &proxy;
  spec.attribute("oiio:ioproxy", OIIO::TypeDesc::PTR, &to);
  writer->threads(1);
  Outcome outcome{Outcome::End::kFailed, ""};
  if (writer->open(kName, spec)) outcome.end = put(*writer);
  const bool closed = writer->close();
  outcome.words = reason(writer->geterror(), true);
  if (outcome.end == Outcome::End::kWhole && (!closed || proxy.failed()))
    outcome.end = Outcome::End::kFailed;
  return outcome;
}

Outcome write_exr(const ExrPlan& plan, FloatRows& pixels, Sink& sink, const std::stop_token& stop) {
  OIIO::ImageSpec spec(int(plan.width), int(plan.height), int(plan.channels.size()),
                       plan.half_floats ? OIIO::TypeHalf : OIIO::TypeFloat);
  spec.channelnames.assign(plan.channels.begin(), plan.channels.end());
  spec.tile_width = spec.tile_height = int(plan.tile);
  spec.attribute("compression", "zip");
  // A date that is no text is written by nobody; without one the library writes today's.
  spec.attribute("DateTime", 0);
  for (const auto& [name, value] : plan.metadata) spec.attribute(name, value);
  return write(OIIO::openexr_output_imageio_create(), spec, sink, [&](OIIO::ImageOutput& writer) {
    for (std::uint32_t y0 = 0; y0 < plan.height; y0 += plan.tile) {
      if (stop.stop_requested()) return Outcome::End::kStopped;
      const std::uint32_t y1 = std::min(y0 + plan.tile, plan.height);
      if (!writer.write_tiles(0, spec.width, int(y0), int(y1), 0, 1, OIIO::TypeFloat,
                              pixels.rows(y0, y1).data()))
        return Outcome::End::kFailed;
    }
    return Outcome::End::kWhole;
  });
}

Outcome write_png(std::span<const std::uint8_t> samples, std::uint32_t width, std::uint32_t height,
                  int channels, Sink& sink) {
  constexpr int kAverage = 0x40;  // PNG_FILTER_AVG
  OIIO::ImageSpec spec(int(width), int(height), channels, OIIO::TypeUInt8);
  // For baked light, runs after the "average" filter come out as small as all filters with full
  // matching do, in a tenth of the time.
  spec.attribute("compression", "rle");
  spec.attribute("png:filter", kAverage);
  spec.attribute("oiio:UnassociatedAlpha", 1);
  return write(OIIO::png_output_imageio_create(), spec, sink, [&](OIIO::ImageOutput& writer) {
    return writer.write_image(OIIO::TypeUInt8, samples.data()) ? Outcome::End::kWhole
                                                               : Outcome::End::kFailed;
  });
}

}  // namespace
}  // namespace kiln::image

extern "C" __attribute__((visibility("default"))) const kiln::image::Module*
lightkiln_image_module() {
  using namespace kiln::image;
  // These overrule OPENIMAGEIO_OPTIONS. -1: no threads in OpenEXR.
  OIIO::attribute("debug", 0);
  OIIO::attribute("threads", 1);
  OIIO::attribute("exr_threads", -1);
  OIIO::attribute("openexr:core", 0);
  OIIO::attribute("missingcolor", "");
  OIIO::attribute("tiff:half", 0);
  // Once a format is known, the library looks for no plug-ins; LD_LIBRARY_PATH could name some.
  const char* no_extensions[] = {nullptr};
  OIIO::declare_imageio_format("png", nullptr, no_extensions, OIIO::png_output_imageio_create,
                               no_extensions, nullptr);
  static constexpr Module kModule{kInterfaceVersion, LIGHTKILN_VERSION, read_rgba8, read_alpha8,
                                  read_rgb,          write_exr,         write_png};
  return &kModule;
}
