// The rasteriser on the CPU in phases; a phase that takes a thread's number runs on all threads at once.
#pragma once

#include "compositing.h"
#include "projection.h"
#include "tiles.h"

namespace physreal {

template <class S> void list_tiles(const Scene<S>& s, int) { list_tiles(s); }

}  // namespace physreal
