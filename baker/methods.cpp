#include "baker/methods.h"

#include "baker/solver/gather/gather.h"
#include "baker/solver/path/path.h"

namespace kiln::baker {

std::unique_ptr<solver::Solver> make_solver(const solver::SolverInput& in) {
  switch (in.settings.method) {
    case proto::Method::kPath:
      return solver::path::make_path_solver(in);
    case proto::Method::kGather:
      break;
  }
  return solver::gather::make_gather_solver(in, std::uint64_t(in.settings.hit_memory_mib) << 20);
}

}  // namespace kiln::baker
