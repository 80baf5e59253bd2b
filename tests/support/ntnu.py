"""Real measurements: A. Skrede, NTNU 2024, doi 10.5281/zenodo.11096791."""

from pathlib import Path

import numpy as np

from wrenchbed.data import column_map
from wrenchbed.data.import_files import import_files
from wrenchbed.data.recording import Recording

DATA = Path(__file__).parents[1] / "data" / "ntnu_kuka_ati_gamma"
STD = np.array([0.0351, 0.0211, 0.0750, 0.00116, 0.00187, 0.000257])
GRAVITY = np.array([0.0, 0.0, -9.82085])


def static() -> Recording:
    """24 poses at rest."""
    mapping = column_map.read(DATA / "static.toml")
    return import_files([DATA / "0-calibration_fts-accel.csv"], mapping).recording


RUNS = {1: "1-baseline", 2: "2-vibrations", 3: "3-vibrations-contact"}


def motion(run: int) -> Recording:
    """A motion of 6.3 s."""
    files = [DATA / f"{RUNS[run]}_{k}.csv" for k in ("wrench", "accel", "orientations")]
    return import_files(files, column_map.read(DATA / "motion.toml")).recording
