"""Loop-only twins of the numeric core: slow, short, and written from the equations alone."""

from __future__ import annotations

import math

import numpy as np


def compensate(indication, gradient, rate, c):
    """Recursive and one-step outputs of CN102095419A step 4 for one set of polynomials c[j][m],
    term by term.
    """
    recursive, one_step, level = [indication[0]], [0.0], 0.0
    for k in range(1, len(indication)):
        a = [sum(c[j][m] * rate[k - 1] ** m for m in range(len(c[j]))) for j in range(3)]
        delta = a[0] + a[1] * gradient[k - 1] + a[2] * gradient[k - 1] ** 2
        level += delta
        recursive.append(indication[k] - level)
        one_step.append(indication[k] - (indication[k - 1] + delta))
    return recursive, one_step


def block_means(time, values, interval):
    """Means of the values whose time falls into each interval, by a dictionary."""
    bins = {}
    for t, v in zip(time, values, strict=True):
        bins.setdefault(math.floor((t - time[0]) / interval), []).append(v)
    return [sum(bins[k]) / len(bins[k]) for k in sorted(bins)]


def sensitivities(function, estimate, standard_uncertainty):
    """Jacobian of a function by central differences of ± one standard uncertainty (JCGM 100 5.1.3
    note 2); an input without one is stepped by a millionth of itself.
    """
    columns = []
    for i, uncertainty in enumerate(standard_uncertainty):
        step = float(uncertainty) or 1e-6 * max(abs(float(estimate[i])), 1.0)
        up, down = np.array(estimate, dtype=float), np.array(estimate, dtype=float)
        up[i] += step
        down[i] -= step
        difference = np.atleast_1d(np.asarray(function(up)) - np.asarray(function(down)))
        columns.append(difference / (up[i] - down[i]))
    return np.stack(columns, axis=1)
