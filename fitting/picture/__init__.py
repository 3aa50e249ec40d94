"""Ways to predict the pixels of a picture from the parameters of a material: one interface, one file each.

A picture is predicted twice, from independent halves of its samples: with the same samples in a residual and in its
derivative, a least-squares fit converges to the wrong point.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Picture(Protocol):
    """Predicts some pixels of one camera's picture as a differentiable function of what is placed in the scene.

    Attributes
    ----------
    pixels : int array, shape (n,)
        Flat indices (row-major) of the pixels predicted.
    samples : int
        Samples a pixel in each half.
    """

    pixels: npt.NDArray[np.int64]
    samples: int

    def predict(self, reverse: bool = False) -> Iterator[Any]:
        """``mi.Color3f`` arrays that `fold` makes pixels of; `reverse` says which way they will be differentiated.

        Each is made of the values that the scene has when it is asked for.

        The sums are left to `fold` because each would end a kernel: a prediction and all its derivatives are to be
        computed in one.
        """
        ...

    def fold(self, parts: Sequence[Any]) -> tuple[Array, Array]:
        """Linear RGB of the pixels from each half, shape (3, n), from evaluated arrays like those of `predict`.

        They may be values or derivatives.
        """
        ...

    def unfold(self, halves: tuple[Array, Array]) -> list[Any]:
        """The transpose of `fold`."""
        ...
