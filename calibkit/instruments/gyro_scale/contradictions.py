"""Runs that contradict the others: another gyro, setting or unit, a turned sign, swapped columns.

Scale factors over temperature are judged by `left_out_run`. A gyro that a table turns across its
axis indicates the share k/|s| of the rate, which hardly changes with temperature:

    F = e² / (s² (1 + 1/n)) against F(1, ν)                                                  (1)

e is what the share in one log is off the mean of the n other logs about the axis, s² the scatter
about such means in all logs but that one, of all gyros and axes together, at least that of noise.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from calibkit.arrays import Array, Mask
from calibkit.errors import FitError, advise_exclude
from calibkit.fit.value import Value
from calibkit.instruments.gyro_scale import forms, lines
from calibkit.instruments.gyro_scale.table_runs import TableRun
from calibkit.numeric import left_out_run

PPM = 1e6
ONE_TEMPERATURE_DEGC = 10.0
"""Largest span of temperatures [°C] of runs that count as repeated."""
CHANCE = 0.005
"""Probability with which a gyro of a faultless campaign is named, of all its logs together."""
ANOTHER = 1e-3
"""Relative difference from repeated runs above which a scale factor is another gyro's or setting's.
"""
LEAST_OTHERS = 2
"""Fewest other logs about an axis with which one is held against them."""


def flag_runs(name: str, runs: Sequence[TableRun], found: Value) -> Iterator[str]:
    """Flags on runs of a gyro about one axis whose K [r] the others contradict; FitError where that
    is because their thermometer was in °F.
    """
    temp_degc = np.array([run.temp_degc for run in runs])
    files, K, u = [run.log.file for run in runs], found.value, found.u
    if len(runs) == 1 or not np.ptp(temp_degc) > ONE_TEMPERATURE_DEGC:
        off = np.abs(K / np.median(K) - 1.0)
        if off.max() > ANOTHER:
            apart = f"{PPM * off.max():.0f} ppm off the other runs: another gyro or setting?"
            yield f"{name}: K of {files[int(np.argmax(off))]} is {apart}"
        return
    in_degf = left_out_run.find_degf(temp_degc, K, u)
    if in_degf.any():
        numbers = np.flatnonzero(in_degf).tolist()
        listed = ", ".join(f"{files[k]} ({temp_degc[k]:.1f})" for k in numbers)
        raise FitError(
            f"{name}: K over temperature is one curve only if these runs are in °F, not °C:"
            f" {listed}",
            hint=(
                f"write the unit into the headers of these logs, {forms.TEMPERATURE} (degF), or"
                " leave them out"
            ),
        )
    for left_out in left_out_run.find(temp_degc, K, u):
        off_ppm = f"{PPM * left_out.off / np.median(np.abs(K)):+.3g} ppm"
        at = f"{files[left_out.run]} at {temp_degc[left_out.run]:.1f} °C"
        yield f"{name}: " + (
            f"K of {at} is {off_ppm} off what the other runs let expect: see its thermometer and"
            f" what else was different, or leave it out: {advise_exclude(files[left_out.run])}"
            if left_out.certain
            else f"either K of {at} is {off_ppm} off, or K over temperature bends that much, which"
            " no other run shows: repeat a run at that temperature"
        )


def flag_shares(
    table: lines.Lines, runs: Sequence[TableRun], gyros: Sequence[str]
) -> Iterator[str]:
    """Flags on logs of a triad in which gyros that lie across the axis indicate another share of
    the rate than in the other logs about it; `runs` are in the order of the table's lines.
    """
    from scipy.special import stdtrit

    # scale factor [lines] of each gyro about its own axis at the temperature of each line
    size = np.empty(table.K.size)
    for number in np.unique(table.set_of):
        chosen: Mask = table.set_of == number
        sensitivity = table.means(chosen) @ table.K
        size[chosen] = np.linalg.norm(sensitivity, axis=1)[table.gyro_of[chosen]]
    share, noise = table.K / size, table.u_K / size
    log_of = np.arange(share.size) // len(gyros)
    channel = table.gyro_of * len(forms.AXES) + table.axis_of
    across = ~table.own()
    tests = int(np.count_nonzero(across))
    for log, run in enumerate(runs):
        here, rest = across & (log_of == log), across & (log_of != log)
        count = np.bincount(channel[rest], minlength=channel.max() + 1)
        of_here = channel[here]
        if not here.any() or count[of_here].min() < LEAST_OTHERS:
            continue
        mean = np.bincount(channel[rest], share[rest], count.size) / np.maximum(count, 1)
        dof = int(np.count_nonzero(rest) - np.count_nonzero(count))
        scatter = float(np.sum((share - mean[channel])[rest] ** 2)) / dof
        variance = max(scatter, float(np.mean(noise[rest] ** 2)))
        # the largest |e| of (1) by chance in so many tests
        t = float(stdtrit(dof, 1.0 - CHANCE / (2.0 * tests)))
        limit = t * np.sqrt(variance * (1.0 + 1.0 / count[of_here]))
        about = f"{run.log.file}: about {forms.AXES[table.axis_of[here][0]]}"
        names = [gyros[g] for g in table.gyro_of[here].tolist()]
        expected = mean[of_here] * size[here]
        yield from _name_cause(about, names, table.K[here], expected, limit * size[here])


def _name_cause(
    about: str, gyros: Sequence[str], K: Array, expected: Array, limit: Array
) -> Iterator[str]:
    """Flags on the gyros of a log whose K [1/deg] is off what the other logs about the axis let
    expect, by more than the limit of each.
    """
    off = np.flatnonzero(np.abs(K - expected) > limit)
    if off.size > 1 and np.all(np.abs(K[off][::-1] - expected[off]) <= limit[off]):
        listed = " and ".join(gyros[k] for k in off.tolist())
        yield f"{about} gyros {listed} are swapped, as the other logs about the axis tell"
        return
    for k in off.tolist():
        values = f"K is {K[k]:+.4g} 1/deg, {expected[k]:+.4g} in the other logs"
        if abs(-K[k] - expected[k]) <= limit[k]:
            yield f"{about} the sign of gyro {gyros[k]} is turned: its {values}"
        else:
            yield (
                f"{about} either gyro {gyros[k]} contradicts the other logs, or its axis turns that"
                f" much with temperature: its {values}; repeat the log"
            )
