"""Arrays with their shapes in signatures: `Float[Array, "n 3"]`, and one axis as `Int[Array, " n"]`.

An axis of the same name has the same length in all arguments of a call and in what it returns; the tests check that.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

__all__ = ["Array", "Bool", "Float", "Int"]

Array = np.ndarray
