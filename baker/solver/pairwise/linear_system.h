#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

namespace kiln::solver::pairwise {

/// y = A x, with as many numbers in y as in x. Returns false when stopped.
using Product = std::function<bool(std::span<const double> x, std::span<double> y)>;

/// Solves A x = b by BiCGSTAB [van der Vorst, "Bi-CGSTAB: A Fast and Smoothly Converging Variant of
/// Bi-CG", SIAM J. Sci. Stat. Comput. 13, 1992], from x = b on. Where the recurrence breaks down,
/// or has lost the residual by rounding, it starts afresh from there. The same input gives the same
/// bits if the product does.
/// @param tolerance of |b - A x| over |b|; what is returned keeps it, by a product of its own
/// @return nothing when stopped. Throws std::runtime_error when the tolerance is not reached, which
/// no system of view factors should bring about
std::optional<std::vector<double>> solve_linear(std::span<const double> b, const Product& product,
                                                double tolerance);

}  // namespace kiln::solver::pairwise
