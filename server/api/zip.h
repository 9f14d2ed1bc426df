#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "proto/expected.h"
#include "server/http/content.h"

namespace kiln::api {

struct ZipEntry {
  std::string name;  ///< UTF-8
  std::shared_ptr<const proto::Fd> file;
  std::uint64_t bytes = 0;
};

/// Makes a ZIP archive of files as they are (no compression: EXR, PNG and glTF are compressed
/// already), with ZIP64 fields when sizes need them. The same files give the same bytes; the length
/// is known before one is sent. It reads every file once, for its CRC. Errors: `io_error`.
proto::Expected<http::Content> zip_of(const std::vector<ZipEntry>&);

}  // namespace kiln::api
