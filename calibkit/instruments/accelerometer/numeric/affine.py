"""The affine triad over temperature, G' = M(t) (V − b(t)), of which K- and Q-factor are special
cases.

Every entry of M and b is a polynomial in temperature. Optional are the second- and third-order
terms and cross products of the IEEE 1293 model equation (K₂, K₃, K_ip, K_io, here on the
indications and constant in temperature), and nuisance parameters: the tilt of the table's base and
the angles of the fixture, which otherwise bias the cross-axis terms. M can represent the rotation
of a fixture too, so with fixture angles M is lower triangular: the frame of the triad is e1 = x.
"""

from typing import Literal

import numpy as np

from calibkit.arrays import Array
from calibkit.errors import FitError
from calibkit.instruments.accelerometer.numeric import (
    determination,
    magnitude,
    q_factor,
)
from calibkit.instruments.accelerometer.numeric.affine_model import (
    AXES,
    AffineTerms,
    Entry,
    evaluate,
)
from calibkit.instruments.accelerometer.numeric.affine_solve import AffineFit, Problem, solve
from calibkit.instruments.accelerometer.numeric.shared_errors import Refine
from calibkit.numeric.least_squares import fit as least_squares, polynomial


def fit(
    indication: Array,
    temperature: Array,
    reference: Array,
    *,
    terms: AffineTerms = AffineTerms(),  # noqa: B008 frozen
    weights: Array | None = None,
    tool_rotation: Array | None = None,
    loss: Literal["least_squares", "robust"] = "least_squares",
    refine: Refine | None = None,
) -> AffineFit:
    """Fit the affine triad to reference vectors.

    Parameters
    ----------
    indication
        [n, 3], dwell means; nominally scaled to g where higher orders are fitted.
    temperature
        [n] [°C].
    reference
        [n, 3] [g], from `attitude.gravity_vector`.
    terms
        Which parameters.
    weights
        [n] or [n, 3], 1/variance of the dwell means.
    tool_rotation
        [n, 3, 3], from `attitude.tool_rotation`; needed for the tilt.
    loss
        "robust" leaves outliers out and names them.
    refine
        `shared_errors.refine` with the circumstances of the dwells.

    Raises
    ------
    FitError
        When the conditions do not determine a parameter: names it, says why and which dwells to
        add.

    """
    entries = terms.list_entries(triangular=terms.fixture)
    _require_enough(len(indication), indication.size, len(entries))
    if terms.tilt and tool_rotation is None:
        raise FitError(
            "a tilt needs the table's rotations",
            hint="give inclination_deg and toolface_deg of the dwells",
        )
    _require_determined(entries, reference, temperature)
    root = (
        np.ones(indication.shape)
        if weights is None
        else np.sqrt(np.broadcast_to(weights.T, (3, len(weights))).T)
    )
    middle, half = polynomial.middle_and_half(temperature)
    problem = Problem(
        entries, indication, temperature, middle, half or 1.0, root, reference, tool_rotation
    )
    return solve(problem, _starting_parameters(entries, indication, reference), loss, refine)


def fit_magnitude(
    indication: Array,
    temperature: Array,
    gravity: float = 1.0,
    *,
    terms: AffineTerms = AffineTerms(1, 0, 1),  # noqa: B008 frozen
    weights: Array | None = None,
    loss: Literal["least_squares", "robust"] = "least_squares",
    refine: Refine | None = None,
) -> AffineFit:
    """Fit the affine triad to the magnitude of gravity alone, M lower triangular: attitudes
    unknown, temperatures known.

    Parameters
    ----------
    indication
        [n, 3], dwell means.
    temperature
        [n] [°C].
    gravity
        Local gravity in the unit that corrected components shall have.
    terms
        Which parameters; no nuisance angles, lengths do not see them.
    weights
        [n], 1/variance of the length.
    loss
        "robust" leaves outliers out and names them.
    refine
        `shared_errors.refine` with the circumstances of the dwells.

    Raises
    ------
    FitError
        When the dwells leave a parameter undetermined.

    """
    if terms.tilt or terms.fixture:
        raise FitError(
            "lengths see no tilt and no fixture", hint="leave them out, or give reference attitudes"
        )
    entries = terms.list_entries(triangular=True)
    _require_enough(len(indication), len(indication), len(entries))
    order = max(entry.power for entry in entries)
    levels, _ = determination.distinct_temperatures(temperature)
    if levels.size <= order:
        raise FitError(
            f"{levels.size} distinct temperatures do not determine order {order}",
            hint="lower the orders",
        )
    root = np.ones((len(indication), 1)) if weights is None else np.sqrt(weights)[:, None]
    sphere = magnitude.fit_sphere(indication, gravity)
    begin = _constant_parameters(entries, np.diag(1.0 / sphere[:3]), sphere[3:6])
    middle, half = polynomial.middle_and_half(temperature)
    problem = Problem(entries, indication, temperature, middle, half or 1.0, root, gravity=gravity)
    return solve(problem, begin, loss, refine)


def _require_enough(dwells: int, residuals: int, parameters: int) -> None:
    """Raise FitError for fewer residuals than the parameters need."""
    if residuals <= parameters:
        raise FitError(
            f"{dwells} dwells for {parameters} parameters", hint="add dwells or lower the orders"
        )


def _starting_parameters(entries: tuple[Entry, ...], indication: Array, reference: Array) -> Array:
    """Starting parameters [p]: temperature-independent M and b, by a fit linear in M and M b."""
    design = np.column_stack([indication, np.ones(len(indication))])
    # noise makes the indications appear full rank: the rank of the reference attitudes decides
    if determination.affine_rank(reference) == 4 and least_squares.rank(design) == 4:
        solved = np.array(
            [least_squares.linear(design, reference[:, i]).coefficients for i in range(3)]
        )
    else:
        # too few attitudes for a full matrix: each axis on its own indication
        slope = np.sum(indication * reference, axis=0) / np.sum(indication**2, axis=0)
        solved = np.column_stack([np.diag(slope), np.zeros(3)])
    matrix, bias = solved[:, :3], -np.linalg.solve(solved[:, :3], solved[:, 3])
    angles = np.zeros(3)
    if any(entry.kind == "fixture" for entry in entries):
        from scipy.spatial.transform import Rotation

        axes, turned, scale = q_factor.axes_from_sensitivity(np.linalg.inv(matrix))
        matrix = q_factor.exact_matrix(axes) / scale
        angles = Rotation.from_matrix(turned.T).as_rotvec()
    return _constant_parameters(entries, matrix, bias, angles)


def _constant_parameters(
    entries: tuple[Entry, ...],
    matrix: Array,
    bias: Array,
    angles: Array = np.zeros(3),  # noqa: B008
) -> Array:
    """Parameters [p] of a constant matrix [3, 3], bias [3] and fixture angles [3]."""
    values = {
        "m": lambda e: matrix[e.row, e.factors[0]],
        "b": lambda e: bias[e.row],
        "fixture": lambda e: angles[e.row],
    }
    return np.array(
        [values[e.kind](e) if e.power == 0 and e.kind in values else 0.0 for e in entries]
    )


def _require_determined(entries: tuple[Entry, ...], reference: Array, temperature: Array) -> None:
    """Raise FitError where the conditions do not determine an entry of M or b or a higher-order
    term.
    """
    nominal = np.array(
        [float(e.kind == "m" and e.power == 0 and e.factors == (e.row,)) for e in entries]
    )
    parts = []
    for i in range(3):
        own = [c for c, e in enumerate(entries) if e.row == i and e.kind in ("m", "b", "n")]
        # low powers first, then the axis itself and its bias, then the other axes and the higher
        # orders
        own.sort(key=lambda c, i=i: (entries[c].power, entries[c].factors not in ((i,), ()), c))  # type: ignore[misc]

        def design(vectors: Array, mapped: Array, axis: int = i, used: list[int] = own) -> Array:
            return evaluate(entries, nominal, vectors, mapped)[1][:, axis, used]

        parts.append(
            determination.Part(f"accel_{AXES[i]}", tuple(entries[c].name for c in own), design)
        )
    determination.require_determined(
        parts,
        reference,
        temperature,
        order=max(entry.power for entry in entries),
        lower="lower scale_order, cross_order and bias_order, or leave out higher-order terms",
    )
