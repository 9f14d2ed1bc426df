#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "baker/output/error_map.h"
#include "proto/expected.h"
#include "proto/manifest.h"
#include "server/cli/compare_pages.h"

namespace kiln::cli {

/// The folder of a pass in a folder of passes: "pass_007". `lightkiln bake --keep-passes` writes
/// the pages into it, and beside the passes passes.json, a list of pass reports.
std::string pass_folder(std::uint32_t pass);
inline constexpr const char* kPassReports = "passes.json";

/// Tells whether a path is a folder of passes.
bool holds_passes(const std::filesystem::path&);

/// A pass beside a reference.
struct ComparedPass {
  std::vector<ComparedFiles> files;
  output::CompareResult figures;            ///< of all its pages
  std::optional<proto::PassReport> report;  ///< nothing where the bake did not end
};

/// What passes are compared with: `second` may be "".
struct ComparedFolders {
  std::filesystem::path reference, passes, second;
};

/// Measures the passes of a folder, in order. Errors: those of find_pages() and measure_pages(),
/// `usage` where passes.json can't be read.
proto::Expected<std::vector<ComparedPass>> measure_passes(const ComparedFolders&,
                                                          const MeasureOptions&);

/// The figures as text/csv with a line of names; a row for each pass. `seconds` and `rays` are
/// those of all passes so far.
std::string convergence_csv(const std::vector<ComparedPass>&);

/// Draws the first page after each pass, all by one exposure, and under it the error on the ramp
/// "ember"; `diff_scale` multiplies it. Errors: those of read_pages().
proto::Expected<output::Picture> contact_sheet(const std::vector<ComparedPass>&,
                                               const MeasureOptions&, double diff_scale);

}  // namespace kiln::cli
