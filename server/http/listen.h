#pragma once

#include <cstdint>
#include <string>

#include "proto/files.h"

namespace kiln::http {

/// Returns a socket that listens on the address, a name or a number of either family. Port 0 lets
/// the system choose. The socket is not valid when that is not possible: errno says why, if the
/// address is one.
proto::Fd listen_on(const std::string& address, std::uint16_t port);

}  // namespace kiln::http
