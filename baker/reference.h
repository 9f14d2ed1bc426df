#pragma once

#include <memory>
#include <optional>
#include <stop_token>
#include <string>

#include "baker/bake.h"
#include "baker/output/report.h"
#include "baker/prepare.h"
#include "baker/solve.h"
#include "baker/solver/solver.h"

namespace kiln::baker {

/// Returns the settings of the method that a result is compared with: the bake's bounces, its
/// factors on albedo and distance and its kind of emitters; report.samples of each kind; a seed of
/// its own, so that the noise of the two has nothing in common; and defaults for the rest, however
/// coarsely the bake itself goes about it.
proto::SolverSettings reference_settings(const proto::BakeSettings&, proto::Method);

/// Makes what the result of a bake is compared with, as the settings `report` ask for it.
class ReferenceBake {
 public:
  /// Refuses a reference that can't be made, before the bake takes its time: a file that is missing
  /// or does not fit the pages, or a method that is too expensive. Both arguments outlive it.
  /// Errors: `missing_file`, `invalid_image`, `too_expensive`, at /report/against.
  static proto::Expected<ReferenceBake> check(const BakeInput&, const PreparedBake&,
                                              const std::stop_token&);

  /// The expected work of its passes; none unless a method makes it.
  solver::Work work() const;
  /// Returns the reference; without a page where no report is wanted, or where the input's
  /// finish_early ends it. A method's light is computed here, by the pool alone: other processes
  /// that compute batches know the bake's own settings only. Its passes are no passes of the bake:
  /// no checkpoint holds them. The errors are those of solve().
  proto::Expected<output::Reference> make(exec::ThreadPool&, const std::stop_token&,
                                          SolveHooks) const;
  bool wanted() const;

 private:
  ReferenceBake(const BakeInput& input, const PreparedBake& bake) : input_(&input), bake_(&bake) {}
  proto::Expected<image::PageImage> read_page(std::uint32_t page) const;

  const BakeInput* input_;
  const PreparedBake* bake_;
  std::shared_ptr<const solver::World> world_;  ///< of the method, if there is one
};

/// Returns the name of the file that holds a page, where `first` holds page 0: "page_02.exr" for
/// page 2 and "page_00.exr". Nothing where `first` has no number and the page is another one.
std::optional<std::string> page_file_name(const std::string& first, std::uint32_t page);

}  // namespace kiln::baker
