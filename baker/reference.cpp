#include "baker/reference.h"

#include <algorithm>
#include <charconv>
#include <memory>
#include <utility>

#include "baker/gltf/uri.h"
#include "baker/image/page_image.h"
#include "baker/methods.h"
#include "baker/solver/direct/direct.h"

namespace kiln::baker {
namespace {

using proto::Expected;
using proto::Unexpected;

constexpr const char* kPointer = "/report/against";

Unexpected fail(const char* code, const std::string& why) {
  return proto::fail(code, why, "settings", kPointer);
}

std::string size_text(std::uint32_t width, std::uint32_t height) {
  return std::to_string(width) + "x" + std::to_string(height);
}

}  // namespace

proto::SolverSettings reference_settings(const proto::BakeSettings& settings,
                                         proto::Method method) {
  constexpr std::uint64_t kOtherSeed = std::uint64_t(1) << 52;
  const proto::SolverSettings& own = settings.solver;
  proto::SolverSettings out;
  out.method = method;
  out.bounces = own.bounces;
  out.samples = out.direct_samples = settings.report.samples;
  out.hit_memory_mib = own.hit_memory_mib;
  out.coarse_indirect = false;
  out.tolerance = own.tolerance;
  out.seed = own.seed ^ kOtherSeed;
  out.reflectivity_factor = own.reflectivity_factor;
  out.distance_factor = own.distance_factor;
  out.emitters = own.emitters;
  out.allow_expensive = own.allow_expensive;
  return out;
}

std::optional<std::string> page_file_name(const std::string& first, std::uint32_t page) {
  if (page == 0) return first;
  const std::string_view digits = "0123456789";
  const std::size_t last = first.find_last_of(digits, first.rfind('.'));
  if (last == std::string::npos) return std::nullopt;
  const std::size_t before = first.find_last_not_of(digits, last);
  const std::size_t begin = before == std::string::npos ? 0 : before + 1;
  const std::string_view old = std::string_view(first).substr(begin, last + 1 - begin);
  std::uint32_t number = 0;
  if (std::from_chars(old.data(), old.data() + old.size(), number).ec != std::errc()) return {};
  std::string now = std::to_string(std::uint64_t(number) + page);
  if (now.size() < old.size()) now.insert(0, old.size() - now.size(), '0');
  return first.substr(0, begin) + now + first.substr(last + 1);
}

bool ReferenceBake::wanted() const {
  return input_->settings.report.against.has_value();
}

Expected<ReferenceBake> ReferenceBake::check(const BakeInput& input, const PreparedBake& bake,
                                             const std::stop_token& stop) {
  ReferenceBake out(input, bake);
  if (!out.wanted()) return out;
  const proto::BakeSettings& settings = input.settings;
  if (const auto method = settings.report.method()) {
    const proto::SolverSettings solver = reference_settings(settings, *method);
    if (const auto found = too_expensive(solver, bake.texels->size()))
      return fail("too_expensive", "The report's reference: " + found->cost +
                                       " Use report.against \"path\", or a smaller "
                                       "atlas.page_size, or set solver.allow_expensive.");
    const bool many_lights = solver::direct::DirectLight::are_many(*bake.lights);
    auto world = std::make_shared<solver::World>(*bake.world);
    world->settings = solver;
    world->plan = sample_plan(solver, settings.quality, many_lights);
    world->filter = false;
    out.world_ = std::move(world);
    return out;
  }
  for (std::uint32_t p = 0; p < bake.texels->pages.size(); ++p) {
    if (stop.stop_requested()) return proto::canceled();
    if (const auto page = out.read_page(p); !page) return Unexpected(page.error());
  }
  return out;
}

solver::Work ReferenceBake::work() const {
  return world_ ? make_solver(*world_)->forecast().work : solver::Work();
}

Expected<image::PageImage> ReferenceBake::read_page(std::uint32_t page) const {
  const std::string& first = *input_->settings.report.against;
  const auto name = page_file_name(first, page);
  if (!name)
    return fail("missing_file", "The lightmap has " + std::to_string(bake_->texels->pages.size()) +
                                    " pages, and the name \"" + first +
                                    "\" has no number that would lead from one to the next; name "
                                    "the files page_00.exr, page_01.exr, ...");
  const auto path = gltf::find_named_file(input_->files, *name, "settings", kPointer);
  if (!path) return Unexpected(path.error());
  auto image = image::read_exr(*path);
  if (!image && image.error().code == "invalid_image")
    return fail("invalid_image", "\"" + *name + "\" can't be compared: " + image.error().message);
  const auto& own = bake_->texels->pages[page];
  if (image && (image->width != own.width || image->height != own.height))
    return fail("invalid_image", "\"" + *name + "\" has " + size_text(image->width, image->height) +
                                     " pixels, and page " + std::to_string(page) + " has " +
                                     size_text(own.width, own.height) +
                                     "; it has to be a page of the same atlas.");
  return image;
}

Expected<output::Reference> ReferenceBake::make(exec::ThreadPool& pool, const std::stop_token& stop,
                                                SolveHooks hooks) const {
  output::Reference out;
  if (!wanted()) return out;
  if (!world_) {
    out.page = [this](std::uint32_t page) { return read_page(page); };
    return out;
  }
  std::stop_source either;
  const std::stop_callback on_stop(stop, [&] { either.request_stop(); });
  const std::stop_callback on_early(input_->finish_early, [&] { either.request_stop(); });
  hooks.finish_early = {};
  hooks.queue = nullptr;
  const auto solver = make_solver(*world_);
  auto solution = solve(*world_, *solver, pool, either.get_token(), hooks);
  if (!solution && solution.error().code == proto::kCanceledCode && !stop.stop_requested())
    return out;
  if (!solution) return Unexpected(solution.error());
  out.settings = world_->settings;
  out.passes = std::move(solution->passes);
  auto light = std::make_shared<std::vector<math::Rgb>>(bake_->texels->size());
  for (std::uint32_t t = 0; t < light->size(); ++t) (*light)[t] = solution->irradiance(t);
  out.page = [texels = bake_->texels, light, dilate = input_->settings.post.dilate](
                 std::uint32_t page) -> Expected<image::PageImage> {
    return output::compose_page(
        *texels, page, [&](std::uint32_t t) { return (*light)[t]; }, dilate);
  };
  return out;
}

}  // namespace kiln::baker
