"""Rows of a campaign on disk: small files, each written atomically; at the end one file."""

import json
import time
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from wrenchbed.campaigns.setting import Fleet, varied
from wrenchbed.errors import FleetError
from wrenchbed.files import atomic_write, write_text
from wrenchbed.simulation.closed_form import Model

Row = dict[str, Any]
ALL, SETTING, PARTS = "robots.parquet", "campaign.json", "parts"
_EVERY_S, _MOST = 2.0, 256
"""Longest time [s] and largest number of rows between two writes."""
_TEXT = ("effect", "values", "error", "verdict", "claimed", "named", "alike", "where")
_INTEGER = ("rows", "rank")
_NUMBER = ("size", "added", "inside95", "residual.force", "residual.torque")
_JUDGED = tuple(f"{x}.{w}" for x in ("force", "torque", "position") for w in ("before", "after"))
_DIAGNOSED = (
    "probability", "gap.configured", "gap.calibrated", "gap.with_effects", "closed", "right",
)  # fmt: skip
SECONDS = ("seconds.record", "seconds.calibrate", "seconds.diagnose")
"""Columns that a second run need not repeat."""


def schema(fleet: Fleet) -> pa.Schema:
    """Columns of a fleet's rows; units are SI, see docs/how-to/campaigns.md."""
    model = Model.of(fleet.model_robot())
    names = [model.parameters.names[i] for i in varied(model)]
    parameters = [f"{part}.{n}" for n in names for part in ("true", "fit", "std")]
    columns = [("robot", pa.int64()), ("seed", pa.int64())]
    columns += [(n, pa.string()) for n in _TEXT] + [(n, pa.int64()) for n in _INTEGER]
    columns += [("converged", pa.bool_())]
    columns += [(n, pa.float64()) for n in (*_NUMBER, *_JUDGED, *_DIAGNOSED, *parameters, *SECONDS)]
    return pa.schema(columns)


def empty(fleet: Fleet, k: int) -> Row:
    """The row of robot k before anything is known."""
    return {"robot": k, "seed": fleet.seed} | dict.fromkeys(_TEXT, "")


class CampaignRows:
    """The finished rows of a campaign, in a folder.

    Args:
        folder: of this campaign alone.
        fleet: what its rows follow from.

    Raises:
        FleetError: the folder holds another campaign, or files of something else.
    """

    def __init__(self, folder: Path, fleet: Fleet) -> None:
        self.folder, self.schema = folder, schema(fleet)
        self._parts = folder / PARTS
        self._waiting: list[Row] = []
        self._written = time.monotonic()
        self._begin(fleet)
        self._number = max((int(p.stem) for p in self._parts.glob("*.parquet")), default=0)

    def _begin(self, fleet: Fleet) -> None:
        path = self.folder / SETTING
        if path.exists():
            before = json.loads(path.read_text(encoding="utf-8"))
            for name, value in fleet.to_json().items():
                if before.get(name) != value:
                    raise FleetError(
                        f"{self.folder}: holds a campaign with {name} = {before.get(name)!r}, "
                        f"not {value!r}: give it another folder"
                    )
        elif self.folder.exists() and any(self.folder.iterdir()):
            raise FleetError(f"{self.folder}: holds other files; give a new folder")
        self._parts.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(fleet.to_json(), indent=1))

    def table(self) -> pa.Table:
        """All rows so far in the order of the robots, each once."""
        files = [self.folder / ALL, *sorted(self._parts.glob("*.parquet"))]
        tables = [pq.read_table(f, schema=self.schema) for f in files if f.exists()]
        table = pa.concat_tables([self.schema.empty_table(), *tables])
        order = pc.sort_indices(table["robot"])
        numbers = table["robot"].take(order).to_pylist()
        first = [i for i, n in enumerate(numbers) if i == 0 or numbers[i - 1] != n]
        return table.take(order.take(pa.array(first, pa.int64())))

    def done(self) -> set[int]:
        """Robots whose rows are on disk."""
        return set(self.table()["robot"].to_pylist())

    def add(self, row: Row) -> None:
        """Keep a row; it is on disk two seconds later at most, when more rows come."""
        self._waiting.append(row)
        if len(self._waiting) >= _MOST or time.monotonic() - self._written > _EVERY_S:
            self.flush()

    def flush(self) -> None:
        """Write what waits, as one more part."""
        if not self._waiting:
            return
        table = pa.Table.from_pylist(self._waiting, schema=self.schema)
        with atomic_write(self._parts / f"{self._number + 1:06d}.parquet") as temporary:
            pq.write_table(table, temporary)
        self._number += 1
        self._waiting, self._written = [], time.monotonic()

    def finish(self) -> pa.Table:
        """One file of all rows instead of many; the rows."""
        self.flush()
        table = self.table()
        with atomic_write(self.folder / ALL) as temporary:
            pq.write_table(table, temporary)
        for part in self._parts.glob("*"):
            part.unlink()
        return table
