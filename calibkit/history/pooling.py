"""Errors that observations share, pooled from earlier runs of the same type of device."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibkit.readers import parts
from calibkit.recipe import Recipe
from calibkit.recipe.tables import ErrorComponent
from calibkit.records import store
from calibkit.records.coefficients import Component
from calibkit.records.store import StoredRun

POOLED = "pooled"
"""Key of run.json that lists the runs which a fit took components from."""


@dataclass(frozen=True, slots=True)
class Pooled:
    """A recipe with the components of earlier runs, and where they came from."""

    recipe: Recipe
    runs: tuple[Mapping[str, object], ...] = ()
    """Serial, revision and digest of each run, as run.json lists them."""
    flags: tuple[str, ...] = ()


def pool_components(spec: Recipe, runs: Path, logs: Sequence[Path]) -> Pooled:
    """Recipe whose errors are known from earlier runs of devices of its type, where it says from =
    "history".

    Of each serial counts the newest revision of other logs than these that did not take its
    components from history itself. The variance is the mean over the runs, weighted by their
    groups; degrees of freedom add up. What the recipe states stands.
    """
    if spec.errors.source != "history":
        return Pooled(spec)
    digests = {parts.digest_log(path, path.name, split=False) for path in logs}
    earlier = list(_earlier_runs(spec, runs, digests))
    if not earlier:
        flag = f"no earlier run of type '{spec.type}' in {runs.name}: nothing was pooled"
        return Pooled(spec, flags=(flag,))
    components: dict[tuple[str, str], list[Component]] = {}
    for run in earlier:
        for key, component in _components(run).items():
            components.setdefault(key, []).append(component)
    stated_keys = {
        (recipe_component.group, recipe_component.effect)
        for recipe_component in spec.errors.component
    }
    pooled = [
        _pool(same_effect)
        for key, same_effect in sorted(components.items())
        if key not in stated_keys
    ]
    errors = spec.errors.model_copy(update={"component": (*spec.errors.component, *pooled)})
    flags = tuple(
        f"{component.effect} of the {component.group}: {component.value:.2g} {component.unit} with"
        f" {component.dof:.0f} degrees of freedom, pooled from {len(earlier)} runs of"
        f" type '{spec.type}'"
        for component in pooled
    )
    pooled_runs = tuple(
        {
            "serial": run.document["serial"],
            "revision": run.document["revision"],
            "sha256": run.document["sha256"],
        }
        for run in earlier
    )
    return Pooled(spec.model_copy(update={"errors": errors}), pooled_runs, flags)


def _earlier_runs(spec: Recipe, runs: Path, digests: set[str]) -> Iterator[StoredRun]:
    """Newest run of each serial whose type and procedure are those of a recipe and whose logs are
    none of these.
    """
    for folder in sorted(runs.iterdir()) if runs.is_dir() else ():
        for revision in sorted(store.revisions(folder) if folder.is_dir() else (), reverse=True):
            run = store.load_revision(runs, folder.name, revision)
            recipe_kind = (spec.procedure, spec.type)
            run_kind = (run.document["procedure"], run.document.get("type", ""))
            shared_digests = digests & {entry["sha256"] for entry in run.document["inputs"]}
            if run_kind == recipe_kind and not shared_digests and not run.document.get(POOLED):
                yield run
                break


def _components(run: StoredRun) -> dict[tuple[str, str], Component]:
    """(group, effect) → component of the first model that has it: models of one run share them."""
    components: dict[tuple[str, str], Component] = {}
    for name in sorted(run.records):
        for model in run.records[name].models:
            for component in model.components:
                components.setdefault((component.group, component.effect), component)
    return components


def _pool(components: list[Component]) -> ErrorComponent:
    """Root mean square of standard deviations, and the degrees of freedom s²/(2 u²) of each, 1
    where it is not larger than its own uncertainty.
    """
    value = np.array([component.value for component in components])
    u = np.array([component.standard_uncertainty for component in components])
    groups = np.array([component.groups for component in components])
    significant = value > u
    dof = np.where(significant, value**2 / (2.0 * np.where(significant, u, 1.0) ** 2), 1.0)
    return ErrorComponent(
        group=components[0].group,
        effect=components[0].effect,
        value=float(np.sqrt(np.average(value**2, weights=groups))),
        unit=components[0].unit,
        dof=float(dof.sum()),
    )
