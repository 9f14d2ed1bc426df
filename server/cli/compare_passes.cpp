#include "server/cli/compare_passes.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "baker/output/post.h"
#include "proto/files.h"
#include "proto/json.h"

namespace kiln::cli {
namespace {

namespace fs = std::filesystem;
using image::PageImage;
using output::Picture;
using proto::Expected;
using proto::Unexpected;

constexpr std::uint32_t kThumbnail = 256, kColumns = 6, kGap = 4;
constexpr std::uint64_t kMaxReportBytes = 64ull << 20;

Expected<std::vector<proto::PassReport>> read_reports(const fs::path& folder) {
  std::vector<proto::PassReport> reports;
  const fs::path path = folder / kPassReports;
  std::error_code error;
  if (!fs::exists(path, error)) return reports;
  const auto text = proto::read_file(path, kMaxReportBytes);
  if (!text) return Unexpected(text.error());
  const auto broken = proto::fail("usage", path.string() +
                                               " is no list of passes. Remove it, or "
                                               "let `lightkiln bake --keep-passes` "
                                               "write the folder anew.");
  const auto document = proto::parse_json(*text, kPassReports);
  if (!document || !document->is_array()) return broken;
  for (const auto& entry : *document) {
    auto report = proto::pass_report_from_json(entry);
    if (!report) return broken;
    reports.push_back(std::move(*report));
  }
  return reports;
}

/// Averages lit texels, so that the longer side is no more than a thumbnail's.
PageImage shrunk(const PageImage& image) {
  const std::uint32_t step =
      std::max(1u, (std::max(image.width, image.height) + kThumbnail - 1) / kThumbnail);
  PageImage out{(image.width + step - 1) / step, (image.height + step - 1) / step, {}, {}};
  out.rgb.resize(std::size_t(out.width) * out.height);
  out.coverage.resize(out.rgb.size());
  for (std::uint32_t y = 0; y < image.height; ++y)
    for (std::uint32_t x = 0; x < image.width; ++x) {
      const std::size_t from = std::size_t(y) * image.width + x,
                        to = std::size_t(y / step) * out.width + x / step;
      if (!(image.coverage[from] > 0)) continue;
      out.rgb[to] += image.rgb[from];
      out.coverage[to] += 1;
    }
  for (std::size_t i = 0; i < out.rgb.size(); ++i)
    if (out.coverage[i] > 0) out.rgb[i] = out.rgb[i] * (1 / out.coverage[i]);
  return out;
}

/// Copies a picture into the sheet.
void put(Picture& sheet, std::uint32_t x0, std::uint32_t y0, std::uint32_t width,
         const std::vector<output::Color>& pixels) {
  for (std::size_t i = 0; i < pixels.size(); ++i)
    sheet.pixels[(y0 + i / width) * sheet.width + x0 + i % width] = pixels[i];
}

}  // namespace

std::string pass_folder(std::uint32_t pass) {
  char name[32];
  std::snprintf(name, sizeof name, "pass_%03u", unsigned(pass));
  return name;
}

bool holds_passes(const fs::path& folder) {
  std::error_code error;
  return fs::is_directory(folder / pass_folder(0), error);
}

Expected<std::vector<ComparedPass>> measure_passes(const ComparedFolders& folders,
                                                   const MeasureOptions& options) {
  const auto reports = read_reports(folders.passes);
  if (!reports) return Unexpected(reports.error());
  std::vector<ComparedPass> passes;
  std::error_code error;
  for (std::uint32_t p = 0; fs::is_directory(folders.passes / pass_folder(p), error); ++p) {
    auto files = find_pages(folders.reference, folders.passes / pass_folder(p), folders.second);
    if (!files) return Unexpected(files.error());
    auto figures = measure_pages(*files, options);
    if (!figures) return Unexpected(figures.error());
    ComparedPass pass{std::move(*files), figures->all, {}};
    if (p < reports->size()) pass.report = (*reports)[p];
    passes.push_back(std::move(pass));
  }
  return passes;
}

std::string convergence_csv(const std::vector<ComparedPass>& passes) {
  std::string out = "pass,name,seconds,rays,nrmse,rel_rmse,bias,dfpr_all,dfpr_lit,unbiased_nrmse\n";
  double seconds = 0;
  std::uint64_t rays = 0;
  for (std::size_t p = 0; p < passes.size(); ++p) {
    const output::CompareResult& r = passes[p].figures;
    std::string head = std::to_string(p) + ",,,";
    if (const auto& report = passes[p].report) {
      seconds += report->seconds;
      rays += report->rays;
      char text[64];
      std::snprintf(text, sizeof text, "%.6g,%llu", seconds, static_cast<unsigned long long>(rays));
      head = std::to_string(p) + "," + report->name + "," + text;
    }
    char row[192];
    std::snprintf(row, sizeof row, ",%.6g,%.6g,%.6g,%.6g,%.6g,", r.nrmse, r.rel_rmse, r.bias,
                  r.dfpr_all, r.dfpr_lit);
    out += head + row;
    if (r.unbiased) {
      std::snprintf(row, sizeof row, "%.6g", r.unbiased->nrmse);
      out += row;
    }
    out += '\n';
  }
  return out;
}

Expected<Picture> contact_sheet(const std::vector<ComparedPass>& passes,
                                const MeasureOptions& options, double diff_scale) {
  Picture sheet;
  float exposure = 1;
  std::uint32_t width = 0, height = 0;
  // Backwards, since the last pass says how the light is exposed.
  for (std::size_t p = passes.size(); p-- > 0;) {
    const auto images = read_pages(passes[p].files.front(), options.layer, options.factor);
    if (!images) return Unexpected(images.error());
    const PageImage candidate = shrunk(images->candidate), reference = shrunk(images->reference);
    if (sheet.pixels.empty()) {
      exposure = output::automatic_exposure(candidate);
      width = candidate.width, height = candidate.height;
      const auto count = std::uint32_t(passes.size());
      sheet.width = std::min(count, kColumns) * (width + kGap) + kGap;
      sheet.height = (count + kColumns - 1) / kColumns * 2 * (height + kGap) + kGap;
      sheet.pixels.assign(std::size_t(sheet.width) * sheet.height, output::Color{});
    }
    const auto column = std::uint32_t(p) % kColumns, row = std::uint32_t(p) / kColumns;
    const std::uint32_t x = kGap + column * (width + kGap), y = kGap + row * 2 * (height + kGap);
    put(sheet, x, y, width, output::tone_map(candidate, {exposure}));
    const double white = passes[p].figures.scale / diff_scale;
    put(sheet, x, y + height + kGap, width,
        output::error_map({reference, candidate}, white).pixels);
  }
  return sheet;
}

}  // namespace kiln::cli
