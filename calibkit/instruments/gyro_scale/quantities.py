"""Results of a run: scale factors over temperature, indications over rate, angles between gyros."""

from collections.abc import Iterator, Mapping
from dataclasses import replace

from calibkit.certificate.quantities import (
    At,
    Input,
    Limit,
    Point,
    Quantity,
    of_figure,
    of_form,
    ranged,
    weigh,
)
from calibkit.certificate.stated import powers
from calibkit.certificate.words import Words
from calibkit.coefficients import Coefficient, Model, Record
from calibkit.forms import POLYNOMIAL
from calibkit.instruments.gyro_scale import forms, lines
from calibkit.instruments.gyro_scale.compensate import TEMPERATURE_SLACK
from calibkit.instruments.gyro_scale.recipe import AnyRecipe, GyroTriadRecipe

PPM = 1e-6


def over_temperature(record: Record, model: Model, letter: str) -> Quantity:
    """K or F0 of a line, or a bias, over temperature."""

    def point(at: At) -> Point:
        t = at[forms.TEMPERATURE]
        weights, slope = powers("p", model, t)
        return weigh(model, weights, slope=slope, of=(forms.TEMPERATURE, t))

    inputs, unit = (ranged(model, forms.TEMPERATURE),), model.coefficients[0].unit
    return Quantity("value", record.stage, model.name, Words(letter), unit, inputs, point)


def _held(record: Record, model: Model, coefficient: Coefficient) -> Quantity:
    """A coefficient that was found at one temperature and holds near it."""
    name = coefficient.name
    point = weigh(model, {name: 1.0})
    near = ranged(model, forms.TEMPERATURE)
    inputs = (Input(near.column, near.low - TEMPERATURE_SLACK, near.high + TEMPERATURE_SLACK),) * (
        forms.TEMPERATURE in model.valid
    )
    words, unit = Words(name), coefficient.unit
    return Quantity(name, record.stage, model.name, words, unit, inputs, lambda _: point)


def _compared(one: Quantity, name: str, words: str, limit: Limit | None) -> Quantity:
    """A sensitivity that is compared, under a name that runs with and without temperature share."""
    return replace(
        one,
        name=name,
        model="",
        words=Words(words),
        compared=(({},),),
        limit=limit,
        relative=True,
        called=(one.key, f"{one.model}.{one.name}", one.name),
    )


def _change(spec: AnyRecipe, key: str, scale: float) -> Limit | None:
    """Largest change of a sensitivity by a limit in ppm of the own scale factor."""
    ppm = getattr(spec.acceptance, key, None)
    return None if ppm is None else Limit(f"acceptance.{key}", ppm * PPM * abs(scale))


def _sensitivities(records: Mapping[str, Record], spec: AnyRecipe) -> Iterator[Quantity]:
    """Scale factor of each gyro about its own axis, for a triad about all three axes: over
    temperature where that was fitted, else near the temperature of the runs.
    """
    record = records[forms.SCALE_FILE]
    for matrix in forms.read_matrices(spec, records):
        triad = isinstance(spec, GyroTriadRecipe)
        own = matrix.reference[0]
        file = records[forms.ORTHOGONALITY_FILE] if triad else record
        for k, name in enumerate(matrix.names[: own.size]):
            gyro, axis = divmod(k, len(matrix.outputs))
            letters = matrix.gyros[gyro], forms.AXES[axis] if triad else ""
            if matrix.curves:
                found = over_temperature(record, matrix.curves[k], "K")
            else:
                entry = next(c for c in matrix.model.coefficients if c.name == name)
                found = _held(file, matrix.model, entry)
            if not triad:
                limit = _change(spec, "max_scale_factor_error_ppm", own[0, 0])
            else:
                along = letters[0] == letters[1]
                key = "max_rate_error_ppm" if along else "max_cross_axis_ppm"
                limit = _change(spec, key, abs(own[gyro]).max())
            if lines.hold_within_runs(records.values()):
                limit = None
            about = f" about {letters[1]}" if triad else ""
            compared = _compared(
                found,
                "K_" + "_about_".join(filter(None, letters)),
                f"scale factor of gyro {letters[0]}{about}",
                limit,
            )
            cross = triad and letters[0] != letters[1]
            yield replace(compared, relative=not cross)


def _of_scales(record: Record) -> Iterator[Quantity]:
    """Each line over rate (of a gyro over several runs, their mean), each zero-rate indication over
    temperature, each response.
    """
    for model in record.models:
        if model.form == forms.LINE.name and "." not in model.name:
            inputs = (ranged(model, forms.RATE),)
            point = of_form(forms.LINE, model, inputs)
            words = Words("indication", "示值")
            yield Quantity("F", record.stage, model.name, words, "1/s", inputs, point)
        elif model.form == forms.RESPONSE.name:
            inputs = (ranged(model, forms.RATE),)
            point = of_form(forms.RESPONSE, model, inputs)
            words = Words("indicated rate", "示值角速率")
            rate = Quantity("rate", record.stage, model.name, words, "deg/s", inputs, point)
            yield replace(rate, compared=(({},),))
        elif model.form == POLYNOMIAL.name and ".K_" not in model.name:
            yield over_temperature(record, model, "F0")


def _of_angles(record: Record, spec: AnyRecipe) -> Iterator[Quantity]:
    """N, ε, γ, α of a pair; indications of a triad over the rates, and the angles between axes."""
    largest = getattr(spec.acceptance, "max_orthogonality_error_deg", None)
    limit = (
        None
        if largest is None
        else Limit("acceptance.max_orthogonality_error_deg", None, 90.0 - largest, 90.0 + largest)
    )
    for model in record.models:
        if model.form == forms.PAIR.name:
            for c in model.coefficients:
                one = replace(_held(record, model, c), inputs=())
                is_angle = c.name == "alpha_deg"
                groups: tuple[tuple[At, ...], ...] = (({},),) if is_angle else ()
                words = Words("angle between the gyros" if is_angle else c.name)
                yield replace(one, words=words, compared=groups, limit=limit if is_angle else None)
        elif model.name == "triad":
            rate = ranged(model, forms.RATE)
            inputs = tuple(replace(rate, column=f"rate_{axis}_dps") for axis in forms.AXES)
            gyros = [c.name[2:-1] for c in model.coefficients if c.name[-1] == forms.AXES[0]]
            for row, gyro in enumerate(dict.fromkeys(gyros)):
                point, words = of_form(forms.TRIAD, model, inputs, row), Words(f"indication {gyro}")
                yield Quantity(f"F_{gyro}", record.stage, model.name, words, "1/s", inputs, point)
    dof = min((float(model.dof) for model in record.models), default=1.0)
    for figure in record.figures:
        kind, _, pair = figure.name.partition(".")
        if kind == "angle_deg" and "." not in pair:
            words = Words(f"angle between the axes of gyros {pair.replace('_', ' and ')}")
            yield of_figure(record, figure, words, name=figure.name, dof=dof, limit=limit)


def results(records: Mapping[str, Record], spec: AnyRecipe) -> tuple[Quantity, ...]:
    """Sensitivities, then what each model gives by itself."""
    angles = records.get(forms.ORTHOGONALITY_FILE)
    return (
        *_sensitivities(records, spec),
        *_of_scales(records[forms.SCALE_FILE]),
        *(_of_angles(angles, spec) if angles is not None else ()),
    )
