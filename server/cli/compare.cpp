#include <CLI/CLI.hpp>
#include <cmath>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "baker/output/output.h"
#include "baker/output/post.h"
#include "proto/json.h"
#include "server/cli/commands.h"
#include "server/cli/report.h"

namespace kiln::cli {
namespace {

struct CompareFlags {
  std::string reference, candidate;
  bool json = false;
  std::optional<double> fail_above;
};

nlohmann::json figures(const output::CompareResult& r) {
  return {{"texels", r.texels}, {"uncovered", r.uncovered}, {"mean_reference", r.mean_reference},
          {"rmse", r.rmse},     {"nrmse", r.nrmse},         {"rel_rmse", r.rel_rmse},
          {"bias", r.bias},     {"max_abs", r.max_abs},     {"dfpr", r.dfpr}};
}

void print_figures(const output::CompareResult& r) {
  std::printf("texels compared   %llu\n", static_cast<unsigned long long>(r.texels));
  std::printf("lit in A only     %llu\n", static_cast<unsigned long long>(r.uncovered));
  std::printf("mean of A         %.6g\n", r.mean_reference);
  std::printf("RMSE              %.6g\n", r.rmse);
  std::printf("nRMSE             %.6g   (RMSE / mean of A)\n", r.nrmse);
  std::printf("relRMSE           %.6g   (dark texels weigh as much as bright ones)\n", r.rel_rmse);
  std::printf("bias              %.6g   (mean of B - A)\n", r.bias);
  std::printf("largest           %.6g   (of |B - A|)\n", r.max_abs);
  std::printf("DFPR              %.6g\n", r.dfpr);
}

proto::Expected<output::CompareResult> compare_files(const CompareFlags& flags) {
  const auto a = image::read_exr(flags.reference);
  if (!a) return proto::Unexpected(a.error());
  const auto b = image::read_exr(flags.candidate);
  if (!b) return proto::Unexpected(b.error());
  if (a->width != b->width || a->height != b->height)
    return proto::fail("invalid_image", "The images differ in size: " + std::to_string(a->width) +
                                            "x" + std::to_string(a->height) + " and " +
                                            std::to_string(b->width) + "x" +
                                            std::to_string(b->height) + ".");
  return output::compare(*a, *b);
}

int run_compare(const CompareFlags& flags) {
  const auto result = compare_files(flags);
  if (!result) return report(result.error());
  if (flags.json)
    std::puts(proto::to_text(figures(*result), 2).c_str());
  else
    print_figures(*result);
  // This is not "nrmse > limit", because an nRMSE that is not a number is a failure too.
  const bool fine = !flags.fail_above || result->nrmse <= *flags.fail_above;
  return fine ? kDone : kFailed;
}

}  // namespace

void add_compare(CLI::App& app, Run& run) {
  auto flags = std::make_shared<CompareFlags>();
  auto* command = app.add_subcommand("compare", "Compare two lightmap pages");
  command->add_option("reference", flags->reference, "The page to measure against")
      ->required()
      ->check(CLI::ExistingFile)
      ->type_name("A.exr");
  command->add_option("candidate", flags->candidate, "The page to measure")
      ->required()
      ->check(CLI::ExistingFile)
      ->type_name("B.exr");
  command->add_flag("--json", flags->json, "Print the figures as JSON");
  command->add_option("--fail-above", flags->fail_above, "Exit with 1 when nRMSE is above this")
      ->check(CLI::NonNegativeNumber)
      ->type_name("NRMSE");
  command->footer(R"(Compares R, G and B of the texels that are lit in both images.

Examples:
  lightkiln compare reference/page_00.exr out/page_00.exr
  lightkiln compare a.exr b.exr --json --fail-above 0.01)");
  command->callback([flags, &run] { run = [flags] { return run_compare(*flags); }; });
}

}  // namespace kiln::cli
