#pragma once

#include <filesystem>
#include <functional>
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

struct MeasureOptions {
  std::string layer;            ///< see read_pages()
  double factor = 1;            ///< the same
  std::optional<double> scale;  ///< see output::Comparison
};

/// The figures of each page, and of all together.
struct Figures {
  std::vector<output::CompareResult> pages;
  output::CompareResult all;
};

/// Compares pages, one in memory at a time. `use`, which may be null, is called for each with the
/// scale of all. Errors: those of read_pages() and of `use`; `invalid_image` where no texel is lit
/// in both.
using UsePage =
    std::function<proto::Expected<void>(std::size_t page, const output::PagePair&, double scale)>;
proto::Expected<Figures> measure_pages(const std::vector<ComparedFiles>&, const MeasureOptions&,
                                       const UsePage& use = {});

}  // namespace kiln::cli
