#include "baker/solver/radiosity_map/ambient_term.h"

#include <algorithm>

namespace kiln::solver::radiosity_map {

lightmap::Lightmap with_ambient_term(const atlas::TextureGroup& texels, lightmap::Lightmap light,
                                     std::span<const math::Rgb> emittance) {
  double area = 0, albedo[3] = {}, reflected[3] = {}, arrived[3] = {};
  for (std::uint32_t t = 0; t < texels.size(); ++t) {
    const double a = double(texels.area_m2[t]);
    const math::Rgb rho = texels.albedo[t], e = light.direct[t] + light.sky[t];
    const math::Rgb b = rho * e + (emittance.empty() ? math::Rgb{} : emittance[t]);
    const math::Rgb indirect = light.indirect[t];
    area += a;
    albedo[0] += a * double(rho.r), albedo[1] += a * double(rho.g), albedo[2] += a * double(rho.b);
    reflected[0] += a * double(b.r), reflected[1] += a * double(b.g),
        reflected[2] += a * double(b.b);
    arrived[0] += a * double(indirect.r), arrived[1] += a * double(indirect.g),
        arrived[2] += a * double(indirect.b);
  }
  if (!(area > 0)) return light;
  float missing[3];
  for (int c = 0; c < 3; ++c)
    missing[c] =
        float(std::max(0.0, reflected[c] / area / (1 - albedo[c] / area) - arrived[c] / area));
  std::vector<math::Rgb>& indirect = light.indirect.detach();
  for (math::Rgb& e : indirect) e += math::Rgb{missing[0], missing[1], missing[2]};
  return light;
}

}  // namespace kiln::solver::radiosity_map
