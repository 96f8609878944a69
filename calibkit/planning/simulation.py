"""What all simulations of planned campaigns have in common."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from calibkit.simulate.campaign import Campaign

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping

    import numpy as np
    from numpy.typing import NDArray

    from calibkit.arrays import Array
    from calibkit.fit.shared import Shared


def draw(
    rng: np.random.Generator, shared: Iterable[Shared], sizes: Mapping[tuple[str, str], float]
) -> list[tuple[Shared, Array]]:
    """Errors [levels, k] of each shared error, of its size by (group, effect), or 0."""
    return [
        (
            error,
            rng.normal(0.0, 1.0, (error.levels, error.width))
            * sizes.get((error.group, error.effect), 0.0),
        )
        for error in shared
    ]


def as_planned(
    document: Mapping[str, Any],
    seed: int,
    logs: Mapping[str, Mapping[str, NDArray[Any]]],
    decimals: Mapping[str, int],
    truth: Mapping[str, Any],
) -> Campaign:
    """Logs of a campaign that was run by the document of a plan, and their truth."""
    return Campaign(logs, decimals, {**truth, "seed": seed, "plan": document["sha256"]})
