"""`wrenchbed import`: text files, rosbags and MCAP files become recordings."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import tyro

import wrenchbed as wb
from wrenchbed.cli import console
from wrenchbed.cli.console import Json
from wrenchbed.data.column_map import ColumnMap


def import_(
    files: tyro.conf.Positional[tuple[Path, ...]],
    /,
    map: Path,
    out: Path,
    mode: Literal["static", "dynamic", "auto"] | None = None,
    name_pattern: str | None = None,
    as_json: Json = False,
) -> None:
    """Bring text files (CSV, …), rosbags and MCAP files in through a column map that states units.

    Args:
        files: CSV files, rosbags (1 or 2), MCAP files; several are merged on time.
        map: TOML or JSON column map (docs/how-to/import.md), or the name of a ready one: ros-ur5,
            ros-oriented, ur-rtde, ur-client.
        out: Recording to write; of a log of holds and moves, OUT.motion.parquet gets all of it.
        mode: static, dynamic, or auto: a log of holds and moves is split into poses by itself. As
            the map says if none.
        name_pattern: Every file is one pose, and its name holds values, as pose_{roll}_{yaw}.csv;
            the map uses them as columns.
        as_json: Print the result as JSON.
    """
    console.check_out(out, map, *files)
    column_map = _changed(wb.read_map(map), mode, name_pattern)
    imported = wb.import_files(files, column_map)
    imported.recording.write(out)
    rows, excluded = len(imported.recording), imported.left_out
    result = {"recording": str(out), "rows": rows, "rows_left_out": excluded}
    lines = list(imported.notes)
    if imported.motion is not None and imported.split is not None:
        whole = out.with_suffix(".motion.parquet")
        console.check_out(whole, map, *files)
        imported.motion.write(whole)
        holds, moves = len(imported.split.seconds), imported.split.moves
        result |= {"motion": str(whole), "holds": holds, "moves": moves}
        lines.append(f"all {len(imported.motion)} rows, moves too → {whole}")
    result["notes"] = list(imported.notes)
    rest = f", {excluded} outside the other files' times left out" if excluded else ""
    lines.append(f"imported {rows} rows{rest} → {out}")
    console.answer(result, as_json, "\n".join(lines))


def _changed(column_map: ColumnMap, mode: str | None, name_pattern: str | None) -> ColumnMap:
    """A map with what the command line says otherwise."""
    if mode is not None:
        metadata = replace(column_map.metadata, mode="dynamic" if mode == "auto" else mode)
        column_map = replace(column_map, mode=mode, metadata=metadata)
    if name_pattern is not None:
        first, *rest = column_map.files
        first = replace(first, each="pose", name_pattern=name_pattern)
        column_map = replace(column_map, files=(first, *rest))
    return column_map
