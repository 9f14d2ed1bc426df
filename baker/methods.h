#pragma once

#include <memory>

#include "baker/solver/solver.h"

namespace kiln::baker {

/// Makes the solver of the method that the settings name.
std::unique_ptr<solver::Solver> make_solver(const solver::SolverInput&);

}  // namespace kiln::baker
