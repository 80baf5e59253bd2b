"""Addresses of transducers: ``NAME://…``, where NAME is that of the registry."""

from urllib.parse import urlsplit

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


def _listed() -> str:
    return ", ".join(forms())
