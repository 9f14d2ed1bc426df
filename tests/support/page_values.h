#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

namespace kiln::test {

/// The decoded values of an EXR page, every channel of every layer as it is named in the file:
/// "R", "direct.G", ... Rows from the top, halves as the floats that they stand for.
struct PageValues {
  std::uint32_t width = 0, height = 0;
  std::map<std::string, std::vector<float>> channels;
};

/// Reads a page that the product wrote. Throws when it can't be read.
PageValues read_page(const std::filesystem::path&);

}  // namespace kiln::test
