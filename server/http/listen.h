#pragma once

#include <cstdint>
#include <string>

#include "proto/files.h"

namespace kiln::http {

/// A socket that listens on the address, a name or a number of either family; port 0 lets the
/// system choose. Not valid where that can't be: errno says why, if the address is one.
proto::Fd listen_on(const std::string& address, std::uint16_t port);

}  // namespace kiln::http
