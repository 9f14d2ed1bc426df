#pragma once

#include <cstdint>
#include <string>

/// The generated scenes, one function each. Internal to this folder.
namespace kiln::generate {

/// Returns the bytes of a .glb. `detail` is never 0 here.
using SceneFunction = std::string (*)(const std::string& name, std::uint32_t detail);

std::string cornell(const std::string& name, std::uint32_t detail);
std::string cornell_shelves(const std::string& name, std::uint32_t detail);
std::string bumpy_ball(const std::string& name, std::uint32_t detail);
std::string cornell_30(const std::string& name, std::uint32_t detail);
std::string cornell_lucy(const std::string& name, std::uint32_t detail);
std::string cornell_geom(const std::string& name, std::uint32_t detail);
std::string cornell_layers(const std::string& name, std::uint32_t detail);
std::string spheres_and_cube(const std::string& name, std::uint32_t detail);

std::string small_lights(const std::string& name, std::uint32_t detail);
std::string octagon_textured(const std::string& name, std::uint32_t detail);
std::string atrium(const std::string& name, std::uint32_t detail);
std::string toys(const std::string& name, std::uint32_t detail);
std::string teddy(const std::string& name, std::uint32_t detail);
std::string jeep(const std::string& name, std::uint32_t detail);

std::string room_textured(const std::string& name, std::uint32_t detail);
std::string many_lights(const std::string& name, std::uint32_t detail);

std::string furnace_50(const std::string& name, std::uint32_t detail);
std::string furnace_90(const std::string& name, std::uint32_t detail);
std::string plates(const std::string& name, std::uint32_t detail);
std::string plates_perpendicular(const std::string& name, std::uint32_t detail);
std::string rect_light(const std::string& name, std::uint32_t detail);
std::string color_box(const std::string& name, std::uint32_t detail);
std::string sealed(const std::string& name, std::uint32_t detail);

std::string plane_point(const std::string& name, std::uint32_t detail);
std::string plane_spot(const std::string& name, std::uint32_t detail);
std::string plane_sun(const std::string& name, std::uint32_t detail);
std::string tilted_plane(const std::string& name, std::uint32_t detail);
std::string sphere_on_plane(const std::string& name, std::uint32_t detail);
std::string courtyard(const std::string& name, std::uint32_t detail);

}  // namespace kiln::generate
