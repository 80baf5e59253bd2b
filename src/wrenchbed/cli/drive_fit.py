"""A fit of joint torques as tables in 80 columns."""

from typing import Any

from rich.console import Group
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from wrenchbed.calibration.fit import IdentifiedValue
from wrenchbed.calibration.fit_words import parameter_words
from wrenchbed.drives.fit import DriveFit
from wrenchbed.pages.numbers import percent


def drive_fit_table(fit: DriveFit) -> Group:
    """Parameters of all, of each joint, errors on held-out rows, and the status."""
    head = Text.assemble(
        ("joint efforts ", "bold"), f"{fit.recording}  {fit.robot}, {fit.seconds:.0f} s, "
        f"{fit.rows} rows below {fit.cutoff:.3g} Hz"
    )  # fmt: skip
    shared = [p for p in fit.identified if not p.name.rpartition(".")[2].isdigit()]
    parts: list[Any] = [head, "", _shared(shared), ""] if shared else [head, ""]
    parts += [_by_joint(fit), "", _errors(fit), ""]
    title = "refuted by the data" if fit.refuted else "status"
    parts += [Text(title, style="bold"), Padding(Text(fit.refuted or fit.status), (0, 0, 0, 2))]
    return Group(*parts)


def _table() -> Table:
    return Table(box=None, padding=(0, 2, 0, 0), header_style="dim")


def _shared(values: list[IdentifiedValue]) -> Table:
    table = _table()
    table.add_column("parameter", no_wrap=True)
    for name in ("value", "± std", "start"):
        table.add_column(name, justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for p in values:
        told = parameter_words(p.name, p.value, p.std, p.interval95, p.nominal, p.unit)
        table.add_row(told.name, told.value, told.std, told.start, told.unit)
    return table


def _by_joint(fit: DriveFit) -> Table:
    """One row a parameter of the joints, one column a joint; ± in the row below."""
    kinds = dict.fromkeys(p.name.rpartition(".")[0] for p in fit.identified
                          if p.name.rpartition(".")[2].isdigit())  # fmt: skip
    table = _table()
    table.add_column("per joint", no_wrap=True)
    for e in fit.joints:
        table.add_column(str(e.joint), justify="right", no_wrap=True)
    table.add_column("unit", no_wrap=True)
    for kind in kinds:
        own = [fit[f"{kind}.{e.joint}"] for e in fit.joints]
        told = [parameter_words(p.name, p.value, p.std, p.interval95, p.nominal, p.unit)
                for p in own]  # fmt: skip
        usual, others = _units([w.unit for w in told])
        table.add_row(kind, *(w.value for w in told), usual)
        table.add_row("  ± std", *(w.std for w in told), others, style="dim")
    return table


def _units(each: list[str]) -> tuple[str, str]:
    """Unit of most joints, and of which joints another one: ``1: N``."""
    usual = max(each, key=each.count)
    other = [str(j) for j, unit in enumerate(each, start=1) if unit != usual]
    named = next((unit for unit in each if unit != usual), "")
    return usual, f"{','.join(other)}: {named}" if other else ""


def _errors(fit: DriveFit) -> Table:
    table, units = _table(), [e.unit for e in fit.joints]
    alike = len(set(units)) == 1
    table.add_column(f"rms in the band{f' [{units[0]}]' * alike}", no_wrap=True)
    for e in fit.joints:
        table.add_column(str(e.joint), justify="right", no_wrap=True)
    if not alike:
        table.add_row("unit", *units, style="dim")
    table.add_row("effort itself", *(f"{e.measured:.3g}" for e in fit.joints))
    if all(e.nominal is not None for e in fit.joints):
        table.add_row("left by the nominal robot", *(f"{e.nominal:.3g}" for e in fit.joints))
    table.add_row("left by the fit", *(f"{e.left:.3g}" for e in fit.joints))
    table.add_row("on held-out rows", *(f"{e.held_out:.3g}" for e in fit.joints))
    shares = (f"{percent(e.explained)} %" for e in fit.joints)
    table.add_row("explained, held out", *shares)
    return table
