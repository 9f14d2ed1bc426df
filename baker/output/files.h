#pragma once

#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

#include "proto/expected.h"
#include "proto/manifest.h"

namespace kiln::baker {

/// Writes a file so that its name shows the whole content or nothing, through a crash or power loss
/// too: `write` fills a temporary beside it, which is flushed to disk and then renamed. A failed
/// temporary is removed. Errors: those of `write`, and `io_error`.
proto::Expected<void> write_whole(
    const std::filesystem::path& target,
    const std::function<proto::Expected<void>(const std::filesystem::path& temporary)>& write);

/// write_whole() of these bytes.
proto::Expected<void> write_bytes(const std::filesystem::path& target, std::string_view bytes);

/// Size and SHA-256 of a file, read in pieces. Errors: `io_error`.
proto::Expected<proto::ResultFile> describe_file(const std::filesystem::path&,
                                                 std::string media_type);

/// Lower-case hex SHA-256 of bytes in memory.
std::string sha256_hex(std::string_view bytes);

}  // namespace kiln::baker
