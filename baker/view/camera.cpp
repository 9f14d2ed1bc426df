#include "baker/view/camera.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "baker/view/wrong.h"

namespace kiln::view {
namespace {

using math::Vec3;

constexpr float kFittedAngle = 40, kUsualAngle = 50;  ///< vertical, degrees
constexpr float kMargin = 1.04f;                      ///< around a fitted scene
constexpr double kFarthest = 1e9;                     ///< m, as in scene files
constexpr const char* kUsage =
    "It has to be `fit`, the name of a camera of the scene, or `x,y,z:tx,ty,tz` with an optional "
    "`:degrees`, such as `2,1.5,3:0,1,0:50`.";

float tangent_of_half(float degrees) {
  return std::tan(degrees * (math::kPi / 360));
}

/// A camera that a text describes by numbers.
struct Placed {
  Vec3 position, target;
  std::optional<float> size;
};

/// Reads numbers that commas part. Nothing: it is something else.
std::optional<std::vector<double>> numbers(std::string_view text) {
  std::vector<double> out;
  for (;;) {
    double value = 0;
    const auto read = std::from_chars(text.data(), text.data() + text.size(), value);
    if (read.ec != std::errc() || !std::isfinite(value)) return std::nullopt;
    out.push_back(value);
    text.remove_prefix(std::size_t(read.ptr - text.data()));
    if (text.empty()) return out;
    if (text.front() != ',' || out.size() == 3) return std::nullopt;
    text.remove_prefix(1);
  }
}

/// Reads a text of numbers; nothing when it is a name.
std::optional<std::vector<std::vector<double>>> groups(std::string_view text) {
  std::vector<std::vector<double>> out;
  for (;;) {
    const std::size_t end = std::min(text.find(':'), text.size());
    auto group = numbers(text.substr(0, end));
    if (!group || out.size() == 3) return std::nullopt;
    out.push_back(std::move(*group));
    if (end == text.size()) break;
    text.remove_prefix(end + 1);
  }
  return out.size() > 1 ? std::optional(std::move(out)) : std::nullopt;
}

/// Reads a camera of numbers; nothing for `fit` and for names.
proto::Expected<std::optional<Placed>> placed(const std::string& text) {
  if (text.empty()) return wrong("bad_request", "camera", std::string("It is empty. ") + kUsage);
  const auto read = groups(text);
  if (!read) return std::nullopt;
  const auto& g = *read;
  if (g[0].size() != 3 || g[1].size() != 3 || (g.size() == 3 && g[2].size() != 1))
    return wrong("bad_request", "camera", kUsage);
  for (const auto& group : g)
    for (const double v : group)
      if (std::abs(v) > kFarthest)
        return wrong("bad_request", "camera", "Its numbers have to lie within 1e9.");
  const auto vec = [](const std::vector<double>& v) {
    return Vec3{float(v[0]), float(v[1]), float(v[2])};
  };
  Placed out{vec(g[0]), vec(g[1]), std::nullopt};
  if (out.position == out.target)
    return wrong("bad_request", "camera", "It stands where it looks: the two points are the same.");
  if (g.size() == 3) {
    out.size = float(g[2][0]);
    if (!(*out.size > 0))
      return wrong("bad_request", "camera",
                   "Its last number, an angle or a height, has to be over 0.");
  }
  return out;
}

/// Aims a lens, with +Y up, or -Z where it looks along Y.
Lens aimed(Vec3 position, Vec3 forward) {
  Lens lens;
  lens.position = position;
  lens.forward = forward;
  const bool upright = std::abs(forward.y) < 0.999f;
  lens.right = normalize(cross(forward, upright ? Vec3{0, 1, 0} : Vec3{0, 0, -1}));
  lens.up = cross(lens.right, lens.forward);
  return lens;
}

struct Box {
  Vec3 low, high;

  explicit Box(const scene::Scene& scene) : low(scene.positions.at(0)), high(low) {
    for (const Vec3& p : scene.positions) {
      low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
      high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
  }
  Vec3 center() const { return low * 0.5f + high * 0.5f; }
  float radius() const { return std::max(length(high - low) / 2, 1e-6f); }
  Vec3 corner(int i) const {
    return {i & 1 ? high.x : low.x, i & 2 ? high.y : low.y, i & 4 ? high.z : low.z};
  }
};

/// Sets the height of an orthographic lens so that it shows the whole box.
void widen(Lens& lens, const Box& box, float aspect) {
  float half = 0;
  for (int i = 0; i < 8; ++i) {
    const Vec3 at = box.corner(i) - lens.position;
    half = std::max({half, std::abs(dot(at, lens.up)), std::abs(dot(at, lens.right)) / aspect});
  }
  lens.half_height = std::max(half * kMargin, 1e-6f);
}

/// Moves a perspective lens, without turning it, to where the box just fits into its picture. The
/// picture's four sides are planes through the lens: each is pushed against the box, and the lens
/// stands in the middle between opposite ones, as far back as the closer pair needs.
void step_back(Lens& lens, const Box& box) {
  constexpr float kFar = std::numeric_limits<float>::infinity();
  struct Pair {
    float high = -kFar, low = kFar;
  } across, along;
  const auto push = [](Pair& pair, float side, float depth, float half) {
    pair.high = std::max(pair.high, side - depth * half);
    pair.low = std::min(pair.low, side + depth * half);
  };
  const float half_width = lens.half_width / kMargin, half_height = lens.half_height / kMargin;
  float nearest = kFar;
  for (int i = 0; i < 8; ++i) {
    const Vec3 at = box.corner(i) - box.center();
    const float depth = dot(at, lens.forward);
    push(across, dot(at, lens.right), depth, half_width);
    push(along, dot(at, lens.up), depth, half_height);
    nearest = std::min(nearest, depth);
  }
  const float depth =
      std::min({(across.low - across.high) / (2 * half_width),
                (along.low - along.high) / (2 * half_height), nearest - box.radius() * 1e-3f});
  lens.position = box.center() + lens.right * ((across.low + across.high) / 2) +
                  lens.up * ((along.low + along.high) / 2) + lens.forward * depth;
}

Lens fitted(const Box& box, float aspect, bool orthographic) {
  Lens lens = aimed(box.center(), normalize(Vec3{-0.55f, -0.45f, -1}));
  lens.orthographic = orthographic;
  lens.half_height = tangent_of_half(kFittedAngle);
  if (orthographic) {
    lens.position = box.center() - lens.forward * (2 * box.radius());
    widen(lens, box, aspect);
    return lens;
  }
  lens.half_width = lens.half_height * aspect;
  step_back(lens, box);
  return lens;
}

proto::Expected<Lens> from(const Placed& placed, const Box& box, float aspect, bool orthographic) {
  Lens lens = aimed(placed.position, normalize(placed.target - placed.position));
  lens.orthographic = orthographic;
  if (!orthographic) {
    if (placed.size.value_or(kUsualAngle) >= 179)
      return wrong("bad_request", "camera", "Its angle has to be below 179 degrees.");
    lens.half_height = tangent_of_half(placed.size.value_or(kUsualAngle));
  } else if (placed.size) {
    lens.half_height = *placed.size / 2;
  } else {
    widen(lens, box, aspect);
  }
  return lens;
}

proto::Unexpected unknown(const std::string& name, std::span<const scene::Camera> cameras) {
  constexpr std::size_t kListed = 10;
  std::string names;
  for (std::size_t i = 0; i < std::min(cameras.size(), kListed); ++i)
    names += (i > 0 ? ", `" : "`") + cameras[i].name + "`";
  if (cameras.size() > kListed) names += " and more";
  return wrong("not_found", "camera",
               "The scene has no camera `" + name + "`; " +
                   (cameras.empty() ? "it has none at all. " : "it has " + names + ". ") + kUsage);
}

}  // namespace

Lens::Ray Lens::through(float x, float y) const {
  const Vec3 beside = right * (x * half_width) + up * (y * half_height);
  if (orthographic) return {position + beside, forward};
  return {position, normalize(forward + beside)};
}

proto::Expected<Lens> choose_camera(const std::string& text, const scene::Scene& scene,
                                    float aspect, bool orthographic) {
  const auto described = placed(text);
  if (!described) return proto::Unexpected(described.error());
  const Box box(scene);
  proto::Expected<Lens> lens;
  if (*described) {
    lens = from(**described, box, aspect, orthographic);
    if (!lens) return lens;
  } else if (text == "fit") {
    lens = fitted(box, aspect, orthographic);
  } else {
    const auto found = std::ranges::find(scene.cameras, text, &scene::Camera::name);
    if (found == scene.cameras.end()) return unknown(text, scene.cameras);
    lens->position = found->position;
    lens->forward = found->forward;
    lens->up = found->up;
    lens->right = cross(found->forward, found->up);
    lens->orthographic = found->orthographic || orthographic;
    lens->half_height = found->half_height;
    if (orthographic && !found->orthographic) widen(*lens, box, aspect);
  }
  lens->half_width = lens->half_height * aspect;
  return lens;
}

proto::Expected<void> check_camera(const std::string& text) {
  const auto read = placed(text);
  if (!read) return proto::Unexpected(read.error());
  return {};
}

}  // namespace kiln::view
