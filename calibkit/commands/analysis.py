"""A run in Python: its models, residuals and figures, and on frames what the commands do."""

from __future__ import annotations

import html
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from calibkit import instruments
from calibkit.commands import pipeline
from calibkit.errors import CoefficientError, UsageError, did_you_mean
from calibkit.instruments import silent
from calibkit.logs import column_values
from calibkit.readers import in_memory
from calibkit.recipe import toml_text
from calibkit.records import run_document, sealed, store
from calibkit.report import documents
from calibkit.report.overview import merge_flags
from calibkit.report.page import first_screen_of
from calibkit.report.run import RUN_COLUMNS, list_numbers
from calibkit.results.model import RunModel

if TYPE_CHECKING:
    from collections.abc import Mapping

    import pandas as pd
    from matplotlib.figure import Figure

    from calibkit.commands.pipeline import FitOutcome

NOT_WRITTEN = "not written"
"""Folder of runs that are in memory alone."""


@dataclass(frozen=True, slots=True, repr=False)
class Run(store.StoredRun):
    """A run with what can be asked of it: from `calibkit.fit` or `calibkit.find_run`.

    Attributes
    ----------
    document : run.json; its "verdict" is accepted, rejected or no verdict.
    records : name of the file → what the coefficient file holds.
    folder : of the run, also where nothing was written there.

    Examples
    --------
    >>> import calibkit, pandas as pd
    >>> simulated = calibkit.simulated("gyro_pair", 7)
    >>> logs = {name: pd.DataFrame(columns) for name, columns in simulated.logs.items()}
    >>> run = calibkit.fit("gyro_pair", logs=logs, runs=None, date="2026-11-21")
    >>> run.figures
    ('scale-factor error against rate',)
    >>> list(run.residuals().columns)
    ['run', 'gyro', 'table_rate_dps', 'residual_ppm', 'standard_uncertainty_ppm']
    >>> run.model("a_about_a")
    <a_about_a: gyro-scale/1, 2 coefficients>
    >>> counts = run.model("a_about_a").evaluate(table_rate_dps=[10.0, 20.0])
    >>> counts.covariance.shape
    (2, 2)

    """

    outcome: FitOutcome | None = None
    """Of the fit in this process; None of a run that was found in a folder."""

    @classmethod
    def of_fit(cls, outcome: FitOutcome) -> Run:
        """The run of a fit that has just ended."""
        run = outcome.run
        return cls(run.folder, run.document, run.records, outcome)

    @property
    def in_memory(self) -> bool:
        """Whether nothing of it was written."""
        return self.folder.parts[0] == NOT_WRITTEN

    def __repr__(self) -> str:
        facts = (self.document[key] for key in ("procedure", "verdict"))
        location = NOT_WRITTEN if self.in_memory else self.folder
        logs = len(self.document["inputs"])
        line = f"<{self.name}: {', '.join(facts)}, {logs} log{'s' * (logs > 1)}, {location}"
        if count := len(self.flags):
            line += f", {count} thing{'s' * (count > 1)} to check: run.flags"
        return f"{line}>"

    @property
    def flags(self) -> tuple[str, ...]:
        """What to check before the results are used, a line per cause; of a run that was found in a
        folder with its remarks, which run.json does not tell apart.
        """
        if self.outcome is not None:
            return tuple(self.outcome.summary.checks)
        logs = [entry["name"] for entry in self.document["inputs"]]
        return tuple(merge_flags(self.document["flags"], logs))

    def _repr_html_(self) -> str:
        """First screen of the report, in a frame of its own: its style stays there."""
        page = html.escape(first_screen_of(self.content(documents.PAGE).decode()))
        title = html.escape(f"Report of {self.name}")
        style = "width:100%;height:44em;border:0"
        return f'<iframe title="{title}" srcdoc="{page}" style="{style}"></iframe>'

    def content(self, name: str) -> bytes:
        """Content of one of the run's files."""
        if self.outcome is not None:
            return self.outcome.files[name]
        return store.read_bytes(self.folder / name)

    def _fitted(self, missing_item: str) -> FitOutcome:
        """The fit of this process; UsageError of a run that was found in a folder."""
        if self.outcome is None:
            raise UsageError(
                f"{self.name} was read from its folder, which holds no {missing_item}",
                hint="fit its logs again: calibkit.fit(recipe, logs={name: frame}, runs=None)",
            )
        return self.outcome

    def model(self, name: str) -> RunModel:
        """Model of a name in the run's coefficient files; ``stage.model`` where several files have
        one of that name. Raises CalibkitError where there is none.
        """
        models = {
            f"{record.stage}.{model.name}": model
            for record in self.records.values()
            for model in record.models
        }
        matches = [model for full_name, model in models.items() if name in (full_name, model.name)]
        if len(matches) != 1:
            reason = [flag for flag in self.document["flags"] if flag.startswith(f"no {name} ")]
            fault = f"{len(matches) or 'no'} model{'s are' if matches else ' is'} called '{name}'"
            raise CoefficientError(
                ": ".join((f"{self.name}: {fault}", *reason)),
                hint=f"there are: {', '.join(models) or 'none'}",
            )
        form = instruments.model_forms(self.document["procedure"]).get(matches[0].form)
        if form is None:
            raise CoefficientError(
                f"model '{name}': form {matches[0].form} is not known", hint="use a newer calibkit"
            )
        return RunModel(matches[0], form)

    def numbers(self) -> pd.DataFrame:
        """Every coefficient, parameter, component and figure with unit and standard uncertainty,
        one row each: the table of ``calibkit show --csv``.
        """
        import pandas as pd

        table = list_numbers(self.records.values())
        return pd.DataFrame.from_records(list(table.rows), columns=list(RUN_COLUMNS))

    def residuals(self) -> pd.DataFrame:
        """What the fit leaves, as a tidy frame with units in ``attrs["units"]``: one row per model
        interval, dwell, held rate, station, bin or averaging time, by procedure.

        Raises CalibkitError of a run that was found in a folder, which holds none.
        """
        import pandas as pd

        columns = dict(self._fitted("residuals").residuals())
        stated_units = columns.pop(in_memory.UNITS, {})
        if not columns:
            procedure = self.document["procedure"]
            raise UsageError(f"procedure '{procedure}' states no residuals", hint="see its figures")
        frame = in_memory.label_units(pd.DataFrame(columns))
        frame.attrs[in_memory.UNITS] |= stated_units
        return frame

    @property
    def figures(self) -> tuple[str, ...]:
        """Names of the report's figures, the one that shows the verdict first."""
        return tuple(self._by_name())

    def _by_name(self) -> dict[str, Figure]:
        """Name → figure: what its title says behind the run, a number where it stands twice."""
        figures: dict[str, Figure] = {}
        outcome = self._fitted("figures, but report.html shows them")
        for figure in outcome.drawn.figures:
            title = figure.get_suptitle().partition(": ")[2]
            name = title.partition(" (")[0].partition(":")[0].partition(",")[0].partition(" =")[0]
            repeats = sum(other.partition(" #")[0] == name for other in figures)
            figures[f"{name} #{repeats + 1}" if repeats else name] = figure
        return figures

    def figure(self, name: str) -> Figure:
        """Figure of the report, of matplotlib, by its name in `figures` or the beginning of it.

        Raises CalibkitError for another name, and of a run that was found in a folder.
        """
        figures = self._by_name()
        matches = [figure_name for figure_name in figures if figure_name.startswith(name)]
        if name not in figures and len(matches) != 1:
            advice = did_you_mean(name, figures, "")
            raise UsageError(
                f"{len(matches)} figures of {self.name} are called '{name}'",
                hint=f"{advice} there are: {', '.join(figures)}".lstrip(),
            )
        return figures[name if name in figures else matches[0]]

    def apply(
        self,
        frame: pd.DataFrame,
        *,
        uncorrected: Literal["empty", "keep"] = "empty",
        **settings: object,
    ) -> pd.DataFrame:
        """A log as a frame, compensated: every row and column of it, indications replaced, derived
        columns added; ``calibkit apply``.

        Parameters
        ----------
        frame : log in canonical columns, or in those that the run's recipe maps.
        uncorrected : what rows that cannot be corrected have in place of a value: none, or what was
            logged; the column `status` says why.
        settings : of the place of use: ``site__latitude_deg=58.9``.

        Returns
        -------
        Frame with the units of its columns in ``attrs["units"]`` and the flags in
        ``attrs["flags"]``.

        Raises
        ------
        CalibkitError : a column that is missing, or values that cannot be meant.

        """
        if uncorrected not in ("empty", "keep"):
            raise UsageError(f"uncorrected = '{uncorrected}'", hint="give 'empty' or 'keep'")
        with in_memory.hold({"log": frame}, ["*"]) as folder:
            log = folder / "log"
            content, flags = pipeline.compensate(
                self, log, toml_text.write_overrides(settings), keep=uncorrected == "keep"
            )
            compensated = in_memory.label_units(content.as_frame(frame))
            memory_log = in_memory.find(log)
            assert memory_log is not None  # noqa: S101 (it is there until the context ends)
            logged = column_values.resolve_units(content.recipe, memory_log)
        compensated.attrs[in_memory.UNITS] |= frame.attrs.get(in_memory.UNITS, {}) | logged
        compensated.attrs["flags"] = list(flags)
        return compensated

    def validate(self, frames: Mapping[str, pd.DataFrame]) -> Mapping[str, Any]:
        """The run's coefficients, as they are, on logs that it has not seen: name → frame; the
        document that ``calibkit validate`` writes.

        Raises CalibkitError where every log was fitted by the run, or one cannot be used.
        """
        spec = pipeline.run_recipe(self, ())
        with in_memory.hold(frames, patterns(spec)) as folder:
            text, _ = pipeline.judge_unseen(self, folder, silent)
        return sealed.unseal(text, "validation", run_document.VALIDATION_FORMAT)


def patterns(spec: Any) -> tuple[str, ...]:  # noqa: ANN401 (each procedure has its own recipe)
    """Patterns of the files that a recipe reads, those of its second logger too."""
    second = () if spec.chamber is None else spec.chamber.files
    return (*spec.logs.files, *(pattern.replace("{log}", "*") for pattern in second))
