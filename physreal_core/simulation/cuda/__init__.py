"""The step for many rollouts at once as fused kernels in CUDA graphs, C++ that Warp compiles."""

from physreal_core.simulation.cuda.stepper import CudaStepper

__all__ = ["CudaStepper"]
