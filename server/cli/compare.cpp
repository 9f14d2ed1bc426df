#include "baker/output/compare.h"

#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "baker/output/error_map.h"
#include "proto/files.h"
#include "proto/json.h"
#include "server/cli/commands.h"
#include "server/cli/compare_pages.h"
#include "server/cli/compare_passes.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

namespace fs = std::filesystem;
using output::CompareResult;
using proto::Expected;
using proto::Unexpected;

struct CompareFlags {
  std::string reference, candidate, second;
  std::string layer, diff, contours, histogram, passes, sheet;
  double factor = 1, diff_scale = 1;
  std::optional<double> scale, fail_above;
  bool json = false;
};

/// Returns the path of a page's picture: "error.png" with "_00" before its end where there are
/// several.
fs::path picture_path(const std::string& path, const ComparedFiles& page, std::size_t pages) {
  if (pages == 1) return path;
  fs::path out(path);
  const std::string number = page.name.substr(page.name.find('_'));
  return out.replace_filename(out.stem().string() + number + out.extension().string());
}

Expected<void> write_picture(const fs::path& path, const output::Picture& picture) {
  const auto png = image::encode_png(picture.pixels, picture.width, picture.height);
  if (!png) return Unexpected(png.error());
  return proto::write_bytes(path, *png);
}

Expected<Figures> measure(const CompareFlags& flags, const std::vector<ComparedFiles>& pages) {
  return measure_pages(
      pages, {flags.layer, flags.factor, flags.scale},
      [&](std::size_t p, const output::PagePair& pair, double scale) -> Expected<void> {
        const auto path = [&](const std::string& name) {
          return picture_path(name, pages[p], pages.size());
        };
        if (!flags.diff.empty())
          if (auto ok = write_picture(path(flags.diff),
                                      output::error_map(pair, scale / flags.diff_scale));
              !ok)
            return ok;
        if (flags.contours.empty()) return {};
        return write_picture(path(flags.contours), output::contours(pair, scale));
      });
}

void print_line(const char* name, double value, const std::string& meaning = "") {
  std::printf("%-17s %-12.6g %s\n", name, value, meaning.c_str());
}
void print_count(const char* name, std::uint64_t value) {
  std::printf("%-17s %llu\n", name, static_cast<unsigned long long>(value));
}

void print_figures(const CompareResult& r) {
  print_count("texels compared", r.texels);
  print_count("lit in A only", r.uncovered);
  if (r.nonfinite > 0) print_count("not finite in B", r.nonfinite);
  print_line("mean of A", r.mean_reference);
  print_line("RMSE", r.rmse);
  print_line("nRMSE", r.nrmse, "(RMSE / mean of A)");
  print_line("relRMSE", r.rel_rmse, "(dark texels weigh as much as bright ones)");
  print_line("bias", r.bias, "(mean of B - A, / mean of A)");
  print_line("largest", r.max_abs, "(of |B - A|)");
  print_line("DFPR", r.dfpr, "(mean RGB distance, unscaled)");
  print_line("scale", r.scale, "(the value that counts as 1, or 255)");
  print_line("DFPR of pixels", r.dfpr_all, "(RTRad eq. 6.1: values 0 to 1, all pixels)");
  print_line("DFPR of texels", r.dfpr_lit, "(values 0 to 1, lit texels)");
  for (std::size_t l = 0; l < r.beyond.size(); ++l) {
    const std::string name = "beyond " + std::to_string(CompareResult::kLevels[l]) + "/255";
    print_line(name.c_str(), r.beyond[l], "(share of texels)");
  }
  if (!r.unbiased) return;
  print_line("nRMSE, unbiased", r.unbiased->nrmse, "(without the noise of A)");
  print_line("noise of A", r.unbiased->noise, "(against the second reference, / mean of A)");
}

void print_pages(const std::vector<ComparedFiles>& pages, const Figures& figures) {
  std::printf("page       texels    mean of A     nRMSE         bias          DFPR of pixels\n");
  for (std::size_t p = 0; p < pages.size(); ++p) {
    const CompareResult& r = figures.pages[p];
    std::printf("%-10s %-9llu %-13.6g %-13.6g %-13.6g %.6g\n", pages[p].name.c_str(),
                static_cast<unsigned long long>(r.texels), r.mean_reference, r.nrmse, r.bias,
                r.dfpr_all);
  }
  std::printf("\n");
}

nlohmann::json document(const CompareFlags& flags, const std::vector<ComparedFiles>& pages,
                        const Figures& figures) {
  nlohmann::json out = to_json(figures.all);
  if (!flags.diff.empty()) out["diff_full"] = figures.all.scale / flags.diff_scale;
  if (pages.front().name.empty()) return out;
  for (std::size_t p = 0; p < pages.size(); ++p) {
    nlohmann::json page = to_json(figures.pages[p]);
    page["page"] = pages[p].name;
    out["pages"].push_back(std::move(page));
  }
  return out;
}

void print(const CompareFlags& flags, const std::vector<ComparedFiles>& pages,
           const Figures& figures) {
  if (flags.json) {
    std::puts(proto::to_text(document(flags, pages, figures), 2).c_str());
    return;
  }
  if (pages.size() > 1) print_pages(pages, figures);
  print_figures(figures.all);
  if (flags.diff.empty()) return;
  print_line("white in --diff", figures.all.scale / flags.diff_scale,
             "(luminance of |B - A|, ramp \"ember\")");
}

/// Compares each pass of a folder of passes with A, and prints the last.
Expected<bool> compare_passes(const CompareFlags& flags) {
  const auto passes = measure_passes({flags.reference, flags.candidate, flags.second},
                                     {flags.layer, flags.factor, flags.scale});
  if (!passes) return Unexpected(passes.error());
  const std::string csv = convergence_csv(*passes);
  if (!flags.passes.empty())
    if (auto ok = proto::write_bytes(flags.passes, csv); !ok) return Unexpected(ok.error());
  if (!flags.sheet.empty()) {
    const auto sheet =
        contact_sheet(*passes, {flags.layer, flags.factor, flags.scale}, flags.diff_scale);
    if (!sheet) return Unexpected(sheet.error());
    if (auto ok = write_picture(flags.sheet, *sheet); !ok) return Unexpected(ok.error());
  }
  if (flags.passes.empty()) std::fputs(csv.c_str(), stdout);
  const double nrmse = passes->back().figures.nrmse;
  return !flags.fail_above || nrmse <= *flags.fail_above;
}

Expected<bool> compare_and_print(const CompareFlags& flags) {
  if (holds_passes(flags.candidate)) return compare_passes(flags);
  if (!flags.passes.empty() || !flags.sheet.empty())
    return proto::fail("usage", flags.candidate +
                                    " has no pass_000. --passes and --contact-sheet "
                                    "need a folder that `lightkiln bake "
                                    "--keep-passes` has written.");
  const auto pages = find_pages(flags.reference, flags.candidate, flags.second);
  if (!pages) return Unexpected(pages.error());
  const auto figures = measure(flags, *pages);
  if (!figures) return Unexpected(figures.error());
  if (!flags.histogram.empty())
    if (auto ok = proto::write_bytes(flags.histogram, histogram_csv(figures->all)); !ok)
      return Unexpected(ok.error());
  print(flags, *pages, *figures);
  // This is not "nrmse > limit", because an nRMSE that is not a number is a failure too.
  return !flags.fail_above || figures->all.nrmse <= *flags.fail_above;
}

int run_compare(const CompareFlags& flags) {
  const auto fine = compare_and_print(flags);
  if (!fine) return report(fine.error());
  return *fine ? kDone : kFailed;
}

constexpr const char* kCompareFooter =
    R"(Compares R, G and B of the texels that are lit in both. Of folders, every page_NN.exr is compared;
the figures are those of all texels together, and --json has those of each page, too.

Figures (x a texel of B, a of A; k the scale):
  RMSE        root of the mean of (x - a)^2; nRMSE divides it by the mean of A
  relRMSE     root of the mean of ((x - a) / (a + 2 % of the mean of A))^2
  bias        mean of x - a, divided by the mean of A: noise cancels, what remains is wrong
  largest     the largest |x - a| of a channel
  DFPR        mean distance of RGB, unscaled; "of texels": of RGB / k, each within 0 to 1;
              "of pixels": the same over all pixels, padding too, as RTRad measures (eq. 6.1).
              RTRad takes 0.025 for the least that a person notices
  beyond      share of texels whose luminance of |x - a|, 255 / k of it, is over 10, 25 and 40
  unbiased    root of the mean of (x - a)(x - c) with c of --second-reference: the noise of the
              references, which must be independent, cancels. 0 where it is lost in noise
  histogram   64 bins of luminance, 255 / k of it, of both (--json, --histogram)

--diff shows 0.2126, 0.7152 and 0.0722 of |x - a| of R, G and B, linear, on the ramp "ember" (black,
violet, red, orange, yellow, white); gray is not compared. --contours draws where the luminance
passes 40, 70, 90, 120 and 140 of 255: orange for A, blue for B, white for both.
Of several pages, the pictures' names get _NN.

A folder B that `lightkiln bake --keep-passes` has written is compared pass by pass: a row of figures
for each, as CSV. --contact-sheet shows the first page after each pass, and under it the error, in
the order of the rows.

Exit codes: 0 compared, 1 nRMSE above --fail-above or a failure of the machine, 2 wrong input.

Examples:
  lightkiln compare reference/page_00.exr out/page_00.exr
  lightkiln compare reference/ out/ --diff error.png --diff-scale 50
  lightkiln compare a.exr b.exr --second-reference c.exr --json --fail-above 0.01
  lightkiln compare a/page_00.exr cycles.exr --factor pi
  lightkiln compare reference/ passes/ --contact-sheet sheet.png)";

/// Accepts numbers over 0, and pi where `with_pi` says so, which becomes a number.
CLI::Validator positive(bool with_pi = false) {
  return {[with_pi](std::string& text) -> std::string {
            if (with_pi && text == "pi") text = "3.141592653589793";
            double value = 0;
            if (CLI::detail::lexical_cast(text, value) && value > 0 && std::isfinite(value))
              return "";
            return "expected a number over 0" + std::string(with_pi ? ", or pi" : "") + ", found " +
                   text;
          },
          ""};
}

void add_flags(CLI::App& command, CompareFlags& flags) {
  command.add_option("reference", flags.reference, "A, to measure against: a page or a folder")
      ->required()
      ->check(CLI::ExistingPath)
      ->type_name("A");
  command.add_option("candidate", flags.candidate, "B, to measure: a page or a folder")
      ->required()
      ->check(CLI::ExistingPath)
      ->type_name("B");
  command
      .add_option("--second-reference", flags.second,
                  "Another reference as A, of another seed, for figures without their noise")
      ->check(CLI::ExistingPath)
      ->type_name("C");
  command
      .add_option("--layer", flags.layer, "The layer to compare, say direct; else the first one")
      ->type_name("NAME");
  command
      .add_option("--factor", flags.factor,
                  "Factor on B, a number or pi: for tools that write E / pi")
      ->transform(positive(/*with_pi=*/true))
      ->type_name("F")
      ->capture_default_str();
  command
      .add_option("--scale", flags.scale,
                  "Value that counts as 1, or 255; else the largest channel of A")
      ->check(positive())
      ->type_name("K");
  command.add_option("--diff", flags.diff, "Write a picture of the error")->type_name("PNG");
  command.add_option("--diff-scale", flags.diff_scale, "Factor on the error in --diff")
      ->check(positive())
      ->type_name("X")
      ->capture_default_str();
  command.add_option("--contours", flags.contours, "Write a picture of equal luminance")
      ->type_name("PNG");
  command.add_option("--histogram", flags.histogram, "Write the histograms")->type_name("CSV");
  command.add_option("--passes", flags.passes, "Write the figures of each pass, not print them")
      ->type_name("CSV");
  command.add_option("--contact-sheet", flags.sheet, "Write a picture of all passes")
      ->type_name("PNG");
  command.add_flag("--json", flags.json, "Print the figures as JSON");
  command.add_option("--fail-above", flags.fail_above, "Exit with 1 when nRMSE is above this")
      ->check(CLI::NonNegativeNumber)
      ->type_name("NRMSE");
}

}  // namespace

void add_compare(CLI::App& app, Run& run) {
  auto flags = std::make_shared<CompareFlags>();
  auto* command = app.add_subcommand("compare", "Compare lightmap pages");
  add_flags(*command, *flags);
  command->footer(kCompareFooter);
  command->callback([flags, &run] { run = [flags] { return run_compare(*flags); }; });
}

}  // namespace kiln::cli
