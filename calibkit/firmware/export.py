"""All that a target needs to know of one run: its chain in a number format, its identity, error
bounds and test vectors.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from calibkit.firmware import bounds, identifiers, program, vectors
from calibkit.firmware.chain import Chain, Structure
from calibkit.firmware.formats import Format
from calibkit.firmware.program import Program
from calibkit.firmware.vectors import Vectors

SCHEMA = "calibkit-firmware/1"


@dataclass(frozen=True, slots=True)
class Identity:
    """Whose coefficients these are and what they were made from and with."""

    serial: str
    revision: int
    effective_from: str
    run_sha256: str
    """Digest of run.json."""
    files: Mapping[str, str]
    """Coefficient file → the digest that it states of itself."""
    software: str
    accepted: bool
    title: str = ""


@dataclass(frozen=True, slots=True)
class Export:
    """One run, ready to be written for a target."""

    prefix: str
    identity: Identity
    chain: Chain
    program: Program
    bounds: Mapping[str, float]
    """Worst-case evaluation error of each output in its unit; of a recursive chain that of one
    update.
    """
    vectors: Vectors
    sources: tuple[str, ...] = ()
    """What the inputs and indications were made of in calibration, one per line."""

    @property
    def structure(self) -> Structure:
        """What the chain does."""
        return self.chain.structure


def prepare(
    chain: Chain, identity: Identity, number: Format, prefix: str, sources: tuple[str, ...] = ()
) -> Export:
    """Quantise a chain, bound its error and work out its self-test."""
    identifiers.check_prefix(prefix)
    quantised = program.quantise(chain, number)
    return Export(
        prefix,
        identity,
        chain,
        quantised,
        bounds.find_bounds(chain, quantised),
        vectors.make_vectors(chain, quantised),
        sources,
    )
