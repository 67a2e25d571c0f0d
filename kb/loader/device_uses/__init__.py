"""Devices in a domain: what they say is put together with what the domain itself says.

A device is text with parameters. It is filled in first and read then, by the readers that read the
domain's own files. Every part of the tree knows the file that it comes from, so an error is told
where it stands: in the file of the device.
"""

from cellwright.kb.loader.device_uses.device_composition import compose_devices, composed_beside
from cellwright.kb.loader.device_uses.device_files import (
    DeviceHead,
    all_devices,
    available_devices,
    device_called,
    read_device,
)
from cellwright.kb.loader.device_uses.use_binding import DeviceUse, uses_in

__all__ = [
    "DeviceHead",
    "DeviceUse",
    "all_devices",
    "available_devices",
    "compose_devices",
    "composed_beside",
    "device_called",
    "read_device",
    "uses_in",
]
