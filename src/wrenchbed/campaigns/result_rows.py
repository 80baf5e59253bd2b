"""Rows of a campaign on disk: small files, each written atomically; at the end one file."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc

from wrenchbed.campaigns.settings import Fleet, varied
from wrenchbed.errors import FleetError
from wrenchbed.files import write_text
from wrenchbed.jobs.parts import Parts, check_folders, read_table, write_table
from wrenchbed.simulation.closed_form import Model

Row = dict[str, Any]
ALL, SETTING, PARTS = "robots.parquet", "campaign.json", "parts"
_INTEGER = ("rows", "rank")
_NUMBER = ("inside95", "residual.force", "residual.torque")
_JUDGED = tuple(f"{x}.{w}" for x in ("force", "torque", "position") for w in ("before", "after"))
SECONDS = ("seconds.record", "seconds.calibrate")
"""Columns of durations, which differ between equal runs."""


def schema(fleet: Fleet) -> pa.Schema:
    """Columns of a fleet's rows; units are SI, see docs/how-to/campaigns.md."""
    model = Model.of(fleet.model_robot())
    names = [model.parameters.names[i] for i in varied(model)]
    parameters = [f"{part}.{n}" for n in names for part in ("true", "fit", "std")]
    columns = [("robot", pa.int64()), ("seed", pa.int64()), ("error", pa.string())]
    columns += [(n, pa.int64()) for n in _INTEGER] + [("converged", pa.bool_())]
    columns += [(n, pa.float64()) for n in (*_NUMBER, *_JUDGED, *parameters, *SECONDS)]
    return pa.schema(columns)


def empty(fleet: Fleet, k: int) -> Row:
    """Empty row of robot k."""
    return {"robot": k, "seed": fleet.seed, "error": ""}


class CampaignRows:
    """The finished rows of a campaign, in a folder.

    Args:
        folder: of this campaign alone.
        fleet: what its rows follow from.

    Raises:
        FleetError: the folder holds another campaign, or files of something else.
    """

    def __init__(self, folder: Path, fleet: Fleet) -> None:
        self.folder, settings = folder, fleet.to_json()
        check_folders(folder / SETTING, settings, [folder], FleetError)
        write_text(folder / SETTING, json.dumps(settings, indent=1))
        self._parts = Parts(folder / PARTS, schema=schema(fleet))

    def table(self) -> pa.Table:
        """Table of all rows in the order of the robots, each once."""
        table, path = self._parts.table(), self.folder / ALL
        if path.exists():
            table = pa.concat_tables([read_table(path, table.schema), table])
        order = pc.sort_indices(table["robot"])
        numbers = table["robot"].take(order).to_pylist()
        first = [i for i, n in enumerate(numbers) if i == 0 or numbers[i - 1] != n]
        return table.take(order.take(pa.array(first, pa.int64())))

    def done(self) -> set[int]:
        """Numbers of the robots whose rows are on disk."""
        return set(self.table()["robot"].to_pylist())

    def add(self, rows: Sequence[Row]) -> None:
        """Write the rows of some robots as one more part."""
        self._parts.write(int(rows[0]["robot"]), rows)

    def finish(self) -> pa.Table:
        """Write one file of all rows and remove the parts; the rows."""
        table = self.table()
        write_table(self.folder / ALL, table)
        self._parts.remove()
        return table
