#include "server/sandbox/image_process.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstring>
#include <new>
#include <stdexcept>
#include <thread>

#include "baker/image/image.h"
#include "server/sandbox/protocol.h"
#include "server/sandbox/spawn.h"

namespace kiln::sandbox {
namespace {

using image::ExrPlan;
using image::FloatRows;
using image::Outcome;
using image::Sink;
using image::Source;
using image::Texels;

std::uint64_t bytes_of(const auto& spans) {
  std::uint64_t all = 0;
  for (const auto& span : spans) all += span.size();
  return all;
}

/// Returns the bytes of the floats of `rows` rows of an EXR page.
std::uint64_t bytes_of_rows(const ImageHead& head, std::uint64_t rows) {
  return rows * head.width * head.channels.size() * sizeof(float);
}

/// Returns a length that no encoded picture has: data that can't be packed is stored as it is, with
/// tables and names beside it.
std::uint64_t most_encoded_bytes(const ImageCall& call) {
  std::uint64_t beside = 1 << 20;
  for (const auto& [name, value] : call.head.metadata) beside += name.size() + value.size();
  return beside + 2 * (bytes_of(call.input) + bytes_of_rows(call.head, call.head.height));
}

/// The bytes that go both ways, on a socket that does not block. All functions throw Broken.
class ImageLine {
 public:
  struct Broken {
    Outcome outcome;
  };

  ImageLine(int socket, const std::stop_token& stop, std::chrono::milliseconds silence)
      : socket_(socket),
        stop_(stop),
        silence_(silence),
        wake_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)),
        on_stop_(stop, [this] { ::eventfd_write(wake_.get(), 1); }) {}
  ImageLine(const ImageLine&) = delete;
  ImageLine& operator=(const ImageLine&) = delete;

  /// Returns false when nobody reads: what the other side said before that can still be received.
  bool send(std::span<const char> bytes) {
    while (!bytes.empty()) {
      const ssize_t n = ::send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL);
      if (n < 0 && errno != EINTR && errno != EAGAIN) return false;
      if (n < 0)
        wait_for(POLLOUT);
      else
        bytes = bytes.subspan(static_cast<std::size_t>(n));
    }
    return true;
  }

  void receive(std::span<char> bytes) {
    while (!bytes.empty()) {
      const ssize_t n = ::recv(socket_, bytes.data(), bytes.size(), 0);
      if (n == 0 || (n < 0 && errno != EINTR && errno != EAGAIN)) throw gone();
      if (n < 0)
        wait_for(POLLIN);
      else
        bytes = bytes.subspan(static_cast<std::size_t>(n));
    }
  }

  void check_stop() const {
    if (stop_.stop_requested()) throw Broken{{Outcome::End::kStopped, ""}};
  }

  /// The end of a talk in which the other side breaks the rules.
  static Broken broken(const std::string& how) {
    return {{Outcome::End::kUnavailable, "The image process " + how + "."}};
  }

 private:
  static Broken gone() { return {{Outcome::End::kUnavailable, ""}}; }

  void wait_for(short events) {
    std::array<pollfd, 2> files{{{socket_, events, 0}, {wake_.get(), POLLIN, 0}}};
    const int ready = ::poll(files.data(), files.size(), static_cast<int>(silence_.count()));
    check_stop();
    if (ready == 0) throw broken("is silent");
  }

  int socket_;
  const std::stop_token& stop_;
  std::chrono::milliseconds silence_;
  proto::Fd wake_;
  std::stop_callback<std::function<void()>> on_stop_;
};

/// Answers the messages of one process until its last.
class ImageTalk {
 public:
  ImageTalk(const ImageCall& call, ImageLine& line) : call_(call), line_(line) {}

  Outcome hold() {
    for (const auto part : call_.input)
      if (!line_.send(part)) break;
    for (;;) {
      line_.check_stop();
      ImageMessage message;
      line_.receive({reinterpret_cast<char*>(&message), sizeof message});
      switch (message.word) {
        case ImageWord::kRows:
          give_rows(message);
          continue;
        case ImageWord::kWrite:
          if (!write(message)) return {Outcome::End::kFailed, "what was written could not be kept"};
          continue;
        case ImageWord::kPixels:
          take_pixels(message);
          continue;
        case ImageWord::kEnd:
          return end_of(message);
        case ImageWord::kNoMemory:
          throw std::bad_alloc();
      }
      throw ImageLine::broken("sent an unknown message");
    }
  }

 private:
  void give_rows(const ImageMessage& message) {
    const ImageHead& head = call_.head;
    const std::uint64_t y0 = message.at, y1 = message.size;
    if (call_.rows == nullptr || y0 >= y1 || y1 > head.height || y1 - y0 > head.tile)
      throw ImageLine::broken("asked for rows that there are not");
    const auto floats = call_.rows->rows(std::uint32_t(y0), std::uint32_t(y1));
    if (floats.size_bytes() != bytes_of_rows(head, y1 - y0))
      throw std::logic_error("rows of an EXR page have another size than its plan");
    line_.send({reinterpret_cast<const char*>(floats.data()), floats.size_bytes()});
  }

  bool write(const ImageMessage& message) {
    const std::uint64_t most = most_encoded_bytes(call_);
    if (call_.sink == nullptr || message.size > kMaxImagePiece || message.at > most ||
        message.size > most - message.at)
      throw ImageLine::broken("wrote more than a picture can have");
    piece_.resize(message.size);
    line_.receive(piece_);
    return call_.sink->write(message.at, piece_.data(), piece_.size());
  }

  void take_pixels(const ImageMessage& message) {
    if (message.size > kMaxImagePiece || message.size > bytes_of(call_.pixels) - decoded_)
      throw ImageLine::broken("decoded more than the picture has");
    std::uint64_t skip = decoded_, left = message.size;
    decoded_ += message.size;
    for (const std::span<char> part : call_.pixels) {
      const std::uint64_t from = std::min<std::uint64_t>(skip, part.size());
      const std::uint64_t size = std::min<std::uint64_t>(left, part.size() - from);
      line_.receive(part.subspan(from, size));
      skip -= from;
      left -= size;
    }
  }

  Outcome end_of(const ImageMessage& message) {
    if (message.size > kMaxImageWords || message.at > std::uint64_t(Outcome::End::kUnavailable))
      throw ImageLine::broken("sent an end that there is not");
    Outcome outcome{static_cast<Outcome::End>(message.at), std::string(message.size, '\0')};
    line_.receive(outcome.words);
    if (outcome.end == Outcome::End::kStopped) throw ImageLine::broken("stopped by itself");
    if (outcome.end == Outcome::End::kWhole && decoded_ != bytes_of(call_.pixels))
      throw ImageLine::broken("decoded less than the picture has");
    return outcome;
  }

  const ImageCall& call_;
  ImageLine& line_;
  std::vector<char> piece_;
  std::uint64_t decoded_ = 0;
};

Outcome no_image_process(const std::string& why) {
  return {Outcome::End::kUnavailable, "The image process can't be started: " + why + "."};
}

/// Makes the request of a call. Libraries need memory beside the picture; no picture makes them
/// take more than this.
ImportRequest request_of(const ImageCall& call) {
  constexpr std::uint64_t kBeside = std::uint64_t{1} << 30, kCopies = 8;
  ImportRequest request;
  request.work = ImportWork::kImage;
  request.image = head_text(call.head);
  request.memory_bytes = kBeside + kCopies * (bytes_of(call.input) + bytes_of(call.pixels) +
                                              bytes_of_rows(call.head, call.head.tile));
  return request;
}

/// Forks a process. A zygote that ends meanwhile is replaced, so this waits for the next one.
std::optional<pid_t> fork_image_process(const ImageProcesses::Options& options,
                                        std::span<const int> files, const std::stop_token& stop) {
  constexpr std::chrono::milliseconds kPause{20};
  const auto late = std::chrono::steady_clock::now() + options.patience;
  for (;;) {
    const auto left =
        std::chrono::ceil<std::chrono::milliseconds>(late - std::chrono::steady_clock::now());
    const auto pid = options.zygote->fork(files, std::max(left, left.zero()), stop);
    if (pid || stop.stop_requested() || left <= left.zero()) return pid;
    std::this_thread::sleep_for(kPause);
  }
}

std::string words_of_end(int status) {
  if (WIFSIGNALED(status))
    return "The image process was ended by signal " + std::to_string(WTERMSIG(status)) + " (" +
           ::sigdescr_np(WTERMSIG(status)) + ").";
  return "The image process ended with code " + std::to_string(WEXITSTATUS(status)) + ".";
}

/// Makes one call in a process of its own. When this returns there is no such process any more.
Outcome run_image_process(const ImageProcesses::Options& options, const ImageCall& call,
                          const std::stop_token& stop) {
  const auto request = request_file(request_of(call));
  if (!request) return no_image_process(request.error().message);
  std::array<int, 2> ends{};
  if (::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()) != 0)
    return no_image_process(std::strerror(errno));
  const proto::Fd ours(ends[0]);
  proto::Fd theirs(ends[1]);
  ::fcntl(ours.get(), F_SETFL, O_NONBLOCK);
  proto::Fd silence(::open("/dev/null", O_RDWR | O_CLOEXEC));
  const auto pid =
      fork_image_process(options, std::array{request->get(), theirs.get(), silence.get()}, stop);
  if (stop.stop_requested() && !pid) return {Outcome::End::kStopped, ""};
  if (!pid) return no_image_process("no process that has the image module open answers");
  Child child(*pid);
  theirs.reset();
  silence.reset();
  if (options.started) options.started(*pid);
  Outcome outcome = hold_image_talk(call, ours.get(), stop);
  const int status = child.end();
  if (outcome.end == Outcome::End::kUnavailable && outcome.words.empty())
    outcome.words = words_of_end(status);
  return outcome;
}

/// The functions of the table have no object, so the processes' options are found here.
std::shared_ptr<const ImageProcesses::Options> image_options;

ImageCall reading_call(ImageFunction function, const Source& source) {
  ImageCall call;
  call.head.function = function;
  call.head.width = source.width;
  call.head.height = source.height;
  call.head.format = source.format;
  call.head.rows = source.rows;
  for (const std::string_view part : source.parts) {
    call.head.parts.push_back(part.size());
    call.input.emplace_back(part);
  }
  return call;
}

template <class T>
std::span<char> chars_of(std::span<T> values) {
  return {reinterpret_cast<char*>(values.data()), values.size_bytes()};
}

Outcome read_rgba8_elsewhere(const Source& source, Texels texels, const std::stop_token& stop) {
  ImageCall call = reading_call(ImageFunction::kReadRgba8, source);
  call.pixels = {chars_of(texels)};
  return run_image_process(*image_options, call, stop);
}

Outcome read_alpha8_elsewhere(const Source& source, Texels texels, const std::stop_token& stop) {
  ImageCall call = reading_call(ImageFunction::kReadAlpha8, source);
  std::vector<std::uint8_t> alpha(texels.size());
  call.pixels = {chars_of(std::span(alpha))};
  Outcome outcome = run_image_process(*image_options, call, stop);
  if (outcome.end == Outcome::End::kWhole)
    for (std::size_t i = 0; i < alpha.size(); ++i) texels[i][3] = alpha[i];
  return outcome;
}

Outcome read_rgb_elsewhere(const Source& source, std::span<math::Rgb> rgb, std::span<float> alpha,
                           const std::stop_token& stop) {
  ImageCall call = reading_call(ImageFunction::kReadRgb, source);
  call.head.alpha = !alpha.empty();
  call.pixels = {chars_of(rgb), chars_of(alpha)};
  return run_image_process(*image_options, call, stop);
}

Outcome write_exr_elsewhere(const ExrPlan& plan, FloatRows& rows, Sink& sink,
                            const std::stop_token& stop) {
  ImageCall call;
  call.head.function = ImageFunction::kWriteExr;
  call.head.width = plan.width;
  call.head.height = plan.height;
  call.head.tile = plan.tile;
  call.head.half_floats = plan.half_floats;
  call.head.channels.assign(plan.channels.begin(), plan.channels.end());
  call.head.metadata.assign(plan.metadata.begin(), plan.metadata.end());
  call.rows = &rows;
  call.sink = &sink;
  return run_image_process(*image_options, call, stop);
}

Outcome write_png_elsewhere(std::span<const std::uint8_t> samples, std::uint32_t width,
                            std::uint32_t height, int channels, Sink& sink) {
  ImageCall call;
  call.head.function = ImageFunction::kWritePng;
  call.head.width = width;
  call.head.height = height;
  call.head.samples = channels;
  call.input.emplace_back(reinterpret_cast<const char*>(samples.data()), samples.size());
  call.sink = &sink;
  return run_image_process(*image_options, call, {});
}

proto::Expected<void> image_module_of_zygote() {
  if (std::string fault = image_options->zygote->fault(); !fault.empty())
    return proto::fail("internal", std::move(fault));
  return {};
}

constexpr image::Module kElsewhere{
    image::kInterfaceVersion, LIGHTKILN_VERSION,   read_rgba8_elsewhere, read_alpha8_elsewhere,
    read_rgb_elsewhere,       write_exr_elsewhere, write_png_elsewhere};

}  // namespace

image::Outcome hold_image_talk(const ImageCall& call, int socket, const std::stop_token& stop,
                               std::chrono::milliseconds silence) {
  try {
    ImageLine line(socket, stop, silence);
    return ImageTalk(call, line).hold();
  } catch (ImageLine::Broken& broken) {
    return std::move(broken.outcome);
  }
}

ImageProcesses::ImageProcesses(Options options) {
  image_options = std::make_shared<const Options>(std::move(options));
  image::use_module(&kElsewhere, image_module_of_zygote);
}

ImageProcesses::~ImageProcesses() {
  image::use_module(nullptr);
  image_options.reset();
}

}  // namespace kiln::sandbox
