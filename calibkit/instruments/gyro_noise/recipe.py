"""Recipe of the noise of gyros and accelerometers at rest: Allan deviation, its noise terms, bias
stability; and what noise is of either sensor: units, terms, limits.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Literal, Self

from pydantic import Field, field_validator, model_validator

from calibkit.numeric.noise.allan_fit import ACCELEROMETER_LAWS, LAWS, PowerLaw
from calibkit.recipe.tables import Positive, Recipe, Table

Indication = Annotated[str, Field(pattern=r"^(gyro(_[a-z0-9]+)?_dph|accel_[a-z0-9]+_g)$")]


@dataclass(frozen=True, slots=True)
class Sensor:
    """Kind of sensor: unit of its deviations, name of its mean, noise terms, and the recipe's key
    of the limit on each figure.
    """

    unit: str
    mean: str
    laws: tuple[PowerLaw, ...]
    limits: Mapping[str, str]


GYRO = Sensor(
    "deg/h",
    "mean_rate",
    LAWS,
    {
        "angle_random_walk": "max_angle_random_walk",
        "bias_instability": "max_bias_instability_dph",
        "rate_random_walk": "max_rate_random_walk",
        "bias_stability": "max_bias_stability_dph",
        "residual_over_noise": "max_residual_over_noise",
    },
)
ACCELEROMETER = Sensor(
    "mg",
    "mean_acceleration",
    ACCELEROMETER_LAWS,
    {
        "velocity_random_walk": "max_velocity_random_walk",
        "bias_instability": "max_bias_instability_mg",
        "acceleration_random_walk": "max_acceleration_random_walk",
        "bias_stability": "max_bias_stability_mg",
        "residual_over_noise": "max_residual_over_noise",
    },
)


def find_sensor(column: str) -> Sensor:
    """Kind of the sensor that a column is the indication of."""
    return ACCELEROMETER if column.startswith("accel") else GYRO


class _Noise(Table):
    """Which columns are indications, and what is estimated from them."""

    #: Indications: `gyro_dph`, `gyro_<axis>_dph`, `accel_<axis>_g`.
    columns: Annotated[tuple[Indication, ...], Field(min_length=1, strict=False)] = ("gyro_dph",)
    #: Averaging times per octave or decade.
    points: Annotated[int, Field(ge=1, le=20)] = 1
    #: What `points` counts in.
    spacing: Literal["octave", "decade"] = "octave"
    #: Probability of the confidence limits.
    probability: Annotated[float, Field(gt=0.5, lt=1.0)] = 0.95
    #: Orthogonal wavelet of the wavelet deviation.
    wavelet: str = "db2"
    #: Averaging times of the bias stability.
    bias_stability_s: Annotated[tuple[Positive, ...], Field(strict=False)] = (10.0, 100.0)
    #: A log with fewer rows is refused.
    min_rows: Annotated[int, Field(ge=64)] = 1000

    @field_validator("columns")
    @classmethod
    def _each_once(cls, columns: tuple[str, ...]) -> tuple[str, ...]:
        if len(set(columns)) != len(columns):
            raise ValueError(f"columns = {list(columns)}: a column stands twice")
        return columns

    @field_validator("wavelet")
    @classmethod
    def _orthogonal(cls, wavelet: str) -> str:
        import pywt

        if wavelet not in pywt.wavelist(kind="discrete") or not pywt.Wavelet(wavelet).orthogonal:
            raise ValueError(
                f"'{wavelet}' is not an orthogonal wavelet; use haar, db2, db3, sym4 ..."
            )
        return wavelet


class NoiseAcceptance(Table):
    """Limits; of a term that is not observable, on what the term can be at most."""

    #: Standard deviation of the record over the noise within 1/32 of it.
    max_residual_over_noise: Positive | None = None
    #: Largest N of a gyro [°/√h].
    max_angle_random_walk: Positive | None = None
    #: Largest B of a gyro.
    max_bias_instability_dph: Positive | None = None
    #: Largest K of a gyro [°/h/√h].
    max_rate_random_walk: Positive | None = None
    #: Largest bias stability of a gyro.
    max_bias_stability_dph: Positive | None = None
    #: Largest N of an accelerometer [µg/√Hz].
    max_velocity_random_walk: Positive | None = None
    #: Largest B of an accelerometer.
    max_bias_instability_mg: Positive | None = None
    #: Largest K of an accelerometer [mg/√h].
    max_acceleration_random_walk: Positive | None = None
    #: Largest bias stability of an accelerometer.
    max_bias_stability_mg: Positive | None = None


class GyroNoiseRecipe(Recipe):
    """Gyros or accelerometers at rest at one temperature, one record per log."""

    procedure: Literal["gyro_noise"]
    noise: _Noise = _Noise()
    acceptance: NoiseAcceptance = NoiseAcceptance()

    def sensor_of(self, record: str) -> Sensor:
        """Kind of the sensor of a record, which is named column.log, or by its log alone."""
        columns = [column for column in self.noise.columns if record.startswith(f"{column}.")]
        return find_sensor(columns[0] if columns else "gyro_dph")

    @model_validator(mode="after")
    def _limits_are_tested(self) -> Self:
        tested = {key for name in self.noise.columns for key in find_sensor(name).limits.values()}
        idle = sorted(self.acceptance.model_fields_set - tested)
        if idle:
            raise ValueError(
                f"[acceptance] {', '.join(idle)}: no sensor of [noise] columns has it; its limits"
                f" are {', '.join(sorted(tested))}"
            )
        return self
