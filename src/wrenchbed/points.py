"""Known points of the world from a CSV file with the columns x, y, z [m]."""

import csv
from pathlib import Path

import numpy as np

from wrenchbed.errors import PlanError

_FAR = 10.0


def read(path: str | Path) -> np.ndarray:
    """Points (K, 3) [m].

    Raises:
        PlanError: names the file, the column and the row.
    """
    path = Path(path)
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file))
    except (OSError, UnicodeDecodeError) as cause:
        raise PlanError(f"{path}: cannot be read as CSV") from cause
    if not rows:
        raise PlanError(f"{path}: holds no points")
    points = np.empty((len(rows), 3))
    for i, row in enumerate(rows):
        for k, name in enumerate("xyz"):
            text = row.get(name)
            if text is None:
                raise PlanError(f"{path}: row {i}: column {name!r} is missing; wanted x,y,z in m")
            try:
                points[i, k] = float(text)
            except ValueError:
                raise PlanError(f"{path}: row {i}: {name} = {text!r} is not a number") from None
            if not abs(points[i, k]) < _FAR:
                raise PlanError(
                    f"{path}: row {i}: {name} = {text} m is not within {_FAR:g} m (is it in mm?)"
                )
    return points
