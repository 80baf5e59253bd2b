"""MedRUE behind a CAN bus: six CiA 402 drives and an ATI Mini40 on its NETCANOEM board."""

from wrenchbed.twins.medrue.server import MedrueTwin

TWIN = MedrueTwin

__all__ = ["TWIN", "MedrueTwin"]
