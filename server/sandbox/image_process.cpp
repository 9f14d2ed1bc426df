#include "server/sandbox/image_process.h"

#include <fcntl.h>
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
#include "server/sandbox/image_talk.h"
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
  call.head.layer = source.layer;
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

ImageProcesses::ImageProcesses(Options options) {
  image_options = std::make_shared<const Options>(std::move(options));
  image::use_module(&kElsewhere, image_module_of_zygote);
}

ImageProcesses::~ImageProcesses() {
  image::use_module(nullptr);
  image_options.reset();
}

}  // namespace kiln::sandbox
