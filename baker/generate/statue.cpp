#include "baker/generate/statue.h"

#include "baker/generate/solids.h"
#include "baker/generate/wrap.h"

// A winged figure in a long robe, who holds a torch up: our own, in the place of the scanned angel
// that the theses use. It faces +Z and stands on y = 0; lengths are in meters.
namespace kiln::generate {
namespace {

using math::Vec3;

Vec3 mirrored(Vec3 p) {
  return {-p.x, p.y, p.z};
}

/// Returns a smooth step from 0 at `from` to 1 at `to`.
float ramp(float x, float from, float to) {
  const float t = std::clamp((x - from) / (to - from), 0.f, 1.f);
  return t * t * (3 - 2 * t);
}

/// Returns cos(k a + phase) for the direction (cos a, sin a), where the phase is 2 atan(shift).
float ripple(math::Vec2 direction, int k, float shift) {
  math::Vec2 power{1, 0};
  for (int i = 0; i < k; ++i)
    power = {power.x * direction.x - power.y * direction.y,
             power.x * direction.y + power.y * direction.x};
  const float scale = 1 / (1 + shift * shift);
  return (power.x * (1 - shift * shift) - power.y * 2 * shift) * scale;
}

/// The robe from the waist to the ground: a bell with folds that deepen downwards.
float robe(Vec3 p, float coarse) {
  const float y = p.y, down = 1 - ramp(y, 0.05f, 1.75f);
  const float knee = 0.09f * ramp(y, 0.35f, 0.9f) * (1 - ramp(y, 0.9f, 1.5f));
  const Vec3 q{p.x - 0.015f * down, y, (p.z - 0.03f * down) * 1.12f};
  const float radius = std::sqrt(q.x * q.x + q.z * q.z);
  if (radius < 1e-4f) return std::max(-0.25f, -y);
  const math::Vec2 d{q.x / radius, q.z / radius};
  const float folds = 0.55f * ripple(d, 11, 0.5f + 0.5f * y) + 0.3f * ripple(d, 17, 0.9f * y) +
                      0.35f * ripple(d, 7, 1.2f - 0.4f * y);
  const float depth = (0.012f + 0.045f * down) * (1 - 0.7f * coarse);
  // The bell widens slowly at the hips and sweeps out over the feet.
  const float bell = 0.255f + 0.10f * ramp(1.75f - y, 0, 0.6f) + 0.20f * down * down;
  const float forward = std::max(0.f, d.y) * std::max(0.f, 1 - std::abs(d.x - 0.35f) * 1.6f);
  const float edge = bell + depth * folds + knee * forward;
  const float side = (radius - edge) * 0.85f;
  return overlap(overlap(side, y - 1.95f, 0.3f), -y, 0.06f);
}

float torso(Vec3 p) {
  float d = ellipsoid(p, {0, 2.14f, 0.0f}, {0.31f, 0.36f, 0.20f});
  d = join(d, ellipsoid(p, {0, 1.82f, 0.01f}, {0.25f, 0.24f, 0.19f}), 0.12f);
  for (const float side : {-1.f, 1.f}) {
    d = join(d, ellipsoid(p, {side * 0.33f, 2.33f, 0.02f}, {0.14f, 0.13f, 0.13f}), 0.14f);
    d = join(d, ellipsoid(p, {side * 0.12f, 2.16f, 0.15f}, {0.11f, 0.11f, 0.09f}), 0.07f);
  }
  // A girdle, and a sash that runs from one shoulder to the other hip.
  const float girdle = std::abs(p.y - 1.80f - 0.10f * p.x) - 0.03f;
  d = join(d, overlap(girdle, d - 0.03f, 0.03f), 0.02f);
  const float sash = std::abs(p.y - 2.02f - 0.9f * p.x + 0.15f * p.z) * 0.74f - 0.05f;
  return join(d, overlap(sash, d - 0.025f, 0.03f), 0.02f);
}

float hair(Vec3 p) {
  float d = ellipsoid(p, {0, 2.85f, -0.035f}, {0.175f, 0.20f, 0.185f});
  d = join(d, ellipsoid(p, {0, 2.66f, -0.14f}, {0.13f, 0.20f, 0.085f}), 0.08f);
  const Vec3 q = p - Vec3{0, 2.85f, -0.035f};
  const float radius = std::sqrt(q.x * q.x + q.y * q.y) + 1e-4f;
  // Waves that run back from the brow.
  return d + 0.010f * ripple({q.x / radius, q.y / radius}, 13, 5 * q.z);
}

float head(Vec3 p) {
  float d = ellipsoid(p, {0, 2.80f, 0.03f}, {0.145f, 0.195f, 0.165f});
  d = join(d, ellipsoid(p, {0, 2.67f, 0.085f}, {0.075f, 0.06f, 0.07f}), 0.06f);        // chin
  d = join(d, rod(p, {0, 2.83f, 0.185f}, {0, 2.76f, 0.212f}, 0.014f, 0.025f), 0.04f);  // nose
  d = join(d, ellipsoid(p, {0, 2.70f, 0.178f}, {0.042f, 0.016f, 0.018f}), 0.012f);     // mouth
  for (const float side : {-1.f, 1.f}) {
    const Vec3 q{p.x * side, p.y, p.z};
    d = carve(d, ellipsoid(q, {0.060f, 2.81f, 0.205f}, {0.036f, 0.024f, 0.034f}), 0.03f);
    d = join(d, ellipsoid(q, {0.060f, 2.808f, 0.168f}, {0.026f, 0.017f, 0.016f}), 0.008f);
    d = join(d, rod(q, {0.02f, 2.848f, 0.195f}, {0.11f, 2.848f, 0.155f}, 0.012f, 0.010f), 0.02f);
    d = join(d, ellipsoid(q, {0.085f, 2.745f, 0.135f}, {0.04f, 0.035f, 0.03f}), 0.03f);  // cheeks
  }
  const float neck = rod(p, {0, 2.40f, -0.01f}, {0, 2.68f, 0.01f}, 0.10f, 0.085f);
  return join(join(d, hair(p), 0.02f), neck, 0.06f);
}

/// The arm that is lowered, on +X, and gathers the robe.
float lowered_arm(Vec3 p) {
  constexpr Vec3 kShoulder{0.36f, 2.31f, 0.02f}, kElbow{0.62f, 1.90f, 0.08f},
      kHand{0.58f, 1.56f, 0.40f};
  float d = rod(p, kShoulder, kElbow, 0.115f, 0.085f);
  d = join(d, rod(p, kElbow, kHand, 0.08f, 0.052f), 0.05f);
  d = join(d, ellipsoid(p, kHand + Vec3{-0.01f, -0.02f, 0.05f}, {0.05f, 0.055f, 0.085f}), 0.04f);
  // The sleeve ends over the elbow in a wide cuff.
  return join(d, rod(p, {0.52f, 2.06f, 0.06f}, {0.64f, 1.82f, 0.10f}, 0.10f, 0.125f), 0.10f);
}

/// The arm that is raised, on -X, and its torch.
float raised_arm(Vec3 p) {
  constexpr Vec3 kShoulder{-0.36f, 2.33f, 0.02f}, kElbow{-0.68f, 2.50f, 0.10f},
      kHand{-0.70f, 2.93f, 0.12f};
  float d = rod(p, kShoulder, kElbow, 0.115f, 0.085f);
  d = join(d, rod(p, kElbow, kHand, 0.08f, 0.052f), 0.05f);
  d = join(d, ellipsoid(p, kHand + Vec3{0, 0.05f, 0.01f}, {0.065f, 0.075f, 0.065f}), 0.03f);
  d = join(d, rod(p, {-0.48f, 2.40f, 0.05f}, {-0.66f, 2.47f, 0.09f}, 0.12f, 0.125f), 0.05f);
  float torch = rod(p, {-0.70f, 2.84f, 0.12f}, {-0.70f, 3.30f, 0.12f}, 0.032f, 0.07f);
  torch = join(torch, ellipsoid(p, {-0.70f, 3.33f, 0.12f}, {0.115f, 0.035f, 0.115f}), 0.03f);
  const float twist = 0.035f * (p.y - 3.5f);
  torch = join(torch, ellipsoid(p, {-0.70f + twist, 3.47f, 0.12f}, {0.085f, 0.15f, 0.085f}), 0.03f);
  return join(d, torch, 0.02f);
}

/// The depth of a wing's middle: wings sweep back from the shoulder blades.
float wing_z(float x) {
  return -0.54f - 0.24f * std::min(x, 1.2f);
}

/// The wing on +X: a bone from the shoulder blade up and out, from which feathers hang.
float wing(Vec3 p, float coarse) {
  constexpr int kFeathers = 8;
  const float tilt = 0.03f * (1 - coarse), soft = 0.1f * coarse;
  // The wing is flat in coordinates that follow its sweep.
  const Vec3 q{p.x, p.y, p.z - wing_z(p.x)};
  float d = rod(q, {0.25f, 2.16f, 0.02f}, {0.45f, 2.62f, 0}, 0.085f, 0.075f);
  d = join(d, rod(q, {0.45f, 2.62f, 0}, {0.98f, 2.86f, 0}, 0.075f, 0.045f), 0.05f);
  const Vec3 thin{q.x, q.y, q.z * 2.2f};
  for (int i = 0; i < kFeathers; ++i) {
    const float t = float(i) / float(kFeathers - 1);
    const Vec3 root{0.30f + 0.66f * t, 2.30f + 0.50f * t, 0};
    const Vec3 tip{0.30f + 0.92f * t, 1.10f + 0.70f * t + 0.20f * t * t, 0};
    // Feathers lie over each other like tiles.
    const Vec3 tilted{thin.x, thin.y, thin.z + tilt * (i % 2 == 0 ? 1.f : -1.f)};
    d = join(d, rod(tilted, root, tip, 0.088f, 0.084f) * 0.6f, 0.08f + soft);
  }
  for (int i = 0; i < 5; ++i) {  // short ones over the roots
    const float t = (float(i) + 0.5f) / 5;
    const Vec3 root{0.28f + 0.66f * t, 2.40f + 0.42f * t, 0};
    d = join(
        d, rod(thin, root, root + Vec3{0.04f + 0.10f * t, -0.42f, 0}, 0.11f, 0.08f) * 0.6f - 0.012f,
        0.015f + soft);
  }
  return d;
}

/// The joint between a wing and a shoulder blade, on +X.
float root_of_wing(Vec3 p) {
  return rod(p, {0.25f, 2.20f, -0.05f}, {0.27f, 2.17f, -0.57f}, 0.10f, 0.09f);
}

/// Leaves out parts that are too far from `p` to matter.
float figure(Vec3 p, float coarse) {
  float d = 1;
  if (p.y < 2.3f && p.z > -0.65f) d = robe(p, coarse);
  if (p.z > -0.5f) {
    if (p.y > 1.3f) d = join(d, torso(p), 0.08f);
    if (p.y > 2.2f && std::abs(p.x) < 0.45f) d = join(d, head(p), 0.05f);
    if (p.x > 0.15f && p.y > 1.2f) d = join(d, lowered_arm(p), 0.05f);
    if (p.x < -0.15f && p.y > 1.9f) d = join(d, raised_arm(p), 0.05f);
  }
  if (p.z < -0.05f && p.y > 0.7f) {
    const Vec3 q = p.x < 0 ? mirrored(p) : p;
    float back = root_of_wing(q);
    if (p.z < -0.35f) back = join(wing(q, coarse), back, 0.05f);
    d = join(d, back, 0.06f);
  }
  return d;
}

/// Bends the cage's plate behind the right shoulder onto the wing of +X.
Vec3 place_on_wing(Vec3 lattice) {
  const float x = 0.22f + (lattice.x - 1) / 5 * 1.06f;
  const float t = std::max(0.f, (x - 0.30f) / 0.92f);
  const float bottom = 1.00f + 0.70f * t + 0.20f * t * t;
  const float top = x < 0.45f ? 2.25f + (x - 0.20f) * 1.8f : 2.70f + (x - 0.45f) * 0.45f;
  return {x, bottom + (lattice.y - 5) / 9 * (top - bottom), wing_z(x) + (lattice.z + 3.5f) * 0.12f};
}

/// Cubes of 20 cm. Plates behind the back become the wings.
Cage cage_of_figure() {
  constexpr float kCube = 0.2f;
  Cage cage;
  cage.cube_m = kCube;
  cage.boxes = {{{-2, 0, -2}, {2, 8, 2}},      // robe
                {{-2, 8, -1}, {2, 12, 1}},     // torso
                {{-1, 12, -1}, {1, 15, 1}},    // neck and head
                {{2, 11, 0}, {4, 12, 1}},      // lowered arm
                {{3, 7, 0}, {4, 11, 1}},       //
                {{-4, 11, 0}, {-2, 12, 1}},    // raised arm
                {{-4, 12, 0}, {-3, 18, 1}},    //
                {{1, 11, -3}, {2, 12, -1}},    // roots of the wings
                {{-2, 11, -3}, {-1, 12, -1}},  //
                {{1, 5, -4}, {6, 14, -3}},     // wings
                {{-6, 5, -4}, {-1, 14, -3}}};
  cage.place = [](Vec3 lattice) {
    if (lattice.z <= -3)
      return lattice.x < 0 ? mirrored(place_on_wing(mirrored(lattice))) : place_on_wing(lattice);
    Vec3 p = lattice * kCube;
    if (lattice.y < 8 && std::abs(lattice.x) <= 2) {  // the robe is round
      const float half = std::max(std::abs(p.x), std::abs(p.z));
      const float round = half > 0 ? 0.85f * half / std::sqrt(p.x * p.x + p.z * p.z) : 1;
      p.x *= round, p.z *= round;
    }
    if (lattice.y >= 8 && lattice.y < 11 && std::abs(lattice.x) <= 2) p.x *= 0.7f;
    if (lattice.x > 2) {  // the forearm reaches forwards
      p.y -= 0.06f;
      p.x -= 0.05f + 0.4f * std::max(0.f, p.y - 1.9f);
      p.z += 1.2f * std::max(0.f, 1.9f - p.y);
    }
    if (lattice.z < -1 && lattice.y > 10) {  // the joints of the wings are lower
      const float share = 1 - std::abs(lattice.z + 2);
      p.y -= 0.12f * share;
      p.x -= (p.x < 0 ? -0.03f : 0.03f) * share;
    }
    if (lattice.x < -2) p.y += 0.12f * (-2 - lattice.x > 1 ? 1 : -2 - lattice.x);
    return p;
  };
  return cage;
}

}  // namespace

void add_statue(SceneBuilder& scene, const Part& part, math::Vec3 foot, std::uint32_t cells) {
  Cage cage = cage_of_figure();
  const auto place = cage.place;
  cage.place = [=](Vec3 lattice) { return foot + place(lattice); };
  add_wrapped(
      scene, part, cage, [=](Vec3 p, float coarse) { return figure(p - foot, coarse); }, cells);
}

}  // namespace kiln::generate
