#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstdlib>
#include <new>
#include <vector>

#include "baker/image/image.h"
#include "server/sandbox/child.h"
#include "server/sandbox/confine.h"
#include "server/sandbox/image_wire.h"

namespace kiln::sandbox {
namespace {

/// Sends to this program and receives from it over the standard output, which is the socket of the
/// talk. This process ends when nobody is at the other end any more.
class ImagePeer {
 public:
  static void send(const void* bytes, std::size_t size) {
    auto from = static_cast<const char*>(bytes);
    while (size > 0) {
      const ssize_t n = ::write(STDOUT_FILENO, from, size);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) std::_Exit(1);
      from += n;
      size -= static_cast<std::size_t>(n);
    }
  }
  static void send(const ImageMessage& message) { send(&message, sizeof message); }

  static void receive(void* bytes, std::size_t size) {
    auto to = static_cast<char*>(bytes);
    while (size > 0) {
      const ssize_t n = ::read(STDOUT_FILENO, to, size);
      if (n < 0 && errno == EINTR) continue;
      if (n <= 0) std::_Exit(1);
      to += n;
      size -= static_cast<std::size_t>(n);
    }
  }
};

/// Called when `new` gets no memory. Messages are sent without allocating, so this never comes in
/// the middle of one.
[[noreturn]] void end_image_for_want_of_memory() {
  ImagePeer::send({ImageWord::kNoMemory, 0, 0});
  std::_Exit(0);
}

struct AskedRows final : image::FloatRows {
  explicit AskedRows(const ImageHead& call) : head(call) {}

  std::span<const float> rows(std::uint32_t y0, std::uint32_t y1) override {
    values.resize(std::size_t(y1 - y0) * head.width * head.channels.size());
    ImagePeer::send({ImageWord::kRows, y1, y0});
    ImagePeer::receive(values.data(), values.size() * sizeof(float));
    return values;
  }

  const ImageHead& head;
  std::vector<float> values;
};

/// Sends what is written one behind the other in large pieces.
class SentSink final : public image::Sink {
 public:
  SentSink() { gathered_.reserve(kMaxImagePiece); }

  bool write(std::uint64_t at, const void* bytes, std::size_t size) override {
    auto from = static_cast<const char*>(bytes);
    if (at != at_ + gathered_.size()) {
      flush();
      at_ = at;
    }
    while (size > 0) {
      const std::size_t now = std::min(size, kMaxImagePiece - gathered_.size());
      gathered_.insert(gathered_.end(), from, from + now);
      from += now;
      size -= now;
      if (gathered_.size() == kMaxImagePiece) flush();
    }
    return true;
  }
  void flush() {
    if (gathered_.empty()) return;
    ImagePeer::send({ImageWord::kWrite, std::uint32_t(gathered_.size()), at_});
    ImagePeer::send(gathered_.data(), gathered_.size());
    at_ += gathered_.size();
    gathered_.clear();
  }

 private:
  std::uint64_t at_ = 0;  ///< of what is gathered
  std::vector<char> gathered_;
};

void send_pixels(std::span<const char> bytes) {
  while (!bytes.empty()) {
    const auto now = bytes.first(std::min<std::size_t>(bytes.size(), kMaxImagePiece));
    ImagePeer::send({ImageWord::kPixels, std::uint32_t(now.size()), 0});
    ImagePeer::send(now.data(), now.size());
    bytes = bytes.subspan(now.size());
  }
}

template <class T>
std::span<const char> chars_of(const std::vector<T>& values) {
  return {reinterpret_cast<const char*>(values.data()), values.size() * sizeof(T)};
}

image::Outcome read_picture(const image::Module& module, const ImageHead& head) {
  std::vector<std::string> bytes;
  for (const std::uint64_t size : head.parts)
    ImagePeer::receive(bytes.emplace_back(size, '\0').data(), size);
  const std::vector<std::string_view> parts(bytes.begin(), bytes.end());
  const image::Source source{head.format, parts, head.width, head.height, head.rows, head.layer};
  const std::size_t count = std::size_t(head.width) * head.height;
  if (head.function == ImageFunction::kReadRgb) {
    std::vector<math::Rgb> rgb(count);
    std::vector<float> alpha(head.alpha ? count : 0);
    auto outcome = module.read_rgb(source, rgb, alpha, {});
    if (outcome.end != image::Outcome::End::kWhole) return outcome;
    send_pixels(chars_of(rgb));
    send_pixels(chars_of(alpha));
    return outcome;
  }
  std::vector<std::array<std::uint8_t, 4>> texels(count);
  const bool alpha_only = head.function == ImageFunction::kReadAlpha8;
  auto outcome = (alpha_only ? module.read_alpha8 : module.read_rgba8)(source, texels, {});
  if (outcome.end != image::Outcome::End::kWhole) return outcome;
  if (!alpha_only) {
    send_pixels(chars_of(texels));
    return outcome;
  }
  std::vector<std::uint8_t> alpha;
  alpha.reserve(count);
  for (const auto& texel : texels) alpha.push_back(texel[3]);
  send_pixels(chars_of(alpha));
  return outcome;
}

image::Outcome write_picture(const image::Module& module, const ImageHead& head) {
  SentSink sink;
  image::Outcome outcome;
  if (head.function == ImageFunction::kWriteExr) {
    AskedRows rows(head);
    outcome = module.write_exr(
        {head.width, head.height, head.tile, head.half_floats, head.channels, head.metadata}, rows,
        sink, {});
  } else {
    std::vector<std::uint8_t> samples(std::size_t(head.width) * head.height *
                                      std::size_t(head.samples));
    ImagePeer::receive(samples.data(), samples.size());
    outcome = module.write_png(samples, head.width, head.height, head.samples, sink);
  }
  sink.flush();
  return outcome;
}

image::Outcome call_module(const ImportRequest& request) {
  const auto head = parse_head(request.image);
  if (!head) return {image::Outcome::End::kUnavailable, head.error().message};
  const auto module = image::module();  // the zygote has opened it
  if (!module) return {image::Outcome::End::kUnavailable, module.error().message};
  (void)confine({request.memory_bytes, request.seconds, 1, 0});  // the importer tells how well
  const bool writes =
      head->function == ImageFunction::kWriteExr || head->function == ImageFunction::kWritePng;
  try {
    return writes ? write_picture(**module, *head) : read_picture(**module, *head);
  } catch (const std::bad_alloc&) {
    end_image_for_want_of_memory();
  } catch (const std::exception& e) {
    return {image::Outcome::End::kUnavailable, e.what()};
  }
}

}  // namespace

void run_image_call(const ImportRequest& request) {
  std::set_new_handler(end_image_for_want_of_memory);
  image::Outcome outcome = call_module(request);
  if (outcome.words.size() > kMaxImageWords) outcome.words.resize(kMaxImageWords);
  ImagePeer::send(
      {ImageWord::kEnd, std::uint32_t(outcome.words.size()), std::uint64_t(outcome.end)});
  ImagePeer::send(outcome.words.data(), outcome.words.size());
  std::_Exit(0);
}

}  // namespace kiln::sandbox
