"""Simulators that run the benchmark's scene, one adapter a file.

Each module has `missing(**options)`, a line that says why it cannot run here or None, and `make(scene, device, threads,
**options)`, an object with `forward()`, `positions()` and, where it is differentiable, `forward_backward()` and
`gradients()`. Packages that are not among the project's own are imported when they are asked for.

Most peers are MLS-MPM: their grid stays in space, and stress and F go through APIC's C. Our grid stays in the body at rest, and
its nodes keep their velocities (docs/simulation.md). A particle has 27 nodes in all of them.
"""
