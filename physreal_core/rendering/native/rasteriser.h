// The rasteriser on the CPU in phases; a phase that takes a thread's number runs on all threads at once, list_tiles on one.
#pragma once

#include "compositing.h"
#include "gaussians.h"
#include "tiles.h"
