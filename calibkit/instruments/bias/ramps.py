"""Logs of a gyro in a chamber → segments, denoised indication, block means at the model interval.

Soaks and ramps are those of the causal slope of the chamber air (`numeric.segments`), or as the
recipe states them; the indication is denoised by wavelets over the whole log.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from calibkit import check
from calibkit.errors import FitError, FrameError
from calibkit.instruments.bias.numeric import published
from calibkit.instruments.bias.recipe import FogThermalRecipe
from calibkit.logs import stated_segments
from calibkit.numeric import intervals, segments
from calibkit.numeric.arrays import Array
from calibkit.numeric.thermal import pooled_fit
from calibkit.numeric.thermal.pooled_fit import ThermalLog
from calibkit.numeric.wavelet.denoise import denoise
from calibkit.records.coefficients import Figure, Input
from calibkit.records.frame import Examined, Finding, Held, Log, refuse, values

LONGER_WINDOWS = 3
"""Largest number of doublings of the slope window for a log that changes temperature but shows no
ramp: its chamber climbs in small steps.
"""
LEAST_LEAD_DEGC = 2.0
"""Growth of T_case − T_env in the direction of a ramp [°C] above which the columns are swapped;
self-heating and noise stay below.
"""
TEMPERATURES = ("temp_case_degc", "temp_env_degc")
COLUMNS = ("time_s", *TEMPERATURES, "gyro_dph")


@dataclass(frozen=True, slots=True)
class Ramp:
    """Ramp of a log: model intervals start … stop − 1, and the measured or stated temperature rate
    [°C/min].
    """

    name: str
    start: int
    stop: int
    rate: float


@dataclass(frozen=True, slots=True)
class PreparedLog:
    """Log after preparation: block means of the raw and the denoised indication, ramps, and noise
    per level.
    """

    name: str
    source: Input
    raw: published.DriftBlocks
    denoised: published.DriftBlocks
    thermal: ThermalLog
    ramps: tuple[Ramp, ...]
    noise: tuple[Figure, ...]
    flags: tuple[str, ...]


@check.in_stages
def find_faults(log: Log, recipe: FogThermalRecipe) -> Iterator[list[Finding]]:
    """Yield findings of a log for a fit, which a refused one prevents."""
    (case, air), gyro = TEMPERATURES, "gyro_dph"
    yield check.find_unusable(log, recipe.checks.min_rows, COLUMNS)
    yield [
        *check.find_gaps(log, recipe.checks.max_gap_s),
        *check.find_constant_columns(log, [case, air, gyro]),
    ]
    stated_rate, of_stated_rate = recipe.drift.rates_degc_min.get(log.name), []
    if stated_rate is not None:
        rates = [part.rate for part in _find_segments(log, recipe)[0] if part.kind == "ramp"]
        if rates:
            fastest = max(rates, key=abs)
            of_stated_rate = check.thermometers.check_stated_rate(log, air, stated_rate, fastest)
    yield [
        *check.magnitude.check_time_unit(log, air, "the chamber air"),
        *check.thermometers.find_lost_sign(log, case),
        *check.thermometers.check_pair(log, case, air),
        *check.thermometers.check_steps(log, case),
        *check.thermometers.check_steps(log, air),
        *of_stated_rate,
        *check.magnitude.check_gyro_unit(log, gyro),
        *check.magnitude.find_compensated_names(log, recipe, [gyro]),
        *check.series.check_case_and_air(log, case, air),
        *check.series.find_turn_back(log, case),
        *check.series.check_indication(log, gyro, "deg/h"),
    ]


def prepare(log: Log, recipe: FogThermalRecipe, findings: Sequence[Finding]) -> PreparedLog:
    """Denoise, segment and average a checked log; raises FrameError or FitError naming the log."""
    refuse(findings)
    suspected = next((finding for finding in findings if finding.name == "unit"), None)
    try:
        prepared = _prepared(log, recipe, findings)
    except (FrameError, FitError) as error:
        if suspected is None:
            raise
        advice = f"{suspected.place}: {suspected.found}; {suspected.advice}"
        raise type(error)(error.message, hint=f"first of all: {advice}") from None
    # Where the case leads the air, the columns are swapped. Without a soak after the ramp, rates do
    # not show this (`check.thermometers`). The lead is compared between the start and the middle of
    # the ramp: towards the end, the lag of a case that was not at rest at the start may shrink,
    # which looks like a lead.
    gradient = prepared.raw.gradient
    for ramp in prepared.ramps if suspected is None else ():
        grown = float(gradient[(ramp.start + ramp.stop) // 2] - gradient[ramp.start])
        if grown * ramp.rate > 0.0 and abs(grown) > LEAST_LEAD_DEGC:
            raise FrameError(
                f"{prepared.source.name}: at {ramp.rate:+.1f} °C/min the case gains"
                f" {abs(grown):.1f} °C on the chamber air, expected it to lag behind",
                hint="temp_case_degc and temp_env_degc are swapped, in the log or in [columns]",
            )
    return prepared


def _prepared(log: Log, recipe: FogThermalRecipe, findings: Sequence[Finding]) -> PreparedLog:
    """Segments, denoised indication and block means of a checked log."""
    time, case, env, gyro = (values(log.frame, column) for column in COLUMNS)
    spec = recipe.denoise
    parts, slope = _cut(log, recipe)
    moving = [segment for segment in parts if segment.kind == "ramp"]
    try:
        blocks = intervals.Intervals.find(time, recipe.drift.interval_s, log.steps.usual)
        means = [blocks.means(column) for column in (time, case, env)]
        raw = published.DriftBlocks.fill(blocks, [*means, blocks.means(gyro)], slope)
        del slope  # a column, and denoising takes four
        denoised, noise = raw, []
        if spec.enabled:
            # in one piece: cut at the ends of its ramps, short soaks keep waves of noise and the
            # pieces meet in steps
            smooth = denoise(
                gyro,
                wavelet=spec.wavelet,
                levels=None if spec.levels == "auto" else spec.levels,
                threshold=spec.threshold,
                rule=spec.rule,
                extension=spec.extension,
            )
            denoised = raw._replace(indication=blocks.filled(blocks.means(smooth.signal)))
            sizes = zip(smooth.noise.tolist(), smooth.thresholds.tolist(), strict=True)
            for level, (sigma, threshold) in enumerate(sizes, start=1):
                noise.append(Figure(f"{log.name}.noise_{level}", sigma, "deg/h", 0.0))
                noise.append(Figure(f"{log.name}.threshold_{level}", threshold, "deg/h", 0.0))
    except FitError as error:
        raise FitError(f"{log.file}: {error.message}", hint=error.hint) from None
    coarse = [
        f"{column} is read in steps of {segments.quantum(column_values):g} °C: its rate is taken"
        " over as many minutes as that needs"
        for column, column_values in (("temp_case_degc", case), ("temp_env_degc", env))
        if segments.coarse(column_values, recipe.segments.slope_window_s)
    ]
    if not moving:
        raise FrameError(
            f"{log.file}: no ramp found: the chamber air moves from {env.min():g} to"
            f" {env.max():g} °C",
            hint=(
                "check the chamber column, or lower [segments] ramp_min_degc_min and"
                " ramp_min_span_degc"
            ),
        )
    # ramps are named by their log, and numbered if it has several
    ramps = []
    for k, segment in enumerate(moving, start=1):
        name = log.name if len(moving) == 1 else f"{log.name}:{k}"
        start, last = blocks.of_row(segment.start), blocks.of_row(segment.stop - 1)
        ramps.append(Ramp(name, start, last + 1, segment.rate))
    # a soak belongs to the ramp before it, the first soak to the first ramp
    begins = [segment.start for segment in moving][1:]
    return PreparedLog(
        log.name,
        Input.of(log),
        raw,
        denoised,
        pooled_fit.thermal_blocks(log.name, blocks, means, gyro, begins),
        tuple(ramps),
        tuple(noise),
        tuple(f"{log.file}: {note}" for note in (*log.notes, *coarse))
        + tuple(str(finding) for finding in findings if finding.flagged),
    )


def block_means(
    log: Log, recipe: FogThermalRecipe, *, rated: bool
) -> tuple[intervals.Intervals, published.DriftBlocks]:
    """Model intervals and block means of a log that is not fitted; the temperature rate is 0 unless
    `rated`. A log without chamber air has no gradient.
    """
    air = "temp_env_degc" if "temp_env_degc" in log.frame.columns else "temp_case_degc"
    columns = ("time_s", "temp_case_degc", air, "gyro_dph")
    time, case, env, gyro = (values(log.frame, column) for column in columns)
    blocks = intervals.Intervals.find(time, recipe.drift.interval_s, log.steps.usual)
    slope = _cut(log, recipe)[1] if rated else np.broadcast_to(0.0, time.shape)
    means = (blocks.means(column) for column in (time, case, env, gyro))
    return blocks, published.DriftBlocks.fill(blocks, means, slope)


def _cut(log: Log, recipe: FogThermalRecipe) -> tuple[list[segments.Segment], Array]:
    """Segments of a log and the causal slope [n, °C/min] of its chamber air; a rate stated in the
    recipe replaces both.

    Segments in the recipe replace those found. A chamber that climbs in steps of a degree, each
    held for minutes, shows its rate only over several steps: if the temperature changes but no ramp
    is found, the window is doubled up to LONGER_WINDOWS times.
    """
    time, env = (values(log.frame, column) for column in ("time_s", "temp_env_degc"))
    stated_rate = recipe.drift.rates_degc_min.get(log.name)
    if stated_rate is not None:
        return [segments.Segment("ramp", 0, time.size, stated_rate)], np.broadcast_to(
            stated_rate, time.shape
        )
    pinned = stated_segments.stated_rows(log, recipe, ["soak", "ramp"])
    if pinned is not None:
        ramps = [
            (a, b)
            for (a, b), kind in zip(
                pinned.tolist(), stated_segments.stated_kinds(log, recipe), strict=True
            )
            if kind == "ramp"
        ]
        slope = segments.measured_slope(time, env, recipe.segments.slope_window_s)
        return segments.pinned(time, env, slope, ramps), slope
    return _find_segments(log, recipe)


def _find_segments(log: Log, recipe: FogThermalRecipe) -> tuple[list[segments.Segment], Array]:
    """Segments found in the chamber air temperature, and its causal slope [n, °C/min]."""
    time, env = (values(log.frame, column) for column in ("time_s", "temp_env_degc"))
    low, high = log.extremes("temp_env_degc")
    spec = recipe.segments
    limits = {"ramp_min": spec.ramp_min_degc_min, "min_span": spec.ramp_min_span_degc}
    tried = []
    for doubled in range(LONGER_WINDOWS + 1):
        window = spec.slope_window_s * 2.0**doubled
        slope = segments.measured_slope(time, env, window)
        parts = segments.segments(slope, env, **limits, merge=round(window / log.steps.usual))
        if any(segment.kind == "ramp" for segment in parts) or high - low < spec.ramp_min_span_degc:
            return parts, slope
        tried.append((parts, slope))
    return tried[0]


def examine(recipe: FogThermalRecipe, log: Log) -> Examined:
    """Findings of a log, including errors that would stop a fit, and its soaks and ramps."""
    findings = find_faults(log, recipe)
    if any(finding.refused for finding in findings):
        return Examined(tuple(findings))
    env = values(log.frame, "temp_env_degc")
    conditions: tuple[Held, ...] = ()
    try:
        parts, _ = _cut(log, recipe)
        pinned = stated_segments.stated_rows(log, recipe, ["soak", "ramp"]) is not None
        conditions = tuple(
            (
                Held("ramp", part.start, part.stop, part.rate, "°C/min", pinned)
                if part.kind == "ramp"
                else Held(
                    "soak",
                    part.start,
                    part.stop,
                    float(np.median(env[part.start : part.stop])),
                    "°C",
                    pinned,
                )
            )
            for part in parts
        )
        prepare(log, recipe, findings)
    except (FitError, FrameError) as error:
        findings.append(Finding.of(error))
    return Examined(tuple(findings), conditions)
