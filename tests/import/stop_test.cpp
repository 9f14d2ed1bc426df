// A stop request is seen within a second, wherever the import is.
#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <array>
#include <cmath>

#include "baker/exec/stop.h"
#include "baker/files/flat_file.h"
#include "proto/files.h"
#include "tests/import/import_helpers.h"
#include "tests/support/sanitizer.h"
#include "tests/support/stop_timing.h"

namespace kiln::import {
namespace {

constexpr std::uint32_t kCells = test::kSlowdown > 1 ? 300 : 1000;  // two triangles each

/// Hills of kCells x kCells cells.
struct Hills {
  std::vector<float> positions, normals, uvs;
  std::vector<std::uint32_t> indices;

  Hills() {
    const std::uint32_t row = kCells + 1;
    for (std::uint32_t z = 0; z < row; ++z) {
      for (std::uint32_t x = 0; x < row; ++x) {
        const float u = float(x) / float(kCells), v = float(z) / float(kCells);
        const float height = 2 * std::sin(9 * u) * std::cos(7 * v);
        positions.insert(positions.end(), {20 * u, height, 20 * v});
        normals.insert(normals.end(), {0, 1, 0});
        uvs.insert(uvs.end(), {u, v});
      }
    }
    for (std::uint32_t z = 0; z < kCells; ++z) {
      for (std::uint32_t x = 0; x < kCells; ++x) {
        const std::uint32_t a = z * row + x, b = a + 1, c = a + row;
        indices.insert(indices.end(), {a, c, b, b, c, c + 1});
      }
    }
  }
};

enum class Shading { kSmooth, kFlat };

std::string hills(Shading shading) {
  const Hills h;
  GltfBuilder b;
  nlohmann::json attributes = {{"POSITION", b.accessor(h.positions, 3)}};
  if (shading == Shading::kSmooth) {
    attributes["NORMAL"] = b.accessor(h.normals, 3);
    attributes["TEXCOORD_0"] = attributes["TEXCOORD_1"] = b.accessor(h.uvs, 2);
  }
  const int indices = b.accessor(h.indices, 1);
  b.node({{"mesh", b.mesh({{"attributes", attributes}, {"indices", indices}})}});
  return b.glb();
}

/// A document of about 20 MB, all JSON.
std::string many_nodes() {
  GltfBuilder b = test::triangle_builder();
  for (int i = 1; i < 250'000 / test::kSlowdown; ++i)
    b.node({{"mesh", 0}, {"translation", {0.125 * i, 0.5, 1}}, {"rotation", {0, 0, 0, 1}}});
  return b.gltf();
}

void expect_quick_stops_of_import(const std::string& bytes) {
  const Upload upload(bytes);
  test::expect_quick_stops(
      [&](std::stop_token stop) { return import_scene(upload.files, dark(), {}, stop); });
  test::expect_quick_stops(
      [&](std::stop_token stop) { return check_scene(upload.files, dark(), {}, stop); });
}

TEST(Stop, TwoMillionTrianglesWithNormals) {
  expect_quick_stops_of_import(hills(Shading::kSmooth));
}

TEST(Stop, TwoMillionTrianglesWithoutNormals) {
  expect_quick_stops_of_import(hills(Shading::kFlat));
}

TEST(Stop, ALargeDocument) {
  expect_quick_stops_of_import(many_nodes());
}

/// Whether a stop ever leaves `fill` with a part of what it takes without: fill(stop) gives how
/// many elements are there.
template <class Fill>
bool is_heard_midway(Fill fill) {
  constexpr int kTries = 100;
  const auto start = test::StopClock::now();
  const std::size_t all = fill(std::stop_token());
  const auto whole = test::StopClock::now() - start;
  for (int i = 0; i < kTries; ++i) {
    std::stop_source source;
    std::jthread stopper([&] {
      std::this_thread::sleep_for(whole * i / kTries);
      source.request_stop();
    });
    const std::size_t there = fill(source.get_token());
    if (there > 0 && there < all) return true;
  }
  return false;
}

// A sky map of 2^28 pixels has 3 GiB: making room for it takes as long as its memory is written.
TEST(Stop, GrowingALargeVector) {
  constexpr std::size_t kCount = std::size_t(48) << 20;
  std::vector<char> few{1, 2};
  EXPECT_TRUE(exec::grow_unless_stopped(few, 5, {}));
  EXPECT_EQ(few, (std::vector<char>{1, 2, 0, 0, 0}));
  std::vector<char> many;
  EXPECT_TRUE(exec::grow_unless_stopped(many, kCount + 1, {}));
  EXPECT_EQ(many.size(), kCount + 1);
  EXPECT_TRUE(is_heard_midway([&](const std::stop_token& stop) {
    std::vector<char> values;
    exec::grow_unless_stopped(values, kCount, stop);
    return values.size();
  }));
}

TEST(Stop, CopyingALargeArrayOfAFile) {
  const files::FlatHeader header{files::FlatKind::kScene, 1, std::string(64, 'k')};
  std::vector<math::Rgb> numbers(4'000'001);
  for (std::size_t i = 0; i < numbers.size(); ++i) numbers[i].g = float(i);
  const std::array<files::FlatSection, 2> sections{files::FlatSection{1, "1"},
                                                   files::flat_section(numbers)};
  const proto::Fd fd(::memfd_create("flat", MFD_CLOEXEC));
  ASSERT_TRUE(write_flat(fd.get(), header, sections));
  std::string bytes(std::size_t(::lseek(fd.get(), 0, SEEK_END)), '\0');
  ASSERT_EQ(::pread(fd.get(), bytes.data(), bytes.size(), 0), ssize_t(bytes.size()));
  const std::array<std::uint32_t, 2> sizes{1, sizeof(math::Rgb)};
  const auto file = files::FlatFile::open(bytes, header, sizes);
  ASSERT_TRUE(file) << file.error().message;
  EXPECT_TRUE(file->records<math::Rgb>(1) == numbers);
  EXPECT_TRUE(is_heard_midway([&](const std::stop_token& stop) {
    std::vector<math::Rgb> values;
    file->copy_records(1, values, stop);
    return values.size();
  }));
}

}  // namespace
}  // namespace kiln::import
