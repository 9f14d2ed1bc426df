#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "baker/output/compare.h"
#include "proto/expected.h"

namespace kiln::cli {

/// The files of a page in a comparison.
struct ComparedFiles {
  std::string name;  ///< "page_00", or "" where files are compared and not folders
  std::filesystem::path reference, candidate;
  std::filesystem::path second;  ///< of the second reference; "" without one
};

/// Finds the pages of two files, or of two folders: page_NN.exr of both. `second` may be "".
/// Errors: `usage` where a file meets a folder, or where a folder lacks a page that another has.
proto::Expected<std::vector<ComparedFiles>> find_pages(const std::filesystem::path& reference,
                                                       const std::filesystem::path& candidate,
                                                       const std::filesystem::path& second);

/// The images of a page.
struct ComparedImages {
  image::PageImage reference, candidate;
  std::optional<image::PageImage> second;

  output::PagePair pair() const { return {reference, candidate, second ? &*second : nullptr}; }
};

/// Reads a layer ("": the first) of a page's files, and multiplies the candidate by `factor`.
/// Errors: `invalid_image`, which names the file.
proto::Expected<ComparedImages> read_pages(const ComparedFiles&, const std::string& layer,
                                           double factor);

}  // namespace kiln::cli
