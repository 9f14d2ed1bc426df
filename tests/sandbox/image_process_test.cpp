// Pictures that are decoded and encoded by processes forked from a zygote: they are those that this
// process would make itself, and a process that ends or lies fails one call.
#include "server/sandbox/image_process.h"

#include <fcntl.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>
#include <webp/encode.h>

#include <cstdlib>
#include <cstring>
#include <future>
#include <new>

#include "baker/image/image.h"
#include "server/sandbox/image_talk.h"
#include "tests/sandbox/isolated.h"
#include "tests/support/jpeg_file.h"
#include "tests/support/png_builder.h"
#include "tests/support/sky_files.h"

namespace kiln::test {
namespace {

using image::Outcome;

std::shared_ptr<sandbox::Zygote> image_zygote() {
  static const auto zygote = std::make_shared<sandbox::Zygote>(
      sandbox::Zygote::Options{LIGHTKILN_BINARY, [](const std::string&) {}});
  return zygote;
}

/// Pictures are made elsewhere while this lives.
struct Elsewhere {
  std::atomic<int> started{0};
  std::atomic<pid_t> pid{-1};
  sandbox::ImageProcesses processes;

  explicit Elsewhere(std::shared_ptr<sandbox::Zygote> zygote = image_zygote())
      : processes({.zygote = std::move(zygote), .started = [this](pid_t now) {
                     ++started;
                     pid = now;
                   }}) {}
};

struct Collected final : image::Sink {
  std::string bytes;
  bool full = false;
  bool write(std::uint64_t at, const void* from, std::size_t size) override {
    if (full) return false;
    bytes.resize(std::max<std::size_t>(bytes.size(), at + size));
    std::memcpy(bytes.data() + at, from, size);
    return true;
  }
};

/// Floats that are all different, and may call something in between.
struct Ramp final : image::FloatRows {
  std::uint32_t width;
  std::size_t channels;
  std::vector<float> values;
  std::function<void()> before = [] {};
  Ramp(std::uint32_t w, std::size_t c) : width(w), channels(c) {}
  std::span<const float> rows(std::uint32_t y0, std::uint32_t y1) override {
    before();
    values.clear();
    for (std::uint32_t y = y0; y < y1; ++y)
      for (std::size_t i = 0; i < width * channels; ++i)
        values.push_back(float((i * 7919 + y * 31) % 4099) * 0.37f);
    return values;
  }
};

const std::vector<std::string> kRgba{"R", "G", "B", "A"};
const std::vector<std::pair<std::string, std::string>> kNotes{{"lightkiln:units", "lux"}};

std::string exr_bytes(const std::vector<std::string>& channels, bool half, std::uint32_t width,
                      std::uint32_t height) {
  Ramp rows(width, channels.size());
  Collected sink;
  const auto done = image::encode_exr({width, height, 64, half, channels, kNotes}, rows, sink, {});
  EXPECT_TRUE(done) << done.error().message;
  return sink.bytes;
}

std::vector<std::uint8_t> samples_of(std::uint32_t width, std::uint32_t height, int channels) {
  std::vector<std::uint8_t> samples;
  for (std::size_t i = 0; i < std::size_t(width) * height * std::size_t(channels); ++i)
    samples.push_back(std::uint8_t(i * i / 7 % 251));
  return samples;
}

std::string jpeg_of(std::uint32_t width, std::uint32_t height) {
  return jpeg_file({.width = width, .height = height}, samples_of(width, height, 3));
}

std::string webp_file(int width, int height) {
  std::uint8_t* bytes = nullptr;
  const auto samples = samples_of(std::uint32_t(width), std::uint32_t(height), 4);
  const std::size_t size = WebPEncodeLosslessRGBA(samples.data(), width, height, 4 * width, &bytes);
  std::string file(reinterpret_cast<const char*>(bytes), size);
  WebPFree(bytes);
  return file;
}

/// One strip of RGB floats, little-endian.
std::string tiff_file(std::uint32_t width, std::uint32_t height) {
  std::string file("II\x2a\0\0\0\0\0", 8);
  const auto put = [&](std::uint32_t v, int bytes) {
    for (int i = 0; i < bytes; ++i) file += char(v >> (8 * i));
  };
  const std::uint32_t size = width * height * 12;
  for (std::uint32_t i = 0; i < width * height * 3; ++i) {
    const float value = float(i % 509) * 0.25f;
    std::uint32_t bits = 0;
    std::memcpy(&bits, &value, sizeof bits);
    put(bits, 4);
  }
  const std::uint32_t depths = 8 + size, formats = depths + 6, directory = formats + 6;
  for (const std::uint32_t v : {32, 32, 32, 3, 3, 3}) put(v, 2);
  const std::array<std::array<std::uint32_t, 4>, 10> tags{{{256, 4, 1, width},
                                                           {257, 4, 1, height},
                                                           {258, 3, 3, depths},
                                                           {259, 3, 1, 1},
                                                           {262, 3, 1, 2},
                                                           {273, 4, 1, 8},
                                                           {277, 3, 1, 3},
                                                           {278, 4, 1, height},
                                                           {279, 4, 1, size},
                                                           {339, 3, 3, formats}}};
  put(std::uint32_t(tags.size()), 2);
  for (const auto& tag : tags) {
    put(tag[0], 2);
    put(tag[1], 2);
    put(tag[2], 4);
    put(tag[3], 4);
  }
  put(0, 4);
  for (int i = 0; i < 4; ++i) file[std::size_t(4 + i)] = char(directory >> (8 * i));
  return file;
}

struct Decoded {
  std::string error;
  std::vector<math::Rgb> rgb;
  std::vector<float> alpha;
  std::vector<std::array<std::uint8_t, 4>> texels;
  bool operator==(const Decoded&) const = default;
};

Decoded decode(const std::string& file) {
  Decoded out;
  auto header = image::read_header(file);
  if (!header) return {header.error().message, {}, {}, {}};
  const std::size_t count = std::size_t(header->size.width) * header->size.height;
  if (header->format == image::Format::kPng || header->format == image::Format::kJpeg ||
      header->format == image::Format::kWebp) {
    out.texels.resize(count);
    const auto damage = image::decode_rgba8(*header, out.texels, {});
    out.error = damage ? *damage : damage.error().message;
  } else {
    out.rgb.resize(count);
    out.alpha.resize(count);
    const auto decoded = image::decode_rgb(*header, out.rgb, out.alpha, {});
    if (!decoded) out.error = decoded.error().message;
  }
  return out;
}

TEST(ImageProcess, EncodesTheSameBytes) {
  const std::vector<std::string> layers{"R", "G", "B", "A", "sun.R", "sun.G", "sun.B"};
  const auto all = [&] {
    std::vector<std::string> files;
    for (const bool half : {true, false})
      for (const auto* channels : {&kRgba, &layers})
        files.push_back(exr_bytes(*channels, half, 130, 70));
    for (const int channels : {3, 4})
      files.push_back(
          image::encode_png(samples_of(600, 700, channels), 600, 700, channels).value());
    return files;
  };
  const auto here = all();
  Elsewhere elsewhere;
  const auto there = all();
  EXPECT_EQ(elsewhere.started, 6) << "a process for each call";
  for (std::size_t i = 0; i < here.size(); ++i) EXPECT_TRUE(here[i] == there[i]) << i;
  EXPECT_GT(there[1].size(), 1000u);
}

TEST(ImageProcess, DecodesEveryFormatAlike) {
  const SkyPicture sky(64, [](math::Vec3 d) { return math::Rgb{d.x * d.x, d.y * d.y, 1 + d.z}; });
  const auto png = image::encode_png(samples_of(700, 600, 4), 700, 600, 4).value();
  const std::vector<std::string> files{png,
                                       png.substr(0, png.size() / 2),
                                       jpeg_of(300, 200),
                                       jpeg_of(300, 200).substr(0, 9000),
                                       webp_file(100, 90),
                                       exr_bytes(kRgba, true, 100, 100),
                                       exr_file(sky),
                                       hdr_file(sky),
                                       tiff_file(20, 30)};
  std::vector<Decoded> here;
  for (const auto& file : files) here.push_back(decode(file));
  Elsewhere elsewhere;
  for (std::size_t i = 0; i < files.size(); ++i) EXPECT_TRUE(here[i] == decode(files[i])) << i;
  EXPECT_GE(elsewhere.started, int(files.size()));
  EXPECT_NE(here[1].error, "") << "half of a file";
  for (const std::size_t i : {0, 2, 4, 5, 6, 7, 8}) EXPECT_EQ(here[i].error, "") << i;
}

TEST(ImageProcess, IsConfinedAndHasTwoDescriptors) {
  Elsewhere elsewhere;
  Ramp rows(64, 4);
  std::size_t open = 0;
  std::string filter, parent;
  rows.before = [&] {
    const pid_t pid = elsewhere.pid;
    EXPECT_TRUE(is_confined(pid));
    parent = status_of(pid, "PPid");
    for (const auto& entry : fs::directory_iterator("/proc/" + std::to_string(pid) + "/fd"))
      open += entry.exists() || true;
  };
  Collected sink;
  ASSERT_TRUE(image::encode_exr({64, 64, 64, true, kRgba, kNotes}, rows, sink, {}));
  EXPECT_EQ(parent, std::to_string(::getpid()));
  EXPECT_EQ(open, 2u) << "socket, words";
}

TEST(ImageProcess, StopsAtOnce) {
  Elsewhere elsewhere;
  Ramp rows(64, 4);
  Collected sink;
  std::stop_source stop;
  std::promise<void> sleeps;
  rows.before = [&] {
    ::kill(elsewhere.pid, SIGSTOP);  // it never goes on
    sleeps.set_value();
  };
  std::chrono::steady_clock::time_point began;
  std::jthread later([&] {
    if (sleeps.get_future().wait_for(30s) != std::future_status::ready) return;
    std::this_thread::sleep_for(100ms);
    began = std::chrono::steady_clock::now();
    stop.request_stop();
  });
  const auto done =
      image::encode_exr({64, 640, 64, true, kRgba, kNotes}, rows, sink, stop.get_token());
  later.join();
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, proto::kCanceledCode);
  EXPECT_LT(std::chrono::steady_clock::now() - began, 1s * kSlowdown);
  EXPECT_NE(::kill(elsewhere.pid, 0), 0);
}

TEST(ImageProcess, ItsDeathFailsOneCall) {
  Elsewhere elsewhere;
  Ramp rows(64, 4);
  Collected sink;
  rows.before = [&] { ::kill(elsewhere.pid, SIGKILL); };
  const auto done = image::encode_exr({64, 640, 64, true, kRgba, kNotes}, rows, sink, {});
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().code, "internal");
  EXPECT_EQ(done.error().message, "The image process was ended by signal 9 (Killed).");
  EXPECT_GT(exr_bytes(kRgba, true, 64, 640).size(), 1000u) << "the next one lives";
}

TEST(ImageProcess, WaitsForTheNextZygote) {
  const auto zygote = std::make_shared<sandbox::Zygote>(
      sandbox::Zygote::Options{LIGHTKILN_BINARY, [](const std::string&) {}});
  Elsewhere elsewhere(zygote);
  EXPECT_GT(exr_bytes(kRgba, true, 64, 64).size(), 100u);
  const pid_t first = zygote->pid();
  ::kill(first, SIGKILL);
  EXPECT_GT(exr_bytes(kRgba, true, 64, 64).size(), 100u);
  EXPECT_NE(zygote->pid(), first);
}

TEST(ImageProcess, WithoutAZygoteTheErrorSaysSo) {
  const auto none = std::make_shared<sandbox::Zygote>(
      sandbox::Zygote::Options{"/nonexistent", [](const std::string&) {}});
  const sandbox::ImageProcesses processes({.zygote = none, .patience = 50ms});
  const auto png = image::encode_png(samples_of(2, 2, 3), 2, 2, 3);
  ASSERT_FALSE(png);
  EXPECT_EQ(png.error().code, "internal");
  EXPECT_NE(png.error().message.find("image module"), std::string::npos) << png.error().message;
}

TEST(ImageProcess, AFullDiskEndsTheCall) {
  Elsewhere elsewhere;
  Ramp rows(64, 4);
  Collected sink;
  sink.full = true;
  EXPECT_FALSE(image::encode_exr({64, 640, 64, true, kRgba, kNotes}, rows, sink, {}));
  EXPECT_EQ(sink.bytes, "");
}

TEST(ImageProcess, ManyThreadsAtOnceLeaveNothingBehind) {
  const auto descriptors = [] {
    std::size_t open = 0;
    for (const auto& entry : fs::directory_iterator("/proc/self/fd"))
      open += entry.exists() || true;
    return open;
  };
  const std::string page = exr_bytes(kRgba, true, 100, 100);
  Elsewhere elsewhere;
  exr_bytes(kRgba, true, 64, 64);
  const std::size_t before = descriptors();
  {
    std::vector<std::jthread> threads;
    for (int t = 0; t < 8; ++t)
      threads.emplace_back([&] {
        for (int i = 0; i < 10; ++i) {
          EXPECT_TRUE(exr_bytes(kRgba, true, 100, 100) == page);
          EXPECT_TRUE(image::encode_png(samples_of(50, 60, 3), 50, 60, 3));
        }
      });
  }
  EXPECT_EQ(elsewhere.started, 161);
  EXPECT_EQ(descriptors(), before);
  int zombies = 0;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const pid_t pid = std::atoi(entry.path().filename().c_str());
    zombies += pid > 0 && status_of(pid, "PPid") == std::to_string(::getpid()) &&
               status_of(pid, "State")[0] == 'Z';
  }
  EXPECT_EQ(zombies, 0);
}

/// A call of this process, and the other end of its socket.
class Liar {
 public:
  Liar() {
    std::array<int, 2> ends{};
    EXPECT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, ends.data()), 0);
    ours_ = proto::Fd(ends[0]);
    theirs_ = proto::Fd(ends[1]);
    ::fcntl(ours_.get(), F_SETFL, O_NONBLOCK);
  }
  Liar& says(sandbox::ImageWord word, std::uint64_t at, std::uint32_t size,
             const std::string& bytes = "") {
    const sandbox::ImageMessage message{word, size, at};
    EXPECT_EQ(::write(theirs_.get(), &message, sizeof message), ssize_t(sizeof message));
    EXPECT_EQ(::write(theirs_.get(), bytes.data(), bytes.size()), ssize_t(bytes.size()));
    return *this;
  }
  Liar& goes() {
    theirs_.reset();
    return *this;
  }
  Outcome hears(const sandbox::ImageCall& call, std::chrono::milliseconds silence = 1min) {
    return sandbox::hold_image_talk(call, ours_.get(), {}, silence);
  }

 private:
  proto::Fd ours_, theirs_;
};

using sandbox::ImageWord;
constexpr auto kWhole = std::uint64_t(Outcome::End::kWhole);

/// An EXR file of 100 x 100, a PNG file and texels of 2 x 2.
struct Calls {
  Ramp rows{100, 4};
  Collected file, png_file;
  std::string samples = std::string(12, 'x'), texels = std::string(16, '-');
  sandbox::ImageCall exr, png, read;
  Calls() {
    exr.head.function = sandbox::ImageFunction::kWriteExr;
    exr.head.width = exr.head.height = 100;
    exr.head.tile = 64;
    exr.head.channels = kRgba;
    exr.rows = &rows;
    exr.sink = &file;
    png.head.function = sandbox::ImageFunction::kWritePng;
    png.head.width = png.head.height = 2;
    png.input = {samples};
    png.sink = &png_file;
    read.head.width = read.head.height = 2;
    read.pixels = {texels};
  }
};

TEST(ImageTalk, AnHonestOneIsBelieved) {
  Calls calls;
  const auto done = Liar()
                        .says(ImageWord::kWrite, 2, 3, "abc")
                        .says(ImageWord::kWrite, 0, 2, "xy")
                        .says(ImageWord::kRows, 64, 100)
                        .says(ImageWord::kEnd, kWhole, 4, "well")
                        .hears(calls.exr);
  EXPECT_EQ(done.end, Outcome::End::kWhole);
  EXPECT_EQ(done.words, "well");
  EXPECT_EQ(calls.file.bytes, "xyabc");
  const auto read = Liar()
                        .says(ImageWord::kPixels, 0, 10, "0123456789")
                        .says(ImageWord::kPixels, 0, 6, "abcdef")
                        .says(ImageWord::kEnd, kWhole, 0)
                        .hears(calls.read);
  EXPECT_EQ(read.end, Outcome::End::kWhole);
  EXPECT_EQ(calls.texels, "0123456789abcdef");
  EXPECT_THROW(Liar().says(ImageWord::kNoMemory, 0, 0).hears(calls.png), std::bad_alloc);
}

TEST(ImageTalk, LiesAreRefused) {
  Calls calls;
  const std::uint64_t far = std::uint64_t{1} << 40, most = ~std::uint64_t{0};
  const std::uint32_t large = sandbox::kMaxImagePiece + 1;
  const auto refused = [&](const sandbox::ImageCall& call, ImageWord word, std::uint64_t at,
                           std::uint32_t size, const char* words) {
    const auto done = Liar().says(word, at, size).hears(call);
    EXPECT_EQ(done.end, Outcome::End::kUnavailable);
    EXPECT_NE(done.words.find(words), std::string::npos) << done.words;
  };
  for (const auto& [y0, y1] : std::initializer_list<std::pair<std::uint64_t, std::uint32_t>>{
           {0, 0}, {0, 65}, {64, 101}, {70, 64}, {most, 1}, {far, ~0u}})
    refused(calls.exr, ImageWord::kRows, y0, y1, "rows");
  refused(calls.png, ImageWord::kRows, 0, 1, "rows");
  refused(calls.read, ImageWord::kRows, 0, 1, "rows");
  refused(calls.exr, ImageWord::kWrite, far, 1, "wrote more");
  refused(calls.exr, ImageWord::kWrite, most, 1, "wrote more");
  refused(calls.png, ImageWord::kWrite, 0, large, "wrote more");
  refused(calls.png, ImageWord::kWrite, 4 << 20, 1, "wrote more");
  refused(calls.read, ImageWord::kWrite, 0, 1, "wrote more");
  refused(calls.read, ImageWord::kPixels, 0, 17, "decoded more");
  refused(calls.read, ImageWord::kPixels, 0, large, "decoded more");
  refused(calls.png, ImageWord::kPixels, 0, 1, "decoded more");
  refused(calls.read, ImageWord::kEnd, kWhole, 0, "decoded less");
  refused(calls.exr, ImageWord::kEnd, 99, 0, "an end");
  refused(calls.exr, ImageWord::kEnd, most, 0, "an end");
  refused(calls.exr, ImageWord::kEnd, kWhole, sandbox::kMaxImageWords + 1, "an end");
  refused(calls.exr, ImageWord::kEnd, std::uint64_t(Outcome::End::kStopped), 0, "by itself");
  refused(calls.exr, ImageWord(77), 0, 0, "unknown");
  EXPECT_EQ(calls.file.bytes + calls.png_file.bytes, "");
}

TEST(ImageTalk, SilenceAndDepartureEndIt) {
  Calls calls;
  const auto silent = Liar().hears(calls.png, 20ms);
  EXPECT_EQ(silent.end, Outcome::End::kUnavailable);
  EXPECT_NE(silent.words.find("silent"), std::string::npos) << silent.words;
  for (const bool in_a_message : {false, true}) {
    Liar liar;
    if (in_a_message) liar.says(ImageWord::kWrite, 0, 10, "only");
    const auto gone = liar.goes().hears(calls.png);
    EXPECT_EQ(gone.end, Outcome::End::kUnavailable);
    EXPECT_EQ(gone.words, "") << "its status says more";
  }
  // Words that it sent before it went count, though it did not listen to the end.
  calls.samples.assign(std::size_t{4} << 20, 'x');
  calls.png.input = {calls.samples};
  const auto said = Liar()
                        .says(ImageWord::kEnd, std::uint64_t(Outcome::End::kUnavailable), 3, "why")
                        .goes()
                        .hears(calls.png);
  EXPECT_EQ(said.words, "why");
}

}  // namespace
}  // namespace kiln::test
