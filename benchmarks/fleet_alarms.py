"""How often is somebody named in a faultless fleet? Print the table of rates a key figure.

python benchmarks/fleet_alarms.py [--fleets 1000]
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

import numpy as np

from calibkit.numeric.control import Control

if TYPE_CHECKING:
    from collections.abc import Callable

    from numpy.typing import NDArray

    Array = NDArray[np.float64]
    Fleet = tuple[Array, Array, Array]


def known(values: Array, uncertainties: Array) -> Fleet:
    """Values of a fleet with known uncertainties."""
    return values, uncertainties, np.full(values.size, np.inf)


def stated(normal: Array, uncertainty: Array, dof: float, rng: np.random.Generator) -> Fleet:
    """Values with uncertainties that are estimated with some degrees of freedom."""
    size = uncertainty * np.sqrt(rng.chisquare(dof, normal.size) / dof)
    return uncertainty * normal, size, np.full(normal.size, dof)


def unequal(normal: Array, rng: np.random.Generator, between: float) -> Fleet:
    """Values whose uncertainties differ, of devices that differ."""
    sizes = np.exp(0.7 * rng.standard_normal(normal.size))
    return known(sizes * normal + between * rng.standard_normal(normal.size), sizes)


def long_and_short(normal: Array, rng: np.random.Generator) -> Fleet:
    """Values of which one in twenty has ten times the uncertainty."""
    sizes = np.where(rng.random(normal.size) < 0.05, 10.0, 1.0)
    return known(sizes * normal, sizes)


KINDS: dict[str, Callable[[Array, np.random.Generator], Fleet]] = {
    "no uncertainty stated": lambda normal, _: known(normal, np.zeros(normal.size)),
    "equal uncertainties, devices differ": lambda normal, _: known(
        2.0 * normal, np.ones(normal.size)
    ),
    "uncertainties differ by a factor 2": lambda normal, rng: unequal(normal, rng, 0.0),
    "the same, and devices differ": lambda normal, rng: unequal(normal, rng, 1.0),
    "one in twenty has ten times the uncertainty": long_and_short,
    "6 degrees of freedom": lambda normal, rng: stated(normal, np.ones(normal.size), 6.0, rng),
    "residual of 30 rows": lambda normal, rng: known(
        np.sqrt(rng.chisquare(26.0, normal.size)), np.zeros(normal.size)
    ),
    "noise that differs by 30 %": lambda normal, _: known(
        np.exp(0.3 * normal), np.zeros(normal.size)
    ),
    "absolute value": lambda normal, _: known(np.abs(normal), np.zeros(normal.size)),
}


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--fleets", type=int, default=1000)
    fleets = parser.parse_args().fleets
    sizes = (20, 100, 1000)
    print("| figure | " + " | ".join(f"{size} units" for size in sizes) + " |")
    print("|---|" + "---|" * len(sizes))
    for name, draw in KINDS.items():
        rates = []
        for size in sizes:
            rng = np.random.default_rng(size)
            named = sum(
                bool(Control.chart(*draw(rng.standard_normal(size), rng)).outliers)
                for _ in range(fleets)
            )
            rates.append(f"{100.0 * named / fleets:.1f} %")
        print(f"| {name} | " + " | ".join(rates) + " |", flush=True)


if __name__ == "__main__":
    main()
