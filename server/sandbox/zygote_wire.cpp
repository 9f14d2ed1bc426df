#include "server/sandbox/zygote_wire.h"

#include <sys/socket.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>

namespace kiln::sandbox {
namespace {

/// The kernel passes 253 descriptors with one packet.
constexpr std::size_t kMostFiles = 250;
constexpr std::size_t kMostFault = 2000;

/// A packet that says how many descriptors are still to come, with some of them.
struct Packet {
  std::uint32_t count = 0;
  iovec payload{&count, sizeof count};
  alignas(cmsghdr) std::array<char, CMSG_SPACE(kMostFiles * sizeof(int))> control{};
  msghdr message{};

  explicit Packet(std::size_t control_bytes) {
    message.msg_iov = &payload;
    message.msg_iovlen = 1;
    if (control_bytes == 0) return;
    message.msg_control = control.data();
    message.msg_controllen = control_bytes;
  }
};

}  // namespace

bool send_ready(int socket, const ZygoteReady& ready) {
  std::string packet(reinterpret_cast<const char*>(&ready.pid), sizeof ready.pid);
  packet += ready.fault.substr(0, kMostFault);
  return ::send(socket, packet.data(), packet.size(), MSG_NOSIGNAL) == ssize_t(packet.size());
}

std::optional<ZygoteReady> receive_ready(int socket) {
  std::array<char, sizeof(std::int32_t) + kMostFault> packet;
  const ssize_t got = ::recv(socket, packet.data(), packet.size(), 0);
  ZygoteReady ready;
  if (got < ssize_t(sizeof ready.pid)) return std::nullopt;
  std::memcpy(&ready.pid, packet.data(), sizeof ready.pid);
  if (ready.pid <= 0) return std::nullopt;
  ready.fault.assign(packet.data() + sizeof ready.pid, std::size_t(got) - sizeof ready.pid);
  return ready;
}

bool send_files(int socket, std::span<const int> files) {
  do {
    const auto now = files.first(std::min(kMostFiles, files.size()));
    Packet packet(now.empty() ? 0 : CMSG_SPACE(now.size_bytes()));
    packet.count = static_cast<std::uint32_t>(files.size());
    if (cmsghdr* const head = CMSG_FIRSTHDR(&packet.message); head != nullptr) {
      head->cmsg_level = SOL_SOCKET;
      head->cmsg_type = SCM_RIGHTS;
      head->cmsg_len = CMSG_LEN(now.size_bytes());
      std::memcpy(CMSG_DATA(head), now.data(), now.size_bytes());
    }
    ssize_t sent = 0;
    do sent = ::sendmsg(socket, &packet.message, MSG_NOSIGNAL);
    while (sent < 0 && errno == EINTR);
    if (sent != sizeof packet.count) return false;
    files = files.subspan(now.size());
  } while (!files.empty());
  return true;
}

bool receive_files(int socket, std::vector<proto::Fd>& files) {
  files.clear();
  for (;;) {
    Packet packet(sizeof packet.control);
    ssize_t got = 0;
    do got = ::recvmsg(socket, &packet.message, MSG_CMSG_CLOEXEC);
    while (got < 0 && errno == EINTR);
    if (got != sizeof packet.count) return false;
    std::size_t now = 0;
    for (cmsghdr* head = CMSG_FIRSTHDR(&packet.message); head != nullptr;
         head = CMSG_NXTHDR(&packet.message, head)) {
      now = (head->cmsg_len - CMSG_LEN(0)) / sizeof(int);
      for (std::size_t i = 0; i < now; ++i) {
        int fd = -1;
        std::memcpy(&fd, CMSG_DATA(head) + i * sizeof fd, sizeof fd);
        files.emplace_back(fd);
      }
    }
    if (now >= packet.count) return true;
    if (now == 0) return false;  // too few descriptors are left to this process
  }
}

}  // namespace kiln::sandbox
