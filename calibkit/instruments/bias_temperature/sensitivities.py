"""How the polynomials of a bias move with errors of their abscissa and of the indication: exact, as
a polynomial whose abscissa is shifted or stretched is one of the same order.
"""

from collections.abc import Iterable

import numpy as np

from calibkit.coefficients import StageResult
from calibkit.sensitivities import Sensitivity


def find(result: StageResult) -> tuple[Sensitivity, ...]:
    """Sensitivities of every coefficient to an offset, a scale and a span of the abscissa, and to
    an offset and a scale of the channel's own indication.
    """
    found = []
    for model in result.models:
        ((abscissa, (low, high)),) = model.valid.items()
        p = np.array([c.value for c in model.coefficients])
        slope = np.append(p[1:] * np.arange(1, p.size), 0.0)
        stretched = p * np.arange(p.size)
        middle, half = (high + low) / 2.0, (high - low) / 2.0 or 1.0
        names = [f"{result.stage}.{model.name}.{c.name}" for c in model.coefficients]

        def named(derivatives: Iterable[float], names: list[str] = names) -> dict[str, float]:
            pairs = zip(names, map(float, derivatives), strict=True)
            return {name: value for name, value in pairs if value}

        found += [
            Sensitivity(abscissa, "offset", named(-slope)),
            Sensitivity(abscissa, "scale", named(-stretched)),
            Sensitivity(abscissa, "span", named((middle * slope - stretched) / half)),
            Sensitivity(model.name, "offset", named(np.eye(p.size)[0])),
            Sensitivity(model.name, "scale", named(p)),
        ]
    return tuple(found)
