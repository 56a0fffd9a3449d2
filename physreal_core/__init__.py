"""PhysReal's core library: simulation, rendering, perception, geometry, fitting and evaluation on arrays, never on paths."""
