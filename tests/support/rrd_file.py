"""What a rerun file holds, read back without a viewer."""

from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from rerun.chunk import RrdReader


@pytest.fixture(scope="module", autouse=True)
def strict():
    """Let rerun raise where it would only warn, in modules that import this."""
    rr.set_strict_mode(True)
    yield
    rr.set_strict_mode(False)


class Rrd:
    """A file's entities, components and their values."""

    def __init__(self, path: Path) -> None:
        self._store = RrdReader(str(path)).store()

    def values(self, entity: str, component: str, axis: str = "") -> np.ndarray:
        """All values (N, K, …) of a component such as ``Scalars:scalars``, in time's order."""
        return self._rows(entity, component, axis)[1]

    def times(self, entity: str, component: str, axis: str) -> np.ndarray:
        """Where on a timeline these are (N,): rows, or nanoseconds."""
        return self._rows(entity, component, axis)[0]

    def entities(self) -> set[str]:
        """Paths of all that was drawn."""
        return {str(c.entity_path) for c in self._store.stream().to_chunks()}

    def _rows(self, entity: str, component: str, axis: str) -> tuple[np.ndarray, np.ndarray]:
        times, rows = [], []
        for chunk in self._store.stream().filter(content=entity).to_chunks():
            batch = chunk.to_record_batch()
            if str(chunk.entity_path) != entity or component not in batch.schema.names:
                continue
            known = batch.schema.names if axis else ()
            if axis and axis not in known:
                continue
            rows += batch.column(component).to_pylist()
            when = batch.column(axis).cast("int64") if axis else range(batch.num_rows)
            times += [int(t.as_py() if axis else t) for t in when]
        assert rows, f"{entity} has no {component}"
        order = np.argsort(times, kind="stable")
        return np.array(times)[order], np.array([rows[k] for k in order])
