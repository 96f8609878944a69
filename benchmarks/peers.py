"""calibkit and packaged peers on the same simulated data, judged by its truth; writes
docs/peers.md.

    python benchmarks/peers.py [--only PART] [--units 5] [--environments DIR]

PART is withheld, turntable, deviations or faults.
Peers run in environments of their own (those of run.py). Of calibkit the command line is run, as
its users do. What a peer does better is printed like the rest; the page is written when every part
was measured.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import TYPE_CHECKING

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from speed import peers  # noqa: E402 the repository is found first
from speed.page import replaced  # noqa: E402

if TYPE_CHECKING:
    from collections.abc import Sequence

PAGE = ROOT / "docs" / "peers.md"
BEGIN, END = (
    "<!-- measured: benchmarks/peers.py writes what stands below -->",
    "<!-- end of what is measured -->",
)
PARTS = {
    "withheld": "Drift on a ramp that was withheld",
    "turntable": "Six positions and a turntable",
    "deviations": "Allan deviation",
    "faults": "What goes wrong without a word",
}


def main(given: Sequence[str] | None = None) -> int:
    """Measure, print, write the page."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", action="append", choices=list(PARTS), help="a part; may be repeated"
    )
    parser.add_argument("--units", type=int, default=5, help="simulated gyros or units of a part")
    parser.add_argument(
        "--environments",
        type=Path,
        default=peers.cache(),
        help="where the peers' environments are kept",
    )
    parser.add_argument(
        "--page", type=Path, default=PAGE, help="the page whose measured part is written anew"
    )
    asked = parser.parse_args(given)
    texts = []
    for name in asked.only or PARTS:
        part = importlib.import_module(f"truth.{name}")
        texts.append(f"## {PARTS[name]}\n\n{part.measured(asked.units, asked.environments)}")
        print(texts[-1], flush=True)
    if not asked.only:
        page = asked.page.read_text(encoding="utf-8")
        asked.page.write_text(replaced(page, BEGIN, END, "\n".join(texts)), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
