#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "baker/image/page_image.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"
#include "proto/manifest.h"

namespace kiln::output {

/// Holds what the report of a bake compares the result with.
struct Reference {
  /// Returns the reference's light of a page, laid out as the result is. Null: there is no report.
  std::function<proto::Expected<image::PageImage>(std::uint32_t page)> page;
  // A method has these two, a file has not.
  std::optional<proto::SolverSettings> settings;
  std::vector<proto::PassReport> passes;
};

/// A file of the report, and its media type.
struct ReportFile {
  std::string name;
  const char* media_type;
};

/// Compares `pages` pages of a result, which `result` returns, with the reference. Writes into
/// `dir` report.json (the figures of all pages together and of each, see to_json(CompareResult)),
/// histogram.csv, and of each page error_NN.png and contours_NN.png. Returns their names. Two pages
/// are in memory at a time. Errors: those of the reference and of files, `canceled`.
proto::Expected<std::vector<ReportFile>> write_report(
    const std::filesystem::path& dir, const Reference&, std::uint32_t pages,
    const std::function<image::PageImage(std::uint32_t page)>& result, const proto::ReportSettings&,
    const std::stop_token&);

}  // namespace kiln::output
