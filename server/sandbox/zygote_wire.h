#pragma once

#include <span>
#include <vector>

#include "proto/files.h"

namespace kiln::sandbox {

// Between a service and its zygote, over a socket of packets: any number of descriptors one way, a
// process id as std::int32_t the other, -1 when there is none. Where the connection ends all fail.

bool send_files(int socket, std::span<const int> files);
/// Waits for files. False at the end.
bool receive_files(int socket, std::vector<proto::Fd>& files);

}  // namespace kiln::sandbox
