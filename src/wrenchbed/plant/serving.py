"""Emulators by name before robots in MuJoCo, and their errors as this package says them."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import robot_emulators
from robot_emulators import (
    Emulator,
    EmulatorError,
    FaultError,
    Options,
    Plant,
    PlantRequest,
    SettingError,
)
from wrenchbed import registry
from wrenchbed.errors import DriverError, MapError, ParameterError
from wrenchbed.plant.body import BodyOptions
from wrenchbed.plant.mujoco_plant import MujocoPlant


@dataclass(frozen=True)
class EmulatorOptions:
    """Options that every emulator takes.

    Attributes:
        host: address of this machine to serve at, 127.0.0.1 … 127.255.255.254.
        parameters: true values where they differ from nominal, by name, SI.
        noise: ``real``, ``white`` or ``off``.
        seed: of the noise and of the effects' random parts.
        effects: as ``joint.compliance:joint=2,stiffness=1.4e4``; without values of typical size.
        table: height of a plate that the tool may press on [m].
        setting: of this kind of emulator, name → text.
    """

    host: str = "127.0.0.1"
    parameters: Mapping[str, float] = field(default_factory=dict)
    noise: str = "real"
    seed: int = 0
    effects: tuple[str, ...] = ()
    table: float | None = None
    setting: Mapping[str, str] = field(default_factory=dict)

    def plant(self, request: PlantRequest) -> Plant:
        """The robot that an emulator asks for."""
        body = BodyOptions(
            request.robot, self.parameters, self.noise, self.seed, self.effects, self.table
        )
        return MujocoPlant(body, request)


def emulated(kind: str | type[Emulator], options: EmulatorOptions) -> Emulator:
    """An emulator by name or class, before its robot in MuJoCo; it is not started.

    Raises:
        SettingError: an option or a setting is impossible.
    """
    kind = registry.load("emulators", kind) if isinstance(kind, str) else kind
    return kind(Options(options.host, options.seed, options.setting), options.plant)


@contextmanager
def serve(
    name: str, options: EmulatorOptions | None = None, faults: str | Path | None = None
) -> Iterator[Emulator]:
    """Serve an emulated robot or sensor while the block runs.

    Args:
        name: see ``names("emulators")``.
        options: address, true parameters, noise, effects.
        faults: TOML script of timed faults; their time counts from the start of the block.

    Yields:
        The server; ``addresses`` names each link, ``failed`` is set if it breaks down.

    Raises:
        NotFoundError: there is no such emulator.
        ParameterError: an option or a setting is impossible.
        MapError: the script of faults is wrong.
        DriverError: a port is taken or not allowed.
    """
    options = options or EmulatorOptions()
    kind, plain = (
        registry.load("emulators", name),
        Options(options.host, options.seed, options.setting),
    )
    with translated(), robot_emulators.serve(kind, options.plant, plain, faults) as server:
        yield server


@contextmanager
def translated() -> Iterator[None]:
    """Errors of an emulator inside the block are raised as this package's own."""
    try:
        yield
    except SettingError as error:
        raise ParameterError(str(error)) from error
    except FaultError as error:
        raise MapError(str(error)) from error
    except EmulatorError as error:
        raise DriverError(str(error)) from error
