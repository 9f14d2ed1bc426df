#pragma once

#include <gtest/gtest.h>

#include <cctype>
#include <string>
#include <vector>

#include "baker/methods.h"

namespace kiln::solver {

/// The methods of the registry, and their names in those of tests: "Gather", "Path", and so on.
inline std::vector<proto::Method> all_methods() {
  std::vector<proto::Method> all;
  for (const baker::Method& method : baker::methods()) all.push_back(method.id);
  return all;
}
inline std::string method_name(const testing::TestParamInfo<proto::Method>& method) {
  std::string name = proto::to_string(method.param);
  name[0] = char(std::toupper(name[0]));
  return name;
}

}  // namespace kiln::solver
