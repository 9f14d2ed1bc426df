#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "baker/solver/links/link_tree.h"
#include "baker/solver/pairwise/parts.h"
#include "baker/solver/pairwise/transport_pass.h"

namespace kiln::solver::links {

/// Holds the light that the members of the tree send in one bounce.
struct LinkLight {
  std::vector<math::Rgb> texels, groups;  ///< B, lx; a group's is the mean by area
  float most_error = 0;                   ///< lx: what a link may be off by
};

/// A link may bring so many times its error, however alike its samples are: what lies between two
/// large groups can be missed by sixteen rays.
inline constexpr float kMostLight = 8;

/// Finds the links of receivers and gathers the light that comes over them, for the texels of one
/// range. Light is a pure function of the receiver, so no range changes what a texel gets.
class LinkGatherer {
 public:
  /// All outlive this.
  LinkGatherer(const pairwise::Parts&, const LinkTree&, const LinkLight&, atlas::TexelRange);

  /// Gathers the light of all texels of the range. Call it once.
  void gather();
  math::Rgb light(std::uint32_t texel) const { return sums_[texel - range_.begin]; }
  std::uint64_t rays() const { return rays_; }

 private:
  using Id = LinkTree::Id;
  /// Holds what sixteen pairs of texels of two members tell. Each quarter of the receiver and each
  /// quarter of the sender are a pair.
  struct Look {
    float factor[4] = {};   ///< F of each quarter of the receiver
    float at_receiver = 0;  ///< lx: by how much the light of a quarter differs within it, about
    float at_sender = 0;    ///< lx: the standard error of the light of a quarter
    bool is_large = false;  ///< the link brings too much light for sixteen rays
    bool is_dark = true;    ///< all pairs turn away from each other
  };
  /// Holds what one texel of the range has got so far.
  struct Received {
    pairwise::Sum light;                ///< over links to groups
    std::vector<Id> groups;             ///< where that comes from
    std::vector<std::uint32_t> texels;  ///< single texels that it is linked to
  };

  void refine(Id receiver, Id sender);
  void split(Id receiver, Id sender, bool at_sender);
  bool sender_is_larger(Id receiver, Id sender) const;
  void link(Id receiver, Id sender, const Look&);
  void link_texels(Id receiver, Id sender);
  void settle(std::uint32_t texel);
  bool sees_any(std::uint32_t texel);
  Look look(Id receiver, Id sender);
  bool may_face(const LinkTree::Bounds&, const LinkTree::Bounds&) const;
  bool may_matter(const LinkTree::Bounds& receiver, const LinkTree::Bounds& sender,
                  math::Rgb light) const;

  LinkTree::Bounds bounds(Id) const;
  math::Rgb radiosity(Id) const;
  std::uint32_t size(Id) const;
  std::uint32_t sample(Id, std::uint32_t k, std::uint32_t key) const;
  std::uint32_t texel(Id, std::uint32_t i) const;
  bool is_inside(std::uint32_t texel) const { return texel >= range_.begin && texel < range_.end; }
  bool is_wanted(Id receiver) const;

  const pairwise::Parts& parts_;
  const LinkTree& tree_;
  const LinkLight& light_;
  const atlas::TexelRange range_;
  const float scale_;
  const std::uint32_t seed_;
  std::vector<Received> received_;  ///< of the texels of the receiver under way
  std::vector<math::Rgb> sums_;     ///< light of the texels that are done
  std::uint64_t rays_ = 0;
};

}  // namespace kiln::solver::links
