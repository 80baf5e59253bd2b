"""Addresses of transducers: ``NAME://…``, where NAME is that of the registry."""

from dataclasses import fields
from typing import Any
from urllib.parse import parse_qsl, urlsplit

from wrenchbed import registry
from wrenchbed.errors import ParameterError
from wrenchbed.hardware.transducers.base import Transducer


def forms() -> tuple[str, ...]:
    """The addresses that registered transducers can be given by."""
    kinds = (registry.load("transducers", name) for name in registry.names("transducers"))
    return tuple(kind.form for kind in kinds if getattr(kind, "form", ""))


def transducer_at(address: str) -> Transducer:
    """The transducer that an address names; closed.

    Raises:
        ParameterError: it names none; the message lists the forms.
    """
    try:
        parts = urlsplit(address)
    except ValueError as error:
        raise ParameterError(f"sensor {address!r}: {error}: give {_listed()}") from error
    if parts.scheme in registry.names("transducers"):
        kind = registry.load("transducers", parts.scheme)
        if getattr(kind, "form", ""):
            try:
                found: Transducer = kind.at_address(parts)
            except (ParameterError, ValueError) as error:
                raise ParameterError(f"sensor {address!r}: {error}: give {kind.form}") from error
            return found
    raise ParameterError(f"sensor {address!r}: give {_listed()}")


def numbers_of(query: str, options: type) -> dict[str, Any]:
    """Values of a query by the fields of an options dataclass other than ``port``.

    Raises:
        ParameterError: a name that is no field, or a value that is none.
    """
    kinds = {f.name: f.type for f in fields(options) if f.name != "port"}
    found: dict[str, Any] = {}
    for name, text in parse_qsl(query, keep_blank_values=True):
        if name not in kinds:
            raise ParameterError(f"{name} is no setting. Known: {', '.join(kinds)}")
        kind = {"int": int, "float": float, int: int, float: float}.get(kinds[name], str)
        try:
            found[name] = kind(text)
        except ValueError:
            raise ParameterError(f"{name}={text} must be a number") from None
    return found


def _listed() -> str:
    return ", ".join(forms())
