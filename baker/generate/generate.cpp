#include "baker/generate/generate.h"

#include <array>
#include <iterator>

#include "baker/generate/scenes.h"

namespace kiln::generate {
namespace {

struct Generator {
  GeneratorInfo info;
  SceneFunction function;
  std::uint32_t detail;                    ///< default
  std::uint32_t most_detail = kMaxDetail;  ///< a ball of this has 13 million triangles
};

constexpr std::array kGenerators{
    Generator{{"cornell", "Cornell box of 5.5 m with two blocks and a ceiling lamp"}, cornell, 1},
    Generator{
        {"cornell_shelves", "Cornell box with four shelves that hide the lamp from the floor"},
        cornell_shelves,
        1},
    Generator{
        {"bumpy_ball",
         "Cornell box with a bumpy ball on a plinth; 12 detail^2 triangles, detail 91 = 99,372"},
        bumpy_ball,
        91},
    Generator{{"cornell_30", "Cornell box of exactly 30 triangles, lamp included (radiosity maps)"},
              cornell_30,
              1},
    Generator{{"cornell_lucy",
               "Cornell box with a winged statue under a large lamp (RTRad); the statue has 1,072 "
               "detail^2 triangles, detail 10 = 107,200"},
              cornell_lucy,
              10,
              32},
    Generator{{"cornell_geom", "Cornell box with simple shapes under a narrow lamp (RTRad)"},
              cornell_geom,
              1},
    Generator{{"cornell_layers",
               "Cornell box split by a wedge (RTRad), 60 triangles; no light reaches 'dark half'"},
              cornell_layers,
              1},
    Generator{{"spheres_and_cube",
               "open box with two spheres and a cube, 478 triangles (radiosity maps); give it "
               "sky.radiance [0.5, 0.8, 0.5], greenish"},
              spheres_and_cube,
              1},
    Generator{{"toys", "bear, bricks, balls and rings in a corner (radiosity maps)"}, toys, 1},
    Generator{{"teddy",
               "bear with a bottle (radiosity maps); give it sky.radiance [0.3, 0.5, 1.2], blue"},
              teddy,
              1},
    Generator{{"jeep",
               "open car on sand (radiosity maps); give it sky.radiance [1.0, 0.8, 0.6], of dusk"},
              jeep,
              1},
    Generator{{"small_lights", "furnished room under ten lamps of 8 cm (RTRad, GPU Gems 2)"},
              small_lights,
              1},
    Generator{{"octagon_textured",
               "octagonal hall, all in textures, with colored lamps and a serpent (RTRad)"},
              octagon_textured,
              1},
    Generator{
        {"atrium",
         "sunlit court with two storeys of arcades, no textures (in place of Sponza); give it "
         "sky.radiance [3000, 4000, 6000]"},
        atrium,
        1},
    Generator{{"room_textured", "closed room with image textures and a picture that glows"},
              room_textured,
              1},
    Generator{
        {"many_lights", "closed hall with 200 small emitters of many colors"}, many_lights, 1},
    Generator{{"courtyard", "sunlit yard with pillars, a textured floor, a point and a spot light"},
              courtyard,
              1},
    Generator{{"sphere_on_plane", "smooth ball on a plate; has no light: give it sky.radiance"},
              sphere_on_plane,
              24},
    Generator{{"tilted_plane", "1 m square, normal (0, 0.8, 0.6); no light: give it sky.radiance"},
              tilted_plane,
              1},
    Generator{{"plane_point", "4 m square, a point light of 100 cd 1 m above its middle"},
              plane_point,
              1},
    Generator{
        {"plane_spot", "4 m square, a spot light of 100 cd 2 m above its middle"}, plane_spot, 1},
    Generator{{"plane_sun", "4 m square under a directional light of 1,000 lx, 4/5 of it upright"},
              plane_sun,
              1},
    Generator{{"rect_light", "4 m square, a lamp of 1 m x 1 m and 10 cd/m2 1 m above, facing down"},
              rect_light,
              1},
    Generator{{"furnace", "closed box, albedo 0.5, every face emits 1 cd/m2: B = 2 pi everywhere"},
              furnace_50,
              1},
    Generator{{"furnace_50", "the same as furnace"}, furnace_50, 1},
    Generator{{"furnace_90", "closed box, albedo 0.9, every face emits 1 cd/m2: B = 10 pi"},
              furnace_90,
              1},
    Generator{{"plates", "two unit squares 1 m apart; the upper one emits 1 cd/m2, F = 0.1998"},
              plates,
              1},
    Generator{{"plates_perpendicular", "two unit squares that share an edge, F = 0.2000"},
              plates_perpendicular,
              1},
    Generator{{"colour_box", "closed box with colored walls and a lamp: for the balance of energy"},
              color_box,
              1},
    Generator{
        {"sealed", "lit from outside, dark inside: the node 'inside' must stay zero"}, sealed, 1},
};

}  // namespace

std::vector<GeneratorInfo> generators() {
  std::vector<GeneratorInfo> infos;
  infos.reserve(std::size(kGenerators));
  for (const Generator& g : kGenerators) infos.push_back(g.info);
  return infos;
}

proto::Expected<std::string> generate_glb(std::string_view name, std::uint32_t detail) {
  std::string names;
  for (const Generator& g : kGenerators) {
    if (g.info.name == name) {
      if (detail > g.most_detail)
        return proto::fail("invalid_detail", "detail is " + std::to_string(detail) + "; at most " +
                                                 std::to_string(g.most_detail));
      return g.function(std::string(name), detail == 0 ? g.detail : detail);
    }
    if (!names.empty()) names += ", ";
    names += g.info.name;
  }
  return proto::fail("unknown_generator", "No generated scene is called '" + std::string(name) +
                                              "'; there are: " + names + ".");
}

}  // namespace kiln::generate
