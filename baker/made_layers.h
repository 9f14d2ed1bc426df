#pragma once

#include <map>
#include <stop_token>
#include <string>

#include "baker/output/output.h"
#include "baker/prepare.h"
#include "baker/solve.h"
#include "proto/bake_settings.h"
#include "proto/expected.h"

namespace kiln::baker {

/// Makes the values of those layers of the settings that need more than pages do: what methods
/// choose their senders by (`mip`, `tree`, `senders`), the voxels that stand for surfaces
/// (`voxels`), and the reference of the report (`error`, which is 0 where there is none, or none of
/// its light). The first two are of the light as it is shown, `senders` is of the direct light. The
/// values read the texels of the bake, which outlive them. Errors: those of the reference,
/// `canceled` within a second.
proto::Expected<std::map<std::string, output::TexelValue>> make_layers(const PreparedBake&,
                                                                       const proto::BakeSettings&,
                                                                       const Solution&,
                                                                       const output::Reference&,
                                                                       const std::stop_token&);

/// The memory of all these layers, for the preflight. Bytes.
struct LayerMemory {
  double kept = 0;    ///< until the files are written
  double making = 0;  ///< more than that while they are made; a page of the reference left out
};
LayerMemory layer_memory(const proto::BakeSettings&, double texels);

}  // namespace kiln::baker
