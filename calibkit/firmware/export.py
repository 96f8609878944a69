"""All that a target needs to know of one run: its chain in a number format, its identity, error
bounds and test vectors.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass

from calibkit.errors import CoefficientError, UsageError
from calibkit.firmware import bounds, vectors
from calibkit.firmware.chain import Chain, Program, Structure
from calibkit.firmware.formats import Format
from calibkit.firmware.vectors import Vectors
from calibkit.records import names
from calibkit.records.run_document import Verdict

SCHEMA = "calibkit-firmware/1"
C_WORDS = (
    "auto break case char const continue default do double else enum extern float for goto if"
    " inline int long register restrict return short signed sizeof static struct switch typedef"
    " union unsigned void volatile while asm typeof bool true false nullptr constexpr thread_local"
    " alignas alignof static_assert"
)
CPP_WORDS = (
    "and and_eq bitand bitor catch char8_t char16_t char32_t class co_await co_return co_yield"
    " compl concept consteval constinit const_cast decltype delete dynamic_cast explicit export"
    " false friend mutable namespace new noexcept not not_eq operator or or_eq private protected"
    " public reinterpret_cast requires static_cast template this throw try typeid typename using"
    " virtual wchar_t xor xor_eq final override import module"
)
LIBRARY = (
    "main errno assert abort exit malloc free memcpy memset printf std int8 int16 int32 int64 uint8"
    " uint16 uint32 uint64"
)
HEADERS = (
    "complex ctype fenv inttypes iso646 limits locale math setjmp signal stdalign stdarg stdatomic"
    " stdbit stdbool stdckdint stddef stdint stdio stdlib stdnoreturn string tgmath threads time"
    " uchar wchar wctype aio cpio dirent dlfcn fcntl fmtmsg fnmatch ftw glob grp iconv langinfo"
    " libgen monetary mqueue ndbm netdb nl_types poll pthread pwd regex sched search semaphore"
    " spawn strings stropts syslog tar termios ulimit unistd utime utmpx wordexp alloca byteswap"
    " endian features malloc memory"
)
"""Headers of C99 to C23 and POSIX (and those every libc adds): <prefix>.h would be found in their
place.
"""
LONGEST = 20
"""Characters of a prefix: C99 tells external names apart by their first 31, and `_selftest`
follows.
"""


@dataclass(frozen=True, slots=True)
class RunIdentity:
    """Device and revision, the files that the export is made from, and the software."""

    serial: str
    revision: int
    effective_from: str
    run_sha256: str
    """Digest of run.json."""
    files: Mapping[str, str]
    """Coefficient file → the digest that it states of itself."""
    software: str
    verdict: Verdict


@dataclass(frozen=True, slots=True)
class FirmwareRun:
    """One run, ready to be written for a target."""

    prefix: str
    identity: RunIdentity
    chain: Chain
    program: Program
    bounds: Mapping[str, float]
    """Worst-case evaluation error of each output in its unit; of a recursive chain that of one
    update.
    """
    full_bounds: Mapping[str, float]
    """The same up to the full scale of the indications."""
    vectors: Vectors
    sources: tuple[str, ...] = ()
    """What the inputs and indications were made of in calibration, one per line."""

    @property
    def structure(self) -> Structure:
        """What the chain does."""
        return self.chain.structure


def prepare(
    chain: Chain, identity: RunIdentity, number: Format, prefix: str, sources: tuple[str, ...] = ()
) -> FirmwareRun:
    """Quantise a chain, bound its error and work out its self-test. CoefficientError where a name
    of the chain, made of that of a model, is none in C.
    """
    _check_prefix(prefix)
    structure = chain.structure
    identifiers = [entry.name for entry in structure.inputs]
    identifiers += [step.name for step in structure.steps]
    identifiers += [output.name for output in structure.outputs]
    for name in (*identifiers, *structure.tables):
        if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
            raise CoefficientError(
                f"'{name}' is no name that C allows: a model or a column is called so",
                hint="no fit writes it; do not use the run",
            )
    quantised = chain.quantise(number)
    bound, full = (bounds.find_bounds(chain, quantised, full=full) for full in (False, True))
    tests = vectors.Vectors.make(chain, quantised, bound)
    return FirmwareRun(prefix, identity, chain, quantised, bound, full, tests, sources)


def _check_prefix(prefix: str) -> None:
    """UsageError for a prefix under which some generated name is not legal in C and C++."""
    if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", prefix) or "__" in prefix or prefix.endswith("_"):
        raise UsageError(
            f"--prefix '{prefix}' is no name that C and C++ both allow",
            hint="use letters, digits and single underscores, starting with a letter",
        )
    if names.is_device(prefix):
        raise UsageError(
            f"--prefix '{prefix}' is a device's name on Windows, where no {prefix}.h can be",
            hint="give another name",
        )
    if len(prefix) > LONGEST:
        raise UsageError(
            f"--prefix '{prefix}' has {len(prefix)} characters", hint=f"use at most {LONGEST}"
        )
    if prefix.lower() in f"{C_WORDS} {CPP_WORDS} {LIBRARY}".split():
        raise UsageError(
            f"--prefix '{prefix}' is a word of C, C++ or their library",
            hint="choose another prefix",
        )
    if prefix.lower() in HEADERS.split():
        raise UsageError(
            f"--prefix '{prefix}' gives {prefix}.h, which is a header of the C library",
            hint="choose another prefix",
        )
