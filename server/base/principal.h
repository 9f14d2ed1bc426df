#pragma once

#include <string>

namespace kiln::base {

/// The sender of a request, and what it may do.
struct Principal {
  std::string tenant;  ///< "" for a service without tokens, whose clients are all alike
  bool read = false, write = false;
  bool admin = false;   ///< everything, with every tenant's jobs
  std::string token{};  ///< its id; "" for a service without tokens

  bool may_see(const std::string& owner) const { return admin || tenant == owner; }
  static Principal anonymous() { return {"", true, true, true, ""}; }
};

}  // namespace kiln::base
