#pragma once

#include "baker/output/lit/document.h"

namespace kiln::output::lit {

/// Takes the lights of KHR_lights_punctual off the nodes of the scene that was baked, so that no
/// viewer adds their light to that of the pages. The nodes stay. Where no other node has a light
/// the document's list of them goes too, and so do animations (KHR_animation_pointer) of what is
/// gone.
void drop_baked_lights(Json& document);

}  // namespace kiln::output::lit
