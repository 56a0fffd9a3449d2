"""The step for many rollouts at once as fused Warp kernels in CUDA graphs, held to the plain form by the tests."""
