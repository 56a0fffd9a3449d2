// The rasteriser on the CPU in phases, each run on all threads at once, but list_tiles on one.
#pragma once

#include "compositing.h"
#include "gaussians.h"
#include "tiles.h"
