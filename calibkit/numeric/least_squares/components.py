"""Errors that rows of a plan share, of known size."""

from dataclasses import dataclass

from calibkit.arrays import Array, Integers, Mask


@dataclass(frozen=True, slots=True)
class Known:
    """A standard deviation that is stated, or pooled from earlier runs."""

    value: float
    """[unit of the indication, or per unit of the loading]."""
    dof: float = float("inf")
    """Degrees of freedom of the value; infinite where it is taken as exact."""
    bound: bool = False
    """Whether the value is merely larger than the error can be: then it is no result."""


@dataclass(frozen=True, slots=True)
class Effect:
    """An error that all rows of a level share, as a random effect."""

    group: str
    """What the rows of a level have in common: "soak", "run", "attitude"."""
    effect: str
    """What differs from level to level: "zero", "scale", "index"."""
    labels: Integers
    """[n], level of each row, from 0; −1 for a row that has none."""
    loading: Array
    """[n] or [n, k], derivative of the indication by the effect; k effects of one variance."""
    known: Known | None = None

    @property
    def width(self) -> int:
        """Effects of one level."""
        return 1 if self.loading.ndim == 1 else self.loading.shape[1]

    def of_rows(self, rows: Mask) -> "Effect":
        """The effect on some of the rows [n]."""
        return Effect(self.group, self.effect, self.labels[rows], self.loading[rows], self.known)

    def divided_by(self, noise: Array) -> "Effect":
        """The effect on rows in units of their noise [n]."""
        loading = (self.loading.T / noise).T
        return Effect(self.group, self.effect, self.labels, loading, self.known)
