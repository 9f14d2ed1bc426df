#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "proto/files.h"

namespace kiln::sandbox {

// The talk between a service and its zygote, over a socket of packets. The zygote says once that it
// is ready. Then any number of descriptors go one way, and a process id the other as std::int32_t,
// which is -1 when there is none. All functions fail once the connection has ended.

struct ZygoteReady {
  std::int32_t pid = -1;
  std::string fault;  ///< why it has no image module; "" where it has one
};
/// Sends the first 2000 bytes of the fault.
bool send_ready(int socket, const ZygoteReady&);
std::optional<ZygoteReady> receive_ready(int socket);

bool send_files(int socket, std::span<const int> files);
/// Waits for files. Returns false at the end.
bool receive_files(int socket, std::vector<proto::Fd>& files);

}  // namespace kiln::sandbox
