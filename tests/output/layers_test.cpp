// The registry of layers is what the settings offer.
#include "baker/output/layers.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "proto/json.h"

namespace kiln::output {
namespace {

TEST(Layers, AreThoseOfTheSettings) {
  const auto offered =
      proto::settings_schema().at("/properties/output/properties/layers/items/enum"_json_pointer);
  ASSERT_EQ(offered.size(), layers().size());
  for (std::size_t i = 0; i < layers().size(); ++i) {
    EXPECT_EQ(offered[i], layers()[i].name);
    EXPECT_EQ(find_layer(layers()[i].name), &layers()[i]);
  }
  EXPECT_EQ(find_layer("normals"), nullptr);
}

}  // namespace
}  // namespace kiln::output
