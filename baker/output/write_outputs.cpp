#include <cmath>
#include <functional>
#include <nlohmann/json.hpp>
#include <optional>

#include "baker/exec/memory.h"
#include "baker/exec/stop.h"
#include "baker/output/lamps.h"
#include "baker/output/layers.h"
#include "baker/output/lit_page.h"
#include "baker/output/output.h"
#include "proto/files.h"
#include "proto/json.h"

namespace kiln::output {
namespace {

using proto::fail;
using proto::Unexpected;

/// A page with a larger value is written as float, since half floats end at 65,504.
constexpr float kHalfLimit = 60'000;

bool contains(const std::vector<std::string>& list, std::string_view item) {
  return std::find(list.begin(), list.end(), item) != list.end();
}

std::string page_name(std::uint32_t page, const std::string& extension) {
  const std::string digits = std::to_string(page);
  return std::string("page_").append(digits.size() < 2 ? "0" : "").append(digits).append(extension);
}

/// A layer of this bake's pages.
struct PageLayer {
  const Layer* layer;
  TexelValue value;
  ValueRange range;  ///< over the texels of all pages, where its pictures need that

  bool is_irradiance() const { return layer == &layers().front(); }
};

/// Writes the files of one bake and fills the manifest on the way.
class Writer {
 public:
  Writer(const std::filesystem::path& dir, const OutputInput& in,
         const proto::BakeSettings& settings, proto::Manifest& manifest, exec::ThreadPool& pool,
         std::stop_token stop)
      : dir_(dir),
        in_(in),
        settings_(settings),
        manifest_(manifest),
        pool_(pool),
        stop_(std::move(stop)) {}

  proto::Expected<void> run() {
    if (auto ok = load_layers(); !ok) return ok;
    manifest_.pages.clear();
    manifest_.files.clear();
    for (std::uint32_t p = 0; p < in_.texels.pages.size(); ++p)
      if (auto ok = write_page(p); !ok) return ok;
    fill_nodes();
    if (auto ok = write_lit_scene(); !ok) return ok;
    if (auto ok = write_report(); !ok) return ok;
    return write_manifest();
  }

 private:
  proto::Expected<void> load_layers() {
    for (const std::string& name : settings_.output.layers) {
      const Layer* layer = find_layer(name);
      if (!layer) return proto::fail("internal", "There is no layer '" + name + "'.");
      auto value = values_of(*layer, in_);
      if (!value) return Unexpected(value.error());
      layers_.push_back({layer, std::move(*value), {}});
      if (auto ok = measure(layers_.back()); !ok) return ok;
    }
    irradiance_ = layers().front().value(in_);
    emission_ = find_layer("emission")->value(in_);
    return prepare_lit();
  }

  /// Takes the settings of lit.glb. Unlit colors have one exposure for all pages, since a surface
  /// may lie on several.
  proto::Expected<void> prepare_lit() {
    const proto::OutputSettings& output = settings_.output;
    lit_.lightmap = output.glb_lightmap;
    lit_.mode = output.glb_mode;
    lit_.keep_lights = output.keep_lights;
    const bool srgb = lit_.lightmap == proto::GlbLightmap::kSrgb8 && !shows_unlit();
    if (srgb && contains(output.formats, "glb") && scene_emits()) {
      auto hidden = hidden_by_lamps(in_.texels, irradiance_, emission_, stop_);
      if (!hidden) return Unexpected(hidden.error());
      hidden_ = std::move(*hidden);
    }
    if (!shows_unlit()) return {};
    if (output.exposure) {
      unlit_exposure_ = *output.exposure;
      return {};
    }
    exec::StopPoll stopped(stop_);
    std::vector<float> luminances;
    luminances.reserve(in_.texels.front_count);
    for (std::uint32_t t = 0; t < in_.texels.front_count; ++t) {
      if (stopped()) return exec::canceled();
      const float y = luminance(irradiance_(t));
      if (std::isfinite(y)) luminances.push_back(std::max(y, 0.f));
    }
    unlit_exposure_ = automatic_exposure(std::move(luminances));
    return {};
  }

  bool shows_unlit() const {
    return settings_.output.glb_mode == proto::GlbMode::kUnlit &&
           contains(settings_.output.formats, "glb");
  }

  proto::Expected<void> measure(PageLayer& layer) const {
    const Shown shown = layer.layer->shown;
    if (shown != Shown::kOverMaximum && shown != Shown::kWithinBounds) return {};
    if (!contains(settings_.output.formats, "png")) return {};
    exec::StopPoll stopped(stop_);
    for (std::uint32_t t = 0; t < in_.texels.front_count; ++t) {
      if (stopped()) return exec::canceled();
      layer.range.add(layer.value(t));
    }
    return {};
  }

  proto::Expected<void> check_stop() const {
    if (stop_.stop_requested()) return exec::canceled();
    return {};
  }

  image::PageImage compose(std::uint32_t page, const TexelValue& value) const {
    return compose_page(in_.texels, page, value, settings_.post.dilate);
  }

  /// Writes the files of one page at the same time, each on its own thread.
  proto::Expected<void> write_page(std::uint32_t p) {
    if (auto ok = check_stop(); !ok) return ok;
    const image::PageImage irradiance = compose(p, irradiance_);
    auto info = look_at(p, irradiance);
    if (!info) return Unexpected(info.error());
    const Tone tone = tone_of(irradiance, settings_.output.exposure, settings_.output.tone_curve);

    auto images = compose_layers(p);
    if (!images) return Unexpected(images.error());
    PageFiles made;
    made.layer_previews.resize(layers_.size());
    std::vector<std::function<proto::Expected<void>()>> tasks;
    if (contains(settings_.output.formats, "exr")) {
      info->exr = page_name(p, ".exr");
      tasks.push_back([&] { return write_page_exr(p, irradiance, *images, info->exr, made); });
    }
    if (contains(settings_.output.formats, "png")) {
      info->preview = page_name(p, ".png");
      info->preview_exposure = tone.exposure;
      tasks.push_back([&] {
        return write_picture(info->preview, irradiance, Shown::kPageLight, tone, {}, made.preview);
      });
      for (std::size_t i = 0; i < layers_.size(); ++i)
        if (!layers_[i].is_irradiance())
          tasks.push_back([&, i] {
            return write_layer_preview(p, layers_[i], (*images)[i], tone, made.layer_previews[i]);
          });
    }
    if (contains(settings_.output.formats, "glb"))
      tasks.push_back([&] { return make_lit_page(p, irradiance, info->exr, made); });
    if (auto ok = run(tasks); !ok) return ok;

    for (auto* file : {&made.exr, &made.preview})
      if (*file) manifest_.files.push_back(std::move(**file));
    for (auto& file : made.layer_previews)
      if (file) manifest_.files.push_back(std::move(*file));
    if (made.lit) {
      if (!shows_unlit() && !made.lit->png.empty()) {
        info->glb_scale = made.lit->scale;
        info->glb_clipped = made.lit->clipped;
        info->glb_clipped_lamps = made.lit->clipped_lamps;
      }
      lit_.pages.push_back(std::move(*made.lit));
    }
    if (made.warning) manifest_.warnings.push_back(std::move(*made.warning));
    manifest_.pages.push_back(std::move(*info));
    return {};
  }

  /// Returns the page's size, its number of lit texels and their maximum. A value that is not
  /// finite is an error.
  static proto::Expected<proto::PageInfo> look_at(std::uint32_t p,
                                                  const image::PageImage& irradiance) {
    proto::PageInfo info;
    info.width = irradiance.width;
    info.height = irradiance.height;
    for (std::size_t i = 0; i < irradiance.rgb.size(); ++i) {
      if (!(irradiance.coverage[i] > 0)) continue;
      const math::Rgb v = irradiance.rgb[i];
      if (!std::isfinite(v.r) || !std::isfinite(v.g) || !std::isfinite(v.b))
        return proto::fail("internal", "The light of texel (" + std::to_string(i % info.width) +
                                           ", " + std::to_string(i / info.width) + ") of page " +
                                           std::to_string(p) + " is not finite.");
      ++info.texels;
      info.max_lx = std::max(info.max_lx, max_channel(v));
    }
    return info;
  }

  /// The results of one page's tasks. Each task writes its own members.
  struct PageFiles {
    std::optional<proto::ResultFile> exr, preview;
    std::vector<std::optional<proto::ResultFile>> layer_previews;  ///< parallel to layers_
    std::optional<LitPage> lit;
    std::optional<proto::Warning> warning;
  };

  /// Runs all tasks on the pool. Returns the first error in the order of the tasks.
  proto::Expected<void> run(std::span<const std::function<proto::Expected<void>()>> tasks) {
    std::vector<proto::Expected<void>> results(tasks.size());
    const bool whole = pool_.for_batches(std::uint32_t(tasks.size()), stop_,
                                         [&](std::uint32_t i) { results[i] = tasks[i](); });
    if (!whole) return exec::canceled();
    for (auto& result : results)
      if (!result) return result;
    return {};
  }

  /// Returns an image for each layer, but an empty one for the irradiance, which is there already.
  /// There is none at all when no file shows them.
  proto::Expected<std::vector<image::PageImage>> compose_layers(std::uint32_t p) {
    std::vector<image::PageImage> images(layers_.size());
    if (!contains(settings_.output.formats, "exr") && !contains(settings_.output.formats, "png"))
      return images;
    std::vector<std::function<proto::Expected<void>()>> tasks;
    for (std::size_t i = 0; i < layers_.size(); ++i)
      if (!layers_[i].is_irradiance())
        tasks.push_back([this, p, i, &images]() -> proto::Expected<void> {
          images[i] = compose(p, layers_[i].value);
          return {};
        });
    if (auto ok = run(tasks); !ok) return Unexpected(ok.error());
    return images;
  }

  proto::Expected<void> write_page_exr(std::uint32_t p, const image::PageImage& irradiance,
                                       std::span<const image::PageImage> images,
                                       const std::string& name, PageFiles& made) const {
    std::vector<image::ExrLayer> named;
    float most = 0;
    const char* most_layer = "";
    for (std::size_t i = 0; i < layers_.size(); ++i) {
      const image::PageImage& image = layers_[i].is_irradiance() ? irradiance : images[i];
      named.push_back({layers_[i].layer->name, &image});
      for (const math::Rgb v : image.rgb) {
        const float size = std::max({std::abs(v.r), std::abs(v.g), std::abs(v.b)});
        if (size > most) most = size, most_layer = layers_[i].layer->name;
      }
    }
    proto::Precision precision = settings_.output.precision;
    if (precision == proto::Precision::kHalf && most > kHalfLimit) {
      precision = proto::Precision::kFloat;
      made.warning = {"half_overflow", "",
                      name + " is written as float: its layer " + most_layer + " holds " +
                          std::to_string(std::llround(most)) +
                          ", and half precision ends at 65,504"};
    }
    const auto metadata = exr_metadata(p);
    if (auto ok = proto::write_whole(dir_ / name,
                                     [&](const std::filesystem::path& temporary) {
                                       return write_exr(temporary, named, precision, metadata,
                                                        stop_);
                                     });
        !ok)
      return ok;
    return digest(name, "image/x-exr", made.exr);
  }

  std::vector<std::pair<std::string, std::string>> exr_metadata(std::uint32_t page) const {
    const auto& solver = settings_.solver;
    std::string layers;
    for (const PageLayer& layer : layers_)
      layers.append(layers.empty() ? "" : ",").append(layer.layer->name);
    return {
        {"lightkiln:version", manifest_.version},
        {"lightkiln:units", "lux"},
        {"lightkiln:quantity", "irradiance E without albedo; outgoing radiance = albedo / pi * E"},
        {"lightkiln:layers", layers},
        {"lightkiln:alpha", "1 on lit texels, 0 in padding"},
        {"lightkiln:page", std::to_string(page)},
        {"lightkiln:method", proto::to_string(solver.method)},
        {"lightkiln:bounces", std::to_string(solver.bounces)},
        {"lightkiln:samples", solver.samples ? std::to_string(*solver.samples) : "adaptive"},
        {"lightkiln:seed", std::to_string(solver.seed)},
        {"lightkiln:sceneSha256", manifest_.scene_sha256},
        {"lightkiln:settingsSha256", proto::sha256_hex(proto::to_json(settings_).dump())},
        {"lightkiln:instructionSet", manifest_.instruction_set},
    };
  }

  proto::Expected<void> write_picture(const std::string& name, const image::PageImage& image,
                                      Shown shown, Tone tone, const ValueRange& range,
                                      std::optional<proto::ResultFile>& file) const {
    const auto png = image::encode_png(show(image, shown, tone, range), image.width, image.height);
    if (!png) return Unexpected(png.error());
    if (auto ok = proto::write_bytes(dir_ / name, *png); !ok) return ok;
    return digest(name, "image/png", file);
  }

  proto::Expected<void> write_layer_preview(std::uint32_t p, const PageLayer& layer,
                                            const image::PageImage& image, Tone page_tone,
                                            std::optional<proto::ResultFile>& file) const {
    const Shown shown = layer.layer->shown;
    const Tone tone =
        shown == Shown::kOwnLight ? tone_of(image, {}, settings_.output.tone_curve) : page_tone;
    const std::string name = page_name(p, std::string(".") + layer.layer->name + ".png");
    return write_picture(name, image, shown, tone, layer.range, file);
  }

  proto::Expected<void> make_lit_page(std::uint32_t p, const image::PageImage& irradiance,
                                      const std::string& exr, PageFiles& made) const {
    auto lit = shows_unlit() ? make_unlit_page(p)
                             : encode_lit_page(irradiance, lamps_of(p), lit_.lightmap);
    if (!lit) return Unexpected(lit.error());
    lit->exr = exr;
    if (!shows_unlit()) lit->exposure = tone_of(irradiance, settings_.output.exposure, {}).exposure;
    made.lit = std::move(*lit);
    return {};
  }

  /// Returns for each texel square of the page whether a lamp hides what lights it.
  std::vector<bool> lamps_of(std::uint32_t p) const {
    std::vector<bool> lamps;
    if (hidden_.empty()) return lamps;
    const auto& texel_at = in_.texels.pages[p].texel_at;
    lamps.resize(texel_at.size());
    for (std::size_t i = 0; i < texel_at.size(); ++i)
      lamps[i] = texel_at[i] >= 0 && hidden_[std::size_t(texel_at[i])];
    return lamps;
  }

  bool scene_emits() const {
    return std::ranges::any_of(in_.scene.materials,
                               [](const scene::Material& m) { return !is_black(m.emission); });
  }

  /// Makes a page of what leaves the surface: reflected and own light.
  proto::Expected<LitPage> make_unlit_page(std::uint32_t p) const {
    const image::PageImage light = compose(p, [this](std::uint32_t t) {
      return in_.texels.albedo[t] * irradiance_(t) + emission_(t) * math::kPi;
    });
    const bool opaque = std::ranges::all_of(in_.scene.materials, [](const scene::Material& m) {
      return m.alpha_mode == scene::AlphaMode::kOpaque;
    });
    if (opaque) return encode_unlit_page(light, nullptr, unlit_exposure_);
    const image::PageImage alpha = compose(p, [this](std::uint32_t t) {
      float sum = 0;
      for (const atlas::SamplePoint& point : in_.texels.points_of(t))
        sum += in_.scene.material_of(point.triangle).alpha_mode == scene::AlphaMode::kOpaque
                   ? 1
                   : alpha_at(in_.scene, point.triangle, point.bary());
      return math::Rgb{sum / atlas::TextureGroup::kPointsPerTexel, 0, 0};
    });
    return encode_unlit_page(light, &alpha, unlit_exposure_);
  }

  void fill_nodes() {
    manifest_.nodes.clear();
    for (std::size_t i = 0; i < in_.scene.instances.size(); ++i) {
      const scene::Instance& instance = in_.scene.instances[i];
      const atlas::InstancePlacement& placed = in_.atlas.placements[i];
      proto::NodePlacement node;
      node.node = instance.node;
      node.mesh = instance.mesh;
      node.name = instance.name;
      node.page = placed.page;
      if (placed.uses_source_uv) {
        node.scale = {placed.scale.x, placed.scale.y};
        node.offset = {placed.offset.x, placed.offset.y};
      }
      node.uv_source = placed.uses_source_uv ? "texcoord_1" : "unwrapped";
      node.reason = placed.reason;
      manifest_.nodes.push_back(std::move(node));
    }
  }

  proto::Expected<void> write_lit_scene() {
    if (!contains(settings_.output.formats, "glb")) return {};
    if (auto ok = check_stop(); !ok) return ok;
    if (auto ok = proto::write_whole(dir_ / "lit.glb",
                                     [&](const std::filesystem::path& temporary) {
                                       return in_.write_lit(temporary, lit_, stop_);
                                     });
        !ok)
      return ok;
    return add_file("lit.glb", "model/gltf-binary");
  }

  proto::Expected<void> write_report() {
    if (!in_.reference.page) return {};
    const auto files = output::write_report(
        dir_, in_.reference, std::uint32_t(in_.texels.pages.size()),
        [&](std::uint32_t page) { return compose(page, irradiance_); }, settings_.report, stop_);
    if (!files) return Unexpected(files.error());
    for (const ReportFile& file : *files)
      if (auto ok = add_file(file.name, file.media_type); !ok) return ok;
    return {};
  }

  /// Writes manifest.json. It cannot hold its own hash, so it lists the other files, and only the
  /// caller's manifest lists it too.
  proto::Expected<void> write_manifest() {
    if (auto ok = check_stop(); !ok) return ok;
    manifest_.statistics.peak_memory_bytes = exec::peak_memory_bytes();
    const std::string text = proto::to_json(manifest_).dump(1) + "\n";
    if (auto ok = proto::write_bytes(dir_ / "manifest.json", text); !ok) return ok;
    return add_file("manifest.json", "application/json");
  }

  proto::Expected<void> add_file(const std::string& name, const char* media_type) {
    std::optional<proto::ResultFile> file;
    if (auto ok = digest(name, media_type, file); !ok) return ok;
    manifest_.files.push_back(std::move(*file));
    return {};
  }
  proto::Expected<void> digest(const std::string& name, const char* media_type,
                               std::optional<proto::ResultFile>& file) const {
    auto digest = proto::digest_file(dir_ / name);
    if (!digest) return Unexpected(digest.error());
    file = {name, media_type, digest->bytes, std::move(digest->sha256)};
    return {};
  }

  const std::filesystem::path& dir_;
  const OutputInput& in_;
  const proto::BakeSettings& settings_;
  proto::Manifest& manifest_;
  exec::ThreadPool& pool_;
  std::stop_token stop_;
  std::vector<PageLayer> layers_;
  TexelValue irradiance_;  ///< as a page shows it, whatever its layers are
  TexelValue emission_;
  std::vector<bool> hidden_;  ///< by texel, whether a lamp hides its light; empty: none
  LitPages lit_;
  float unlit_exposure_ = 1;
};

}  // namespace

proto::Expected<void> write_outputs(const std::filesystem::path& dir, const OutputInput& in,
                                    const proto::BakeSettings& settings, proto::Manifest& manifest,
                                    exec::ThreadPool& pool, std::stop_token stop) {
  return Writer(dir, in, settings, manifest, pool, std::move(stop)).run();
}

}  // namespace kiln::output
