"""Figures of a sealed benchmark: those of every benchmark, and what the data itself allows."""

from collections.abc import Mapping, Sequence

from wrenchbed.blind.answer import Answer
from wrenchbed.diagnosis.linear import Claim
from wrenchbed.diagnosis.scoring import METRICS, SURE, Metric, holds
from wrenchbed.diagnosis.scoring_rows import Row


def metrics(answers: Mapping[str, Answer]) -> dict[str, Metric]:
    """Every figure by name, those up to what data cannot tell beside the strict ones."""

    def alike(row: Row) -> tuple[str, ...]:
        """True effects and those that this very data cannot tell from them."""
        return tuple(n for c in answers[row.id].causes for n in (c.effect, *c.alike))

    def isolated(row: Row, method: str) -> Sequence[float] | None:
        return (holds(row.answers[method], alike(row)), 1.0) if row.kind == "single" else None

    def unlike(row: Row, method: str) -> Sequence[float] | None:
        if row.kind != "single" or len(alike(row)) > 1:
            return None
        return (holds(row.answers[method], row.truth), 1.0)

    def sure(row: Row, method: str) -> Sequence[float] | None:
        claim = row.answers[method]
        if not claim.causes or claim.sure <= SURE:
            return None
        allowed = alike(row) if row.truth else ()
        return (bool(set(claim.causes[0]) & set(allowed)), 1.0)

    share = METRICS["isolation"].combine
    extra = {
        "isolation_alike": Metric(
            "… or one that this data cannot tell from it",
            "≥ 95 %",
            isolated,
            share,
        ),
        "isolation_unlike": Metric("… effects that nothing imitates", "≥ 95 %", unlike, share),
    }
    told: dict[str, Metric] = {}
    for name, metric in METRICS.items():
        if name == "coverage_right":  # whose variant is right is not sealed
            continue
        told[name] = metric
        if name == "isolation":
            told |= extra
        if name == "sure":
            told["sure_alike"] = Metric(
                "… or as good as right, by what this data can tell",
                "≥ 97 %",
                sure,
                share,
            )
    return told


def first(claim: Claim) -> str:
    """Subsystem of the first cause, or the verdict."""
    return claim.causes[0][0].partition(".")[0] if claim.causes else claim.verdict
