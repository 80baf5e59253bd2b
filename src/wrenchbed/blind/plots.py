"""Figures of a score: how far its probabilities hold, and how small an effect it finds."""

from collections.abc import Sequence

import numpy as np

from wrenchbed.blind.scoring import ORACLE, Score
from wrenchbed.diagnosis.scoring import right
from wrenchbed.diagnosis.scoring_rows import OURS, Row
from wrenchbed.diagnosis.scoring_tables import shares, sized
from wrenchbed.study.plots import BLUE, GREY, ORANGE, PURPLE, canvas, to_svg

_BINS = np.array([0.0, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 1.0 + 1e-9])


def reliability(rows: Sequence[Row]) -> str:
    """Stated probability of first answers against the share that was right, with 90 % intervals."""
    stated = np.array([r.answers[OURS].sure for r in rows])
    held = np.array([right(r, r.answers[OURS]) for r in rows])
    which = np.digitize(stated, _BINS) - 1
    with canvas((4.6, 3.9)) as (figure, (ax,)):
        ax.plot([0, 100], [0, 100], color=GREY, lw=1.0, ls="--", label="as stated")
        for k in np.unique(which):
            own = held[which == k]
            n, share = len(own), float(own.mean())
            low, high = _interval(int(own.sum()), n)
            x = 100 * float(stated[which == k].mean())
            ax.plot([x, x], [100 * low, 100 * high], color=BLUE, lw=1.6)
            ax.plot(x, 100 * share, "o", color=BLUE, ms=6)
            ax.annotate(f"n = {n}", (x, 2), rotation=90, fontsize=7.5, color=GREY, ha="center")
        ax.plot([], [], "o", color=BLUE, ms=6, label="right, with 90 % interval")
        ax.set(xlim=(-3, 103), ylim=(0, 104), xlabel="stated [%]", ylabel="right [%]")
        ax.legend(loc="upper left")
        return to_svg(figure)


def detection(rows: Sequence[Row], score: Score) -> str:
    """Shares noticed and isolated against the gap, of the entrant, the oracle and BIC."""
    groups = [(span, own) for span, own in sized(rows) if own]
    labels = [
        f"{low:g}–{high:g}\nn = {len(own)}" if np.isfinite(high) else f"> {low:g}\nn = {len(own)}"
        for (low, high), own in groups
    ]
    curves = [(OURS, score.main, BLUE)]
    named = ((ORACLE, "oracle", PURPLE), ("bic", "BIC", ORANGE))
    curves += [(m, name, colour) for m, name, colour in named if m in score.beside]
    with canvas((6.4, 3.9)) as (figure, (ax,)):
        for method, name, colour in curves:
            told = [shares(own, method) for _, own in groups]
            ax.plot(
                [100 * (t[1] or 0) for t in told],
                color=colour,
                marker="o",
                ms=5,
                label=f"{name}: isolated",
            )
            if method == OURS:
                ax.plot(
                    [100 * (t[0] or 0) for t in told], color=colour, marker="o", ms=5, mfc="none",
                    ls=":", label=f"{name}: noticed",
                )  # fmt: skip
        ax.set_xticks(range(len(labels)), labels, fontsize=8)
        ax.set(ylim=(-3, 104), xlabel="gap that the effect adds [1]", ylabel="share of cases [%]")
        ax.legend(loc="lower right")
        return to_svg(figure)


def _interval(k: int, n: int) -> tuple[float, float]:
    """Jeffreys' 90 % interval of a share (Brown, Cai & DasGupta 2001)."""
    from scipy.stats import beta

    low = 0.0 if k == 0 else float(beta.ppf(0.05, k + 0.5, n - k + 0.5))
    high = 1.0 if k == n else float(beta.ppf(0.95, k + 0.5, n - k + 0.5))
    return low, high
