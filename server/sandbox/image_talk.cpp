#include "server/sandbox/image_talk.h"

#include <poll.h>
#include <sys/eventfd.h>
#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <functional>
#include <new>
#include <stdexcept>
#include <string>

#include "proto/files.h"

namespace kiln::sandbox {
namespace {

using image::Outcome;

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

}  // namespace

std::uint64_t bytes_of_rows(const ImageHead& head, std::uint64_t rows) {
  return rows * head.width * head.channels.size() * sizeof(float);
}

image::Outcome hold_image_talk(const ImageCall& call, int socket, const std::stop_token& stop,
                               std::chrono::milliseconds silence) {
  try {
    ImageLine line(socket, stop, silence);
    return ImageTalk(call, line).hold();
  } catch (ImageLine::Broken& broken) {
    return std::move(broken.outcome);
  }
}

}  // namespace kiln::sandbox
