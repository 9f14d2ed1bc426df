#include "baker/solver/pairwise/linear_system.h"

#include <cmath>
#include <stdexcept>

namespace kiln::solver::pairwise {
namespace {

using Vector = std::vector<double>;

double inner(std::span<const double> a, std::span<const double> b) {
  double sum = 0;
  for (std::size_t i = 0; i < a.size(); ++i) sum += a[i] * b[i];
  return sum;
}

/// a += s · b
void add(Vector& a, double s, const Vector& b) {
  for (std::size_t i = 0; i < a.size(); ++i) a[i] += s * b[i];
}

enum class End { kStopped, kReached, kBrokenDown };

/// Improves x until the residual's square is at most `goal`. @param r residual of x
End improve(Vector& x, Vector r, const Product& product, double goal) {
  constexpr int kMostSteps = 500;
  const Vector shadow = r;
  Vector p(r.size()), v(r.size()), t(r.size());
  double rho = 1, alpha = 1, omega = 1;
  for (int step = 0; step < kMostSteps; ++step) {
    if (inner(r, r) <= goal) return End::kReached;
    const double next_rho = inner(shadow, r);
    const double beta = next_rho / rho * (alpha / omega);
    rho = next_rho;
    if (!std::isfinite(beta)) return End::kBrokenDown;
    for (std::size_t i = 0; i < p.size(); ++i) p[i] = r[i] + beta * (p[i] - omega * v[i]);
    if (!product(p, v)) return End::kStopped;
    alpha = rho / inner(shadow, v);
    if (!std::isfinite(alpha)) return End::kBrokenDown;
    add(r, -alpha, v);
    add(x, alpha, p);
    if (inner(r, r) <= goal) return End::kReached;
    if (!product(r, t)) return End::kStopped;
    omega = inner(t, r) / inner(t, t);
    if (!std::isfinite(omega) || omega == 0) return End::kBrokenDown;
    add(x, omega, r);
    add(r, -omega, t);
  }
  return End::kBrokenDown;
}

}  // namespace

std::optional<std::vector<double>> solve_linear(std::span<const double> b, const Product& product,
                                                double tolerance) {
  constexpr int kMostStarts = 20;
  Vector x(b.begin(), b.end()), r(b.size());
  const double goal = tolerance * tolerance * inner(b, b);
  for (int start = 0; start < kMostStarts; ++start) {
    if (!product(x, r)) return std::nullopt;
    for (std::size_t i = 0; i < r.size(); ++i) r[i] = b[i] - r[i];
    if (inner(r, r) <= goal) return x;
    // Rounding parts the residual of the recurrence from the true one: it aims lower.
    if (improve(x, r, product, goal / 4) == End::kStopped) return std::nullopt;
  }
  throw std::runtime_error("the system of view factors could not be solved");
}

}  // namespace kiln::solver::pairwise
