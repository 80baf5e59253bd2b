"""Logs of robots that run ROS: one topic of a bag or an MCAP file as a table."""

from wrenchbed.logs.tables import is_log, table

__all__ = ["is_log", "table"]
