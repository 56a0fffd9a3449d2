"""The twin as a MuJoCo model: a flex with the fitted material, a table, and a mocap body that holds what the hand held."""

from applications.export.mjcf.document import write

__all__ = ["write"]
