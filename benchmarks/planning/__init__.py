"""Plans for a fitted body, executed in the rig's MuJoCo: `python -m benchmarks.planning`."""
