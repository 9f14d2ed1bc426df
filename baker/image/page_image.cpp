#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>

#include "baker/files/mapped_file.h"
#include "baker/image/image.h"
#include "baker/image/page_image.h"
#include "proto/files.h"

namespace kiln::image {
namespace {

using proto::fail;
using proto::Fd;

constexpr std::uint32_t kTile = 64;
constexpr float kMaxHalf = 65504;
/// Larger files from outside are refused.
constexpr std::uint64_t kMaxSide = 1 << 16, kMaxPixels = 1 << 27;

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
      return fail("internal", "layer '" + layer.name + "' has a value that " +
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

/// All channels in the order of channel_names().
class LayerRows final : public FloatRows {
 public:
  explicit LayerRows(std::span<const ExrLayer> layers) : layers_(layers) {}

  std::span<const float> rows(std::uint32_t y0, std::uint32_t y1) override {
    const std::size_t width = layers_[0].image->width;
    values_.clear();
    values_.reserve(width * (y1 - y0) * (4 + 3 * (layers_.size() - 1)));
    for (std::size_t i = y0 * width; i < y1 * width; ++i)
      for (const ExrLayer& layer : layers_) {
        const math::Rgb v = layer.image->rgb[i];
        values_.insert(values_.end(), {v.r, v.g, v.b});
        if (&layer == layers_.data()) values_.push_back(layer.image->coverage[i] > 0 ? 1.f : 0.f);
      }
    return values_;
  }

 private:
  std::span<const ExrLayer> layers_;
  std::vector<float> values_;
};

/// Writes to a file, and gathers what comes one behind the other.
class FileSink final : public Sink {
 public:
  explicit FileSink(int fd) : fd_(fd) {}

  bool write(std::uint64_t at, const void* bytes, std::size_t size) override {
    constexpr std::size_t kGathered = std::size_t{1} << 20;
    if (at != at_ + gathered_.size() || gathered_.size() + size > kGathered) {
      if (!flush()) return false;
      at_ = at;
      gathered_.reserve(kGathered);
    }
    if (size > kGathered) return put(static_cast<const char*>(bytes), size);
    gathered_.append(static_cast<const char*>(bytes), size);
    return true;
  }
  bool flush() {
    const bool done = put(gathered_.data(), gathered_.size());
    gathered_.clear();
    return done;
  }
  int error() const { return error_; }

 private:
  bool put(const char* bytes, std::size_t size) {
    while (size > 0 && error_ == 0) {
      const ssize_t n = ::pwrite(fd_, bytes, size, static_cast<off_t>(at_));
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) {
        error_ = n < 0 ? errno : EIO;
        break;
      }
      bytes += n;
      size -= static_cast<std::size_t>(n);
      at_ += static_cast<std::uint64_t>(n);
    }
    return error_ == 0;
  }

  int fd_;
  int error_ = 0;
  std::uint64_t at_ = 0;  ///< of what is gathered
  std::string gathered_;
};

/// Returns false when the file has no such layer.
bool choose_layer(Header& header, std::string_view layer) {
  if (layer.empty() || layer == header.layers.front()) return true;
  header.layer = layer;
  return std::find(header.layers.begin() + 1, header.layers.end(), layer) != header.layers.end();
}

std::string list_layers(const Header& header) {
  std::string names;
  for (const std::string& name : header.layers)
    if (!name.empty()) names += (names.empty() ? "" : ", ") + name;
  return names.empty() ? "its layers have no names" : "its layers are " + names;
}

}  // namespace

proto::Expected<void> write_exr(const std::filesystem::path& path, std::span<const ExrLayer> layers,
                                proto::Precision precision,
                                std::span<const std::pair<std::string, std::string>> metadata,
                                const std::stop_token& stop) {
  if (auto ok = check_layers(layers, precision); !ok) return ok;
  const Fd file(::open(path.c_str(), O_CREAT | O_TRUNC | O_WRONLY | O_CLOEXEC, 0666));
  if (!file.valid()) return proto::storage_error("create", path);
  const std::vector<std::string> names = channel_names(layers);
  const ExrPlan plan{layers[0].image->width,
                     layers[0].image->height,
                     kTile,
                     precision == proto::Precision::kHalf,
                     names,
                     metadata};
  LayerRows rows(layers);
  FileSink sink(file.get());
  const auto written = encode_exr(plan, rows, sink, stop);
  if (written) sink.flush();
  if (sink.error() != 0) {
    errno = sink.error();
    return proto::storage_error("write", path);
  }
  return written;
}

proto::Expected<PageImage> read_exr(const std::filesystem::path& path, std::string_view layer,
                                    const std::stop_token& stop) {
  const auto wrong = [&](const std::string& what) {
    return fail("invalid_image", "OpenEXR: " + what);
  };
  const auto mapped = files::MappedFile::open(path, files::MappedFile::kAnyLength);
  if (!mapped) return wrong(mapped.error().message);
  if (format_of(mapped->bytes()) != Format::kExr) return wrong("it is another file");
  auto header = read_header(mapped->bytes());
  if (!header) return wrong(header.error().message);
  const std::uint64_t width = header->size.width, height = header->size.height;
  if (width > kMaxSide || height > kMaxSide || width * height > kMaxPixels)
    return wrong("the size of " + std::to_string(width) + " x " + std::to_string(height) +
                 " is over the limit");
  if (!choose_layer(*header, layer))
    return wrong("it has no layer '" + std::string(layer) + "'; " + list_layers(*header));
  PageImage image;
  image.width = header->size.width;
  image.height = header->size.height;
  image.rgb.resize(width * height);
  image.coverage.resize(width * height);
  auto decoded = decode_rgb(*header, image.rgb, image.coverage, stop);
  if (!decoded && decoded.error().code == "invalid_image") return wrong(decoded.error().message);
  if (!decoded) return proto::Unexpected(std::move(decoded.error()));
  for (float& a : image.coverage)
    if (!(a > 0.5f)) a = 0;
  return image;
}

proto::Expected<std::string> encode_png(std::span<const std::array<std::uint8_t, 3>> pixels,
                                        std::uint32_t width, std::uint32_t height) {
  return encode_png({pixels.empty() ? nullptr : pixels[0].data(), pixels.size() * 3}, width, height,
                    3);
}

}  // namespace kiln::image
