#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "baker/solver/solver.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace kiln::baker {

/// The memory of a method beside the light that every method has, for the preflight. Bytes.
struct MethodMemory {
  double all_passes = 0;      ///< until the light has all its bounces
  double texel_state = 0;     ///< per texel: planes of the method's own
  double texel_pass = 0;      ///< per texel: what a pass before that makes anew
  double texel_complete = 0;  ///< per texel: what a pass that leaves complete light makes anew
};

/// A bake that its method can't finish.
struct TooExpensive {
  std::string cost;    ///< a sentence with rays, memory and time
  std::string advice;  ///< what makes it less, to follow after "or"
};

/// A light-transport method. A new one is a row of methods(), and a row of proto::kMethodNames.
struct Method {
  proto::Method id;
  std::unique_ptr<solver::Solver> (*make)(const solver::World&);
  solver::SamplePlan (*plan)(const proto::SolverSettings&, const proto::QualitySettings&,
                             bool many_lights);
  bool adaptive;  ///< takes samples until a target is reached
  bool filtered;  ///< its light is smoothed where post.filter says so
  MethodMemory (*memory)(const proto::SolverSettings&, const solver::SamplePlan&, double texels);
  /// Tells when so many texels are more than the method can finish. Null: it takes any number.
  std::optional<TooExpensive> (*cost)(const proto::SolverSettings&, double texels) = nullptr;

  const char* name() const { return proto::to_string(id); }
};

/// Returns all methods, in the order of their ids.
std::span<const Method> methods();
const Method& method_of(proto::Method);

/// Refuses a bake that the method of the settings can't finish, before anything is made for it. A
/// window that is null counts as the least there is. Errors: `too_expensive`, which names rays,
/// memory, time, and what to do instead.
proto::Expected<void> check_cost(const proto::SolverSettings&, std::uint32_t texels);
/// Tells of the same what it would cost, unless `solver.allow_expensive` is set.
std::optional<TooExpensive> too_expensive(const proto::SolverSettings&, std::uint32_t texels);

/// Make the solver, and the plan of samples, of the method that the settings name.
std::unique_ptr<solver::Solver> make_solver(const solver::World&);
solver::SamplePlan sample_plan(const proto::SolverSettings&, const proto::QualitySettings&,
                               bool many_lights = false);

}  // namespace kiln::baker
