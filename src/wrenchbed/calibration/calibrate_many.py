"""Calibrations of many robots of one kind that ran the same poses."""

from collections.abc import Sequence

import numpy as np

from wrenchbed.calibration.calibrate import CalibrationOptions, Task, finished, prepared
from wrenchbed.calibration.fit import Fit
from wrenchbed.calibration.fits_of_many import fit_each
from wrenchbed.calibration.weighting import fit
from wrenchbed.data.recording import Recording
from wrenchbed.errors import WrenchbedError
from wrenchbed.physics.time_derivatives import Jet


def calibrate_each(recordings: Sequence[Recording]) -> list[Fit | WrenchbedError]:
    """`calibrate` of each, by its default options; the error where one cannot be calibrated.

    Those of one robot at the same poses and times are fitted together, to the same last bit.
    """
    options = CalibrationOptions()
    tasks: dict[int, Task] = {}
    results: dict[int, Fit | WrenchbedError] = {}
    for k, recording in enumerate(recordings):
        try:
            tasks[k] = prepared(recording, options, None)
        except WrenchbedError as error:
            results[k] = error
    for group in _alike(tasks):
        problems = [tasks[k].problem for k in group]
        outcomes = fit_each(problems) if len(group) > 1 else [None]
        for k, outcome in zip(group, outcomes, strict=True):
            try:
                single = fit(tasks[k].problem) if outcome is None else outcome
                results[k] = finished(tasks[k], single, options)
            except WrenchbedError as error:
                results[k] = error
    return [results[k] for k in range(len(recordings))]


def _alike(tasks: dict[int, Task]) -> list[list[int]]:
    """Groups of task numbers that can be fitted together."""
    groups: list[list[int]] = []
    for k, task in tasks.items():
        for group in groups:
            if _same(tasks[group[0]], task):
                group.append(k)
                break
        else:
            groups.append([k])
    return groups


def _same(a: Task, b: Task) -> bool:
    """Whether two tasks differ only in their readings."""
    one, two = a.problem, b.problem
    first, second = one.data, two.data
    if isinstance(first.q, Jet) or isinstance(second.q, Jet):
        return False
    named = one.model.robot is two.model.robot and one.model.gravity == two.model.gravity
    known = first.source == second.source != "residual" and first.dof == second.dof
    certain = first.row_covariance.any() and second.row_covariance.any()
    equal = (np.array_equal(getattr(first, n), getattr(second, n)) for n in ("q", "t", "count"))
    return bool(named and known and certain and one.free == two.free and all(equal))
