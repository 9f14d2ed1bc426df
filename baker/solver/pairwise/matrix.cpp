// The method `matrix`: the factors of all pairs, kept, and the light that solves their system.
#include <algorithm>
#include <array>
#include <utility>
#include <vector>

#include "baker/solver/direct/direct_pass.h"
#include "baker/solver/direct/lead_passes.h"
#include "baker/solver/direct/sky_pass.h"
#include "baker/solver/pairwise/linear_system.h"
#include "baker/solver/pairwise/pairwise.h"
#include "baker/solver/pairwise/parts.h"

namespace kiln::solver::pairwise {
namespace {

using lightmap::PlaneId;

/// Rows of the matrix that a thread takes at a time.
constexpr std::uint32_t kRunRows = 16;

float channel(math::Rgb c, int i) {
  return i == 0 ? c.r : i == 1 ? c.g : c.b;
}

/// All view factors. Each unordered pair is traced once, by the run that owns the lower index; it
/// writes both of the pair's factors, and nobody else writes these two.
class FactorMatrix {
 public:
  /// Returns false when stopped.
  bool fill(const ViewFactors& factors, std::uint32_t size, const exec::Workers& workers) {
    size_ = size;
    values_.assign(std::size_t(size) * size, 0);
    rays_.assign(size, 0);
    return workers.for_runs(size, kRunRows, [&](std::uint32_t begin, std::uint32_t end) {
      for (std::uint32_t i = begin; i < end; ++i)
        rays_[i] =
            factors.pairs(i, i + 1, size, [&](std::uint32_t j, const ViewFactors::Factors& f) {
              values_[std::size_t(i) * size_ + j] = f.forth;
              values_[std::size_t(j) * size_ + i] = f.back;
            });
    });
  }

  /// Returns Σ_j F_ij x_j.
  double times(std::uint32_t i, std::span<const double> x) const {
    const float* row = values_.data() + std::size_t(i) * size_;
    double sum[4] = {};
    for (std::uint32_t j = 0; j < size_; ++j) sum[j % 4] += double(row[j]) * x[j];
    return (sum[0] + sum[1]) + (sum[2] + sum[3]);
  }
  std::uint64_t rays(std::uint32_t i) const { return rays_[i]; }

 private:
  std::uint32_t size_ = 0;
  std::vector<float> values_;        ///< row by row
  std::vector<std::uint64_t> rays_;  ///< traced for the pairs that row i owns
};

class MatrixPass final : public Pass {
 public:
  MatrixPass(const Parts& parts, PassPlan plan) : Pass(std::move(plan)), parts_(parts) {
    plan_.reads = lightmap::plane_set({PlaneId::kDirect, PlaneId::kSky});
    plan_.writes = lightmap::plane_set({PlaneId::kIndirect});
    plan_.work = matrix_work(parts.world);
  }

  static Work matrix_work(const World& world) {
    const double pairs = pass_rays(1, world.settings.pair_samples) * world.texels.size() / 2;
    return Work::directions(kFacingShare * pairs);
  }

  bool prepare(const lightmap::Lightmap& before, const exec::Workers& workers) override {
    const std::uint32_t size = parts_.patches.size();
    if (!matrix_.fill(parts_.factors, size, workers)) return false;
    for (int c = 0; c < 3; ++c) {
      std::vector<double> direct(size), reflectance(size);
      for (std::uint32_t t = 0; t < size; ++t) {
        direct[t] = double(channel(before.direct[t] + before.sky[t], c));
        reflectance[t] = double(channel(parts_.reflectance(t), c));
      }
      const auto known = with_emitters(direct, c, workers);
      if (!known) return false;
      const auto solved =
          parts_.world.settings.bounces > 0 ? solve(*known, reflectance, workers) : known;
      if (!solved) return false;
      indirect_[c].resize(size);
      for (std::uint32_t t = 0; t < size; ++t) indirect_[c][t] = float((*solved)[t] - direct[t]);
    }
    return true;
  }

  std::uint64_t run(atlas::TexelRange range, const lightmap::Lightmap&,
                    const lightmap::LightmapView& after) const override {
    std::uint64_t rays = 0;
    for (std::uint32_t t = range.begin; t < range.end; ++t) {
      after.indirect[t] = {indirect_[0][t], indirect_[1][t], indirect_[2][t]};
      rays += matrix_.rays(t);
    }
    return rays;
  }

 private:
  /// Returns one channel of the light that needs no bounce: E_direct, and F M where emitters send
  /// their light as any texel does.
  std::optional<std::vector<double>> with_emitters(const std::vector<double>& direct, int c,
                                                   const exec::Workers& workers) const {
    std::vector<double> known = direct, sent;
    if (parts_.emittance.empty()) return known;
    for (const math::Rgb& m : parts_.emittance) sent.push_back(double(channel(m, c)));
    const bool done =
        workers.for_runs(std::uint32_t(known.size()), kRunRows, [&](auto begin, auto end) {
          for (std::uint32_t i = begin; i < end; ++i) known[i] += matrix_.times(i, sent);
        });
    return done ? std::optional(std::move(known)) : std::nullopt;
  }

  /// Returns the E of one channel that solves E - F (ρ E) = E_direct.
  std::optional<std::vector<double>> solve(std::span<const double> direct,
                                           std::span<const double> reflectance,
                                           const exec::Workers& workers) const {
    std::vector<double> radiosity(direct.size());
    const Product product = [&](std::span<const double> x, std::span<double> y) {
      for (std::size_t t = 0; t < x.size(); ++t) radiosity[t] = reflectance[t] * x[t];
      return workers.for_runs(std::uint32_t(x.size()), kRunRows, [&](auto begin, auto end) {
        for (std::uint32_t i = begin; i < end; ++i) y[i] = x[i] - matrix_.times(i, radiosity);
      });
    };
    return solve_linear(direct, product, kMatrixResidual);
  }

  const Parts& parts_;
  FactorMatrix matrix_;
  std::array<std::vector<float>, 3> indirect_;  ///< lx, by channel
};

class MatrixSolver final : public Solver {
 public:
  explicit MatrixSolver(const World& world) : world_(world), parts_(world_) {}

  std::unique_ptr<Pass> next(std::span<const proto::PassReport> done) const override {
    const auto count = std::uint32_t(done.size());
    if (count >= passes()) return nullptr;
    PassPlan plan;
    plan.index = count;
    plan.completes = count + 1 == passes();
    if (count == 0) {
      plan.name = "direct";
      return direct::make_direct_pass(world_, std::move(plan));
    }
    if (count == 1 && world_.scene.has_sky()) {
      plan.name = "sky";
      return direct::make_sky_pass(world_, std::move(plan));
    }
    plan.name = "matrix";
    return std::make_unique<MatrixPass>(parts_, std::move(plan));
  }

  Forecast forecast() const override {
    Work work = direct::lead_work(world_);
    if (has_matrix()) work += MatrixPass::matrix_work(world_);
    return {passes(), work};
  }
  const SamplePlan& samples() const override { return world_.plan; }

 private:
  bool has_matrix() const { return bounce_limit(world_.settings) > 0; }
  std::uint32_t passes() const { return 1 + world_.scene.has_sky() + has_matrix(); }

  const World world_;
  const Parts parts_;
};

}  // namespace

double matrix_memory(double texels, const proto::SolverSettings& settings) {
  constexpr double kVectors = 12 * sizeof(double);  // of a channel's solution
  return texels * (texels * sizeof(float) + kVectors + pairwise_memory_per_texel(settings));
}

std::unique_ptr<Solver> make_matrix_solver(const World& world) {
  return std::make_unique<MatrixSolver>(world);
}

}  // namespace kiln::solver::pairwise
