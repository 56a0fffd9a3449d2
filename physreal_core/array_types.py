"""Array annotations of the core: jaxtyping where it is installed, plain `Any` where it is not (a bare GPU machine).

Use: `from physreal_core.array_types import Array, Bool, Float, Int, Tensor` and write `Float[Tensor, "particles 3"]`.
"""

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from torch import Tensor

Array = np.ndarray

try:
    from jaxtyping import Bool, Float, Int, UInt8
except ImportError:

    class _Unchecked:
        """Stands for a jaxtyping dtype: subscripting it gives `Any`, so nothing is checked."""

        def __class_getitem__(cls, _: object) -> Any:
            return Any

    Bool = Float = Int = UInt8 = _Unchecked

__all__ = ["Array", "Bool", "Float", "Int", "Tensor", "UInt8"]


def __getattr__(name: str) -> Any:
    """torch's `Tensor`, on first use: who annotates numpy arrays alone shall not wait for torch."""
    if name != "Tensor":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from torch import Tensor

    return Tensor
