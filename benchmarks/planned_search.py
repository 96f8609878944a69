"""How good and how fast the search of a plan is.

    python benchmarks/planned_search.py

Criterion of the best of all designs over that of the search, on cases small enough to try them all;
mean variance of D-optimal designs of pyDOE3 over that of the search; and the time of a plan over
that of a fit of the sample logs. Needs pyDOE3.
"""

import itertools
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyDOE3.doe_optimal as doe

from calibkit import instruments, plans, recipe
from calibkit.ingest import logs as ingest
from calibkit.instruments.accelerometer import plan
from calibkit.planning import equipment
from calibkit.planning.bench import Task
from calibkit.planning.exchange import Pool

DATASETS = Path(__file__).resolve().parents[1] / "datasets"
LOW_ORDERS = (
    *("affine.scale_order=1", "affine.cross_order=0", "affine.bias_order=1"),
    *("k.scale_order=1", "k.zero_order=1"),
)
FACES_AND_EDGES = (
    *((0, 0), (180, 0)),
    *((90, roll) for roll in range(0, 360, 45)),
    *((tilt, roll) for tilt in (45, 135) for roll in range(0, 360, 90)),
)
"""Inclination and toolface [°] of the directions to the faces and edges of a cube."""
WISHES = {
    "accelerometer": "inclination<=0.01 deg",
    "fog_thermal": "drift<=0.03 deg/h",
    "rate_table": "scale factor<=1 ppm",
    "gyro_triad": "angle<=0.002 deg",
    "gyro_pair": "N<=2 ppm",
    "inclinometer": "azimuth<=0.05 deg",
    "accelerometer_magnitude": "component<=5e-5 g",
    "gyro_noise": "bias instability<=0.006 deg/h",
}


def list_small() -> Iterator[tuple[str, Pool, int]]:
    """Name, candidates and size of designs that can all be tried."""
    rows = np.vander(np.linspace(-1.0, 1.0, 13), 4)
    parts = np.einsum("ci,cj->cij", rows, rows)
    yield "cubic, 6 of 13 levels", Pool(np.zeros((4, 4)), parts, parts.mean(axis=0)), 6
    pool = triad_pool()
    for size in (4, 5):
        yield f"triad, {size} of {len(pool.parts)} faces and edges at 4 soaks", pool, size


def triad_pool() -> Pool:
    """Faces and edges of a cube, with the errors of the sample bench."""
    spec = instruments.parse_recipe(recipe.find("accelerometer", LOW_ORDERS))
    task = Task(equipment.read_equipment(None), range_degc=(-20.0, 60.0))
    bench = plan.prepare_plan(spec, task)  # type: ignore[arg-type]
    bench.mountings = [np.array(FACES_AND_EDGES, dtype=np.float64)]
    return bench.pool(len(FACES_AND_EDGES), (-20, 60, 20, -20), 60.0)


def best_of_all(pool: Pool, size: int) -> float:
    """Criterion of the best of all designs of a size."""
    return min(pool.criterion(one) for one in itertools.combinations(range(len(pool.parts)), size))


def library(size: int, rng: np.random.Generator) -> float:
    """Mean variance of a D-optimal design of pyDOE3 for a cubic surface of two factors, over that
    of the search.
    """
    grid = np.array(list(itertools.product(np.linspace(-1.0, 1.0, 7), repeat=2)))
    rows = doe.build_design_matrix(grid, 3)
    design, _ = doe.optimal_design(grid, size, 3, "D", "fedorov")
    theirs = doe.build_design_matrix(design, 3)
    count, parts = rows.shape[1], np.einsum("ci,cj->cij", rows, rows)
    pool = Pool(np.zeros((count, count)), parts, parts.mean(axis=0), most_uses=size)
    variance = np.sum(np.linalg.inv(theirs.T @ theirs) * pool.target)
    return float(variance / pool.search(size, rng)[1])


def time_plan(procedure: str, wish: str) -> tuple[float, float]:
    """Processor seconds of a plan and of a fit of the sample logs."""
    source, data = recipe.find(procedure), DATASETS / procedure
    spec = instruments.parse_recipe(source)
    begin = time.process_time()
    instruments.find(spec.procedure).fit(
        spec, data, ingest.find_logs(spec, data), instruments.silent
    )
    fitted = time.process_time() - begin
    begin = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        plans.plan(source, Path(folder) / "plan", wishes=(wish,))
    return time.process_time() - begin, fitted


def main() -> None:
    """Print three tables."""
    print("| designs | number | efficiency, 20 seeds: least | mean |\n|---|---|---|---|")
    for name, pool, size in list_small():
        best = best_of_all(pool, size)
        found = [best / pool.search(size, np.random.default_rng(seed))[1] for seed in range(20)]
        number = len(list(itertools.combinations(range(len(pool.parts)), size)))
        print(f"| {name} | {number:,} | {min(found):.4f} | {np.mean(found):.4f} |", flush=True)
    print("\n| rows of a cubic surface | pyDOE3 / search |\n|---|---|")
    for size in (10, 14, 20):
        print(f"| {size} | {library(size, np.random.default_rng(size)):.4f} |", flush=True)
    print("\n| procedure | plan [s] | fit [s] | fits |\n|---|---|---|---|")
    for procedure, wish in WISHES.items():
        planned, fitted = time_plan(procedure, wish)
        print(
            f"| `{procedure}` | {planned:.1f} | {fitted:.1f} | {planned / fitted:.0f} |", flush=True
        )


if __name__ == "__main__":
    main()
