#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <string_view>

#include "proto/expected.h"

namespace kiln::clients {

/// SHA-256 over bytes as they come.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;

  void update(std::string_view bytes);
  std::string hex();  ///< 64 lower-case digits; ends the computation

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// Digest of a whole file, read in pieces. Errors: `io_error`.
proto::Expected<std::string> sha256_of_file(const std::filesystem::path&);

}  // namespace kiln::clients
